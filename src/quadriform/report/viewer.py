"""The viewer: the parameters of a model, and a page that evaluates them.

The page holds superquadrics, control points and splines, not meshes: a whole cycle is some kilobytes. Data points and
what is only known in Python (residual, uncertainty, wall thickness at a coarse grid) are packed in 16 and 8 bits.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.points import Array
from quadriform.report.page import rendered, source
from quadriform.report.slices import COLOURS
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel

MOST_POINTS = 120_000
"""Data points of all surfaces and frames that a page holds: 1.3 MB of it."""
FIELD_CELLS = 12
"""Cells along a cube edge of the grid on which fields are given: 866 values a surface and frame."""
NO_VALUE, STEPS = 255, 254
SCRIPTS = ("model.js", "scene.js", "webgl.js", "canvas.js", "viewer.js", "controls.js")
LITRES = {"mm": (1e-3, "ml"), "m": (1.0, "m^3")}
Plane = tuple[Array, Array]
"""A point and the direction to the side that is cut off."""


@dataclass(frozen=True)
class ScalarField:
    """Values on the surfaces that the page cannot compute by itself.

    Attributes:
        name: what they are.
        unit: of the values.
        values: surface -> one array (866,) a frame, at `model.superquadric(name).grid(FIELD_CELLS)`; NaN: not known.
    """

    name: str
    unit: str
    values: Mapping[str, Sequence[Array]]


@dataclass(frozen=True)
class Scene:
    """What a viewer shows beside the model.

    Attributes:
        title: text alternative of the drawing.
        points: surface -> one cloud (n, 3) a frame.
        residuals: surface -> one array (n,) a frame, the points' signed distances.
        errors: RMS distance of each frame, as Python has it; None where it is not known.
        fields: further values that colour the surface.
        planes: the base in each frame, where the volume of the cavity ends; None is the whole closed surface.
    """

    title: str = "model"
    points: Mapping[str, Sequence[Array]] = field(default_factory=dict)
    residuals: Mapping[str, Sequence[Array]] = field(default_factory=dict)
    errors: Sequence[float | None] = (None,)
    fields: Sequence[ScalarField] = ()
    planes: Sequence[Plane] | None = None


def viewer(model: DeformableModel | MovingModel, scene: Scene | None = None) -> Markup:
    """The viewer as a part of a page; one a page.

    Args:
        model: with several surfaces the inner ones are opaque, the outermost one half transparent.
        scene: what else to show.
    """
    data = payload(model, scene or Scene())
    script = Markup("\n").join(source(f"viewer/{name}") for name in SCRIPTS)
    # a name may hold "</script>": no "<" stands in the payload
    text = Markup(json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
    return rendered("viewer/viewer.html.j2", data=data, payload=text, script=script)


def payload(model: DeformableModel | MovingModel, scene: Scene) -> dict[str, Any]:
    """Everything the page computes from, as JSON can hold it."""
    control = model.control_points if isinstance(model, MovingModel) else model.box.control_points[None]
    box = model.rest if isinstance(model, MovingModel) else model.box
    centre, reach = _extent(model)
    scale, volume_unit = LITRES.get(model.unit, (1.0, "units^3"))
    # 16 bits from the centre to the farthest point: steps of a 32767th of it, far below the noise of any data
    quantum = _reach(control, centre, scene) / 32767
    residual_quantum = _largest(scene.residuals) / 32767
    return {
        "title": scene.title,
        "unit": model.unit if model.unit != "unknown" else "units",
        "volume_unit": volume_unit,
        "volume_scale": scale,
        "axes": {"LPS": ["L", "P", "S"], "RAS": ["R", "A", "S"]}.get(model.space, ["x", "y", "z"]),
        "centre": centre.tolist(),
        "reach": reach,
        "surfaces": _surfaces(model),
        "box": {"origin": box.origin.tolist(), "edges": box.edges.tolist(), "shape": list(control.shape[1:4])},
        # 32 bits about the centre: far from the origin they would not resolve the surface
        "control": packed((control - centre).astype("<f4")),
        "time": _time(model) if isinstance(model, MovingModel) else None,
        "points": _points(scene, centre, quantum, residual_quantum),
        "quantum": quantum,
        "residual_quantum": residual_quantum,
        "errors": list(scene.errors),
        "fields": [_field(one) for one in scene.fields],
        # its volume gives the curve and the ejection fraction
        "cavity": "endo" if "endo" in model.surfaces else next(iter(model.surfaces)),
        "planes": None if scene.planes is None else [[p.tolist(), d.tolist()] for p, d in scene.planes],
    }


def _surfaces(model: DeformableModel | MovingModel) -> list[dict[str, Any]]:
    several = len(model.surfaces) > 1
    volumes = {name: float(np.prod(surface.semi_axes)) for name, surface in model.surfaces.items()}
    result = []
    for k, (name, surface) in enumerate(model.surfaces.items()):
        outer = several and volumes[name] == max(volumes.values())  # the product of semi-axes orders them well enough
        result.append(
            {
                "name": name,
                "kind": KINDS[surface.kind].record(),
                "semi_axes": surface.semi_axes.tolist(),
                "exponents": surface.exponents.tolist(),
                "rotation": surface.rotation.tolist(),
                "translation": surface.translation.tolist(),
                "hole": surface.hole_radius,
                "height": surface.height,
                "colour": COLOURS[k % len(COLOURS)],
                "alpha": 0.35 if outer else 1,
            }
        )
    return result


def _time(model: MovingModel) -> dict[str, Any]:
    breaks, pieces = model.basis.pieces()
    return {
        "breaks": breaks.tolist(),
        "pieces": pieces.transpose(1, 2, 0).tolist(),
        "period": model.basis.period,
        "frames": model.frame_times.tolist(),
    }


def _extent(model: DeformableModel | MovingModel) -> tuple[Array, float]:
    """Centre (3,) of the surfaces at all knots, and how far to look from there."""
    # between two knots the surface moves little: their extent is near enough for a view
    boxes = [model.box(t) for t in model.basis.knots] if isinstance(model, MovingModel) else [model.box]
    rest = np.concatenate([surface.grid(8)[0] for surface in model.surfaces.values()])
    points = np.concatenate([box.deform(rest) for box in boxes])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return centre, 1.15 * float(np.linalg.norm(points - centre, axis=1).max())


def _reach(control: Array, centre: Array, scene: Scene) -> float:
    clouds = [cloud for frames in scene.points.values() for cloud in frames]
    return float(max(np.abs(cloud - centre).max() for cloud in [*clouds, control.reshape(-1, 3)] if len(cloud)))


def _largest(residuals: Mapping[str, Sequence[Array]]) -> float:
    return max((float(np.abs(one).max()) for frames in residuals.values() for one in frames if len(one)), default=1.0)


def _points(scene: Scene, centre: Array, quantum: float, residual_quantum: float) -> dict[str, list[dict[str, str]]]:
    clouds = [cloud for frames in scene.points.values() for cloud in frames]
    every = max(1, -(-sum(map(len, clouds)) // MOST_POINTS))  # rounded up: at most MOST_POINTS are left
    result = {}
    for name, frames in scene.points.items():
        residuals = scene.residuals.get(name, [np.zeros(len(cloud)) for cloud in frames])
        result[name] = [
            {
                "xyz": packed(np.round((cloud[::every] - centre) / quantum).astype("<i2")),
                "residuals": packed(np.round(off[::every] / residual_quantum).astype("<i2")),
            }
            for cloud, off in zip(frames, residuals)
        ]
    return result


def _field(one: ScalarField) -> dict[str, Any]:
    """In 8 bits between the limits of its legend: the middle 98 % of what is known, even around zero if it has both."""
    known = np.concatenate([values[np.isfinite(values)] for frames in one.values.values() for values in frames])
    low, high = np.percentile(known, [1, 99]) if len(known) else (0.0, 1.0)
    if low < 0 < high:  # a signed quantity: zero is the middle of the colours
        low, high = -max(-low, high), max(-low, high)
    if not high > low:  # one value: any range of colours shows it
        high = low + 1
    coded = {name: [packed(_steps(values, low, high)) for values in frames] for name, frames in one.values.items()}
    return {
        "name": one.name,
        "unit": one.unit,
        "cells": FIELD_CELLS,
        "low": float(low),
        "high": float(high),
        "values": coded,
    }


def _steps(values: Array, low: float, high: float) -> Array:
    fraction = np.clip((np.nan_to_num(values) - low) / (high - low), 0, 1)
    # 255 stands for no value, so that 0 to 254 are left for the range
    return np.where(np.isfinite(values), np.round(STEPS * fraction), NO_VALUE).astype("u1")


def packed(values: Any) -> str:
    """The bytes of an array as text, for a page."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
