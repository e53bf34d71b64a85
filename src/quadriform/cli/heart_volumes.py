"""Volumes of a fitted ventricle below its base: fields of the record, and rows of the table."""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from quadriform.columns import MILLIMETRES
from quadriform.fitting.support import Support
from quadriform.heart.heart_cycle import OF_SAMPLES
from quadriform.heart.measures_table import Measures
from quadriform.heart.volumes import RESOLUTION, volume
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import Estimate, with_deviation

CYCLE = {
    "ejection_fraction": "ejection fraction",
    "end_diastolic_volume_ml": "end-diastolic volume",
    "end_systolic_volume_ml": "end-systolic volume",
    "closed_ejection_fraction": "ejection fraction, closed",
}
"""Field of `--json` -> quantity of the measures."""
SAME = 1e-3
"""A closed volume that differs by a smaller fraction is that below the base."""


def volumes_below(model: DeformableModel) -> dict[str, Any]:
    """Fields of `--json`: volumes in ml of the cavity, and of the wall where there is one, below the base; the base.

    Each with its standard deviation, null where the model has no posterior.
    """
    plane = model.landmarks.base
    ml = MILLIMETRES.get(model.unit, 1.0) ** 3 / 1000

    def cavity(each: DeformableModel, resolution: int = RESOLUTION) -> float:
        """Volume of the cavity."""
        return ml * volume(each, "endo", plane, resolution)

    def wall(each: DeformableModel, resolution: int = RESOLUTION) -> float:
        """Volume between both surfaces."""
        return ml * volume(each, "epi", plane, resolution) - cavity(each, resolution)

    def closed(each: DeformableModel, resolution: int = RESOLUTION) -> float:
        """Volume of the whole closed surface of the cavity."""
        return ml * volume(each, "endo", None, resolution)

    fields = {"volume_ml": cavity} | ({"wall_volume_ml": wall} if "epi" in model.surfaces else {})
    found: dict[str, Any] = {}
    for name, measure in (fields | {"closed_volume_ml": closed}).items():
        found |= {name: measure(model), f"{name}_sd": model.deviation_of(partial(measure, resolution=OF_SAMPLES))}
    base = None if plane is None else {"point": plane.point.tolist(), "direction": plane.direction.tolist()}
    return found | {"base": base, "base_from": model.landmarks.base_from}


def supported_volumes(support: Mapping[str, Support]) -> dict[str, Any]:
    """Fields of `--json`: shares [0, 1] of the volumes of the cavity, below the base and closed, that data supports."""
    return {"volume_supported": support["endo"].below, "closed_volume_supported": support["endo"].volume}


def volume_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The same as rows of a table; the closed volume only where it differs."""
    if "volume_ml" not in record:
        return []
    base, closed = record["base"], record["closed_volume_ml"]
    where = "" if base is None else " below the base"
    below, whole = (record.get(f"{name}_supported") for name in ("volume", "closed_volume"))
    rows = [(f"cavity volume{where}", str(Estimate(record["volume_ml"], "ml", below, record["volume_ml_sd"])))]
    if abs(closed - record["volume_ml"]) > SAME * closed:
        rows.append(
            ("cavity volume, closed surface", str(Estimate(closed, "ml", whole, record["closed_volume_ml_sd"])))
        )
    if "wall_volume_ml" in record:
        wall = Estimate(record["wall_volume_ml"], "ml", sd=record["wall_volume_ml_sd"])
        rows.append((f"wall volume{where}", str(wall)))
    if base is None:
        return rows
    return [*rows, ("base", f"{record['base_from']}: {_text(base['point'], base['direction'])}")]


def cycle_volumes(measures: Measures | None) -> dict[str, Any]:
    """Fields of `--json`: volumes in ml and ejection fraction in % of a cycle, and where they come from."""
    if measures is None or measures.es is None:
        return {}
    rows = {row.quantity: row for row in measures.rows}
    measured = {name: rows[quantity] for name, quantity in CYCLE.items() if quantity in rows}
    found: dict[str, Any] = {name: row.value for name, row in measured.items()}
    found |= {f"{name}_sd": row.sd for name, row in measured.items()}
    return found | {"volumes_from": rows["ejection fraction"].how}


def cycle_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The same as rows of a table."""
    if "ejection_fraction" not in record:
        return []
    numbers = {name: with_deviation(record[name], record[f"{name}_sd"]) for name in CYCLE if name in record}
    volumes = " / ".join(numbers[name] for name in ("end_diastolic_volume_ml", "end_systolic_volume_ml"))
    return [
        ("ejection fraction", f"{numbers['ejection_fraction']} %"),
        ("end-diastolic / end-systolic volume", f"{volumes} ml"),
        ("of", record["volumes_from"]),
    ]


def _text(point: Iterable[float], direction: Iterable[float]) -> str:
    """A plane as `--base` takes it."""
    return "/".join(",".join(f"{x:.6g}" for x in part) for part in (point, direction))
