"""Volumes of a fitted ventricle below its base: fields of the record, and rows of the table."""

from collections.abc import Iterable, Mapping
from typing import Any

from quadriform.columns import MILLIMETRES
from quadriform.fitting.support import Support
from quadriform.heart.measures_table import Measures
from quadriform.heart.volumes import volume
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
    """Fields of `--json`: volumes in ml of the cavity, and of the wall where there is one, below the base; the base."""
    plane = model.landmarks.base
    ml = MILLIMETRES.get(model.unit, 1.0) ** 3 / 1000
    cavity = ml * volume(model, "endo", plane)
    wall = {"wall_volume_ml": ml * volume(model, "epi", plane) - cavity} if "epi" in model.surfaces else {}
    base = None if plane is None else {"point": plane.point.tolist(), "direction": plane.direction.tolist()}
    closed = ml * volume(model, "endo", None)
    known = {"closed_volume_ml": closed, "base": base, "base_from": model.landmarks.base_from}
    return {"volume_ml": cavity, **wall, **known}


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
    rows = [(f"cavity volume{where}", str(Estimate(record["volume_ml"], "ml", below)))]
    if abs(closed - record["volume_ml"]) > SAME * closed:
        rows.append(("cavity volume, closed surface", str(Estimate(closed, "ml", whole))))
    if "wall_volume_ml" in record:
        rows.append((f"wall volume{where}", f"{record['wall_volume_ml']:.4g} ml"))
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
