"""The front doors: points in, a model out, in one call or in two steps."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, WarningKind, Warnings, choose
from quadriform.fitting.coverage import coverage_warning
from quadriform.fitting.outcome import Fit, Iteration, Progress, flat
from quadriform.fitting.refinement import PaperOptions, two_step
from quadriform.fitting.regularity import Regulariser
from quadriform.fitting.superquadric_fit import fit_superquadric
from quadriform.points import Array, Frame, check_points, check_spread
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

ALONE = "surface"
"""The name of the surface when there is only one."""
POOR = 0.05
"""An RMS distance above this share of the cloud's RMS radius is called a poor fit."""

Clouds = ArrayLike | Mapping[str, ArrayLike]


def fit(
    points: Clouds,
    *,
    kind: str = "ellipsoid",
    method: str = "paper",
    progress: Progress | None = None,
    **options: object,
) -> Fit:
    """Fit a superquadric, and refine it by a free-form deformation.

    Args:
        points: (n, 3) points around a body in any unit and frame, or several clouds by name, which then share one
            control box, that of the outermost.
        kind: of superquadric: "ellipsoid", "toroid", "hyperboloid1" or "hyperboloid2".
        method: "paper": Bardinet, Cohen and Ayache 1998.
        progress: called with (steps done, steps in all).
        **options: as in `refine`.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    clouds = _named(points)
    choose(method, ("paper",), "method")
    fits = {name: fit_superquadric(cloud, kind, method) for name, cloud in clouds.items()}
    refined = refine({name: f.superquadric for name, f in fits.items()}, clouds, progress=progress, **options)  # type: ignore[arg-type]
    warnings: Warnings = {}
    for name, found in fits.items():
        for warning, text in found.warnings.items():
            warnings[warning] = "; ".join(filter(None, [warnings.get(warning), _about(name, text)]))
    return replace(refined, warnings=warnings | refined.warnings)


def refine(
    superquadric: Superquadric | Mapping[str, Superquadric],
    points: Clouds,
    *,
    box: tuple[int, int, int] = (5, 5, 5),
    regularity: str | Regulariser = "springs",
    strength: float | str = "auto",
    matching: str = "data-to-model",
    iterations: int = 30,
    tolerance: float | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Refine superquadric(s) by the paper's two-step iteration.

    Args:
        superquadric: where to start from; a mapping when `points` is one, with the same names.
        points: (n, 3), or several clouds by name.
        box: control points along each axis, each at least 2.
        regularity: "springs" (on the displacement of the control points), "springs-paper" (P9 to the letter), "svd"
            (P8), "svd-position", or an object with one method `matrix(shape)`, held on the displacement.
        strength: alpha of P9 per data point; for the SVD a count (>= 1) or a threshold (< 1) of singular values.
        matching: "data-to-model" (each data point's closest model point) or "model-to-data".
        iterations: how many; 30 in the paper.
        tolerance: stop when the surface moves less than this share of the cloud's RMS radius.
        progress: called with (steps done, steps in all).

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    clouds = _named(points)
    surfaces = {ALONE: superquadric} if isinstance(superquadric, Superquadric) else dict(superquadric)
    if surfaces.keys() != clouds.keys():
        raise OptionError(f"surfaces {sorted(surfaces)} and points {sorted(clouds)} must have the same names")
    chosen = PaperOptions(check_box(box), regularity, strength, matching, iterations, tolerance)
    frame = Frame.of(np.concatenate(list(clouds.values())))
    local_clouds = {name: frame.to_local(cloud) for name, cloud in clouds.items()}
    local = {name: _in_frame(surface, frame) for name, surface in surfaces.items()}
    deformed, history, used = two_step(local, local_clouds, chosen, progress)
    model = DeformableModel(local, deformed)
    placed = replace(model.placed(frame.scale, frame.centre), input_sha256=_hash(clouds))
    before = DeformableModel(local, deformed.with_control_points(deformed.rest))
    residuals = {name: frame.scale * model.distance(cloud, name) for name, cloud in local_clouds.items()}
    first = {name: frame.scale * before.distance(cloud, name) for name, cloud in local_clouds.items()}
    return Fit(
        model=placed,
        warnings=_warnings(model, local_clouds, residuals, frame),
        residuals=_unnamed(residuals),
        superquadric_residuals=_unnamed(first),
        history=tuple(_scaled(record, frame.scale) for record in history),
        strength=used,
    )


def check_box(box: object) -> tuple[int, int, int]:
    """Three counts of control points.

    Raises:
        OptionError: not three whole numbers from 2 to 20.
    """
    sides = tuple(box) if isinstance(box, (tuple, list)) else ()
    if len(sides) != 3 or not all(isinstance(n, (int, np.integer)) and 2 <= n <= 20 for n in sides):
        raise OptionError(
            f"option box={box!r} is out of range; expected three whole numbers from 2 to 20, as (5, 5, 5)"
        )
    return int(sides[0]), int(sides[1]), int(sides[2])


def _named(points: Clouds) -> dict[str, Array]:
    given = points if isinstance(points, Mapping) else {ALONE: points}
    if not given:
        raise OptionError("points: an empty mapping; expected at least one named cloud")
    clouds = {str(name): check_points(cloud, _about(str(name), "points")) for name, cloud in given.items()}
    for cloud in clouds.values():
        check_spread(cloud, needed=11)
    return clouds


def _about(name: str, text: str) -> str:
    return text if name == ALONE else f"{name}: {text}"


def _unnamed(residuals: dict[str, Array]) -> Array | dict[str, Array]:
    return residuals[ALONE] if residuals.keys() == {ALONE} else residuals


def _hash(clouds: Mapping[str, Array]) -> str:
    """SHA-256 of the points as float64 rows, surface after surface; a reader of a file puts the file's own instead."""
    return hashlib.sha256(b"".join(cloud.tobytes() for cloud in clouds.values())).hexdigest()


def _in_frame(surface: Superquadric, frame: Frame) -> Superquadric:
    return surface.placed(1 / frame.scale, -frame.centre / frame.scale)


def _scaled(record: Iteration, scale: float) -> Iteration:
    return Iteration(
        error=scale * record.error,
        box_motion=scale * record.box_motion,
        box_displacement=scale * record.box_displacement,
        surface_motion=scale * record.surface_motion,
    )


def _warnings(model: DeformableModel, clouds: dict[str, Array], residuals: dict[str, Array], frame: Frame) -> Warnings:
    """Warnings about a refined model, in the centred, scaled frame; the residuals are in the unit of the data."""
    warnings: Warnings = {}
    share = float(np.sqrt((flat(residuals) ** 2).mean())) / frame.scale
    if share > POOR:
        warnings[WarningKind.POOR_FIT] = (
            f"the RMS distance is {100 * share:.1f} % of the cloud's RMS radius; is it one closed surface, without "
            "inner walls, filled volumes or strangers?"
        )
    thin = [text for name, cloud in clouds.items() if (text := coverage_warning(model.surfaces[name], cloud))]
    if thin:
        warnings[WarningKind.PARTIAL_COVERAGE] = "; ".join(_about(name, t) for name, t in zip(clouds, thin))
    outside = {name: _outside(model.box, surface) for name, surface in model.surfaces.items()}
    if max(outside.values()) > 0:
        named = ", ".join(f"{name} {100 * part:.0f} %" for name, part in outside.items() if part)
        warnings[WarningKind.OUTSIDE_LATTICE] = f"surface points beyond the box of the outer surface: {named}"
    return warnings


def _outside(box: ControlBox, surface: Superquadric) -> float:
    local = box.local(surface.grid(12)[0])
    return float(((local < -1e-9) | (local > 1 + 1e-9)).any(axis=1).mean())
