"""Volumes of a fitted ventricle below its base: fields of the record, and rows of the table."""

from collections.abc import Iterable, Mapping
from typing import Any

from quadriform.columns import MILLIMETRES
from quadriform.heart.volumes import volume
from quadriform.shapes.model import DeformableModel

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


def volume_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The same as rows of a table; the closed volume only where it differs."""
    if "volume_ml" not in record:
        return []
    base, closed = record["base"], record["closed_volume_ml"]
    where = "" if base is None else " below the base"
    rows = [(f"cavity volume{where}", f"{record['volume_ml']:.4g} ml")]
    if abs(closed - record["volume_ml"]) > SAME * closed:
        rows.append(("cavity volume, closed surface", f"{closed:.4g} ml"))
    if "wall_volume_ml" in record:
        rows.append((f"wall volume{where}", f"{record['wall_volume_ml']:.4g} ml"))
    if base is None:
        return rows
    return [*rows, ("base", f"{record['base_from']}: {_text(base['point'], base['direction'])}")]


def _text(point: Iterable[float], direction: Iterable[float]) -> str:
    """A plane as `--base` takes it."""
    return "/".join(",".join(f"{x:.6g}" for x in part) for part in (point, direction))
