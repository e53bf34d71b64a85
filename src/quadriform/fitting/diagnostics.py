"""What is to be said of a refined model."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.coverage import coverage_warning, covered_share
from quadriform.fitting.refinement.refine import Result
from quadriform.fitting.refinement.unfolding import POOR
from quadriform.fitting.result import SuperquadricFit, rms
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

STRANGER = 0.5
NAMED = 5
NOT_CONVERGED = (WarningKind.AT_BOUND, WarningKind.MAX_ITERATIONS)
"""Of a superquadric: another order or pose of the points can then give another one, and another model."""
ROUNDING = 1e-9


def named_texts(found: Mapping[str, Warnings]) -> Warnings:
    """Warnings of several surfaces as one mapping, each text under the name of its surface."""
    joined: Warnings = {}
    for name, warnings in found.items():
        for kind, text in warnings.items():
            about = text if len(found) == 1 else f"{name}: {text}"
            joined[kind] = f"{joined[kind]}; {about}" if kind in joined else about
    return joined


def fit_warnings(
    result: Result, clouds: Mapping[str, Array], residuals: Mapping[str, Array], inliers: Mapping[str, Array]
) -> Warnings:
    """Warnings about a model, its points and their distances, all in the centred, scaled frame."""
    found = {name: _of_surface(result, name, cloud, residuals[name], inliers[name]) for name, cloud in clouds.items()}
    return named_texts(found) | result.warnings


def coverages(result: Result, clouds: Mapping[str, Array], inliers: Mapping[str, Array]) -> dict[str, float]:
    """Share [0, 1] of the directions from the centre that have inliers, of each superellipsoid, by its name."""
    kept = {name: cloud[inliers[name] >= STRANGER] for name, cloud in clouds.items()}
    bodies = {name: body for name, body in result.model.surfaces.items() if body.kind == "ellipsoid"}
    return {n: covered_share(body, kept[n], result.beyond) if len(kept[n]) else 0.0 for n, body in bodies.items()}


def start_notes(starts: Mapping[str, SuperquadricFit], model: DeformableModel) -> tuple[str, ...]:
    """Notes on superquadrics that did not converge and that a model in the same unit still starts from."""
    kept = {name: start for name, start in starts.items() if _same(start.superquadric, model.surfaces[name])}
    return tuple(
        f"{f'{name}: ' if len(starts) > 1 else ''}the superquadric that the fit starts from: {kind}: {text}"
        for name, start in kept.items()
        for kind, text in start.warnings.items()
        if kind in NOT_CONVERGED
    )


def _same(one: Superquadric, other: Superquadric) -> bool:
    """Whether two superquadrics are one but for rounding."""
    size = float(one.semi_axes.max())
    lengths = np.concatenate([one.semi_axes - other.semi_axes, one.translation - other.translation])
    return np.abs(lengths).max() < ROUNDING * (size + np.abs(one.translation).max()) and np.allclose(
        one.exponents, other.exponents, rtol=0, atol=ROUNDING
    )


def _of_surface(result: Result, name: str, cloud: Array, residuals: Array, inliers: Array) -> Warnings:
    warnings: Warnings = {}
    counted = np.ones(len(cloud), dtype=bool) if result.counted is None else result.counted[name]
    kept = inliers >= STRANGER
    warnings |= outliers(inliers, counted)
    share = rms(residuals[kept]) if kept.any() else 1.0
    if share > POOR:
        warnings[WarningKind.POOR_FIT] = (
            f"the RMS distance is {100 * share:.1f} % of the cloud's RMS radius; is it one closed surface, without "
            "inner walls, filled volumes or other bodies?"
        )
    surface = result.model.surfaces[name]
    thin = coverage_warning(surface, cloud[kept], result.beyond) if kept.any() else "no point is near the surface"
    if thin and not result.covered:
        warnings[WarningKind.PARTIAL_COVERAGE] = thin
    elif name in result.ends:
        warnings[WarningKind.PARTIAL_COVERAGE] = (
            "the points end at an edge, beyond which the surface is the model's guess; if it is a base, say so (base=)"
        )
    outside = _outside(result.model.box, surface)
    if outside > 0:
        warnings[WarningKind.OUTSIDE_LATTICE] = f"{100 * outside:.0f} % of the surface is beyond the box"
    return warnings


def outliers(inliers: Array, counted: NDArray[np.bool_]) -> Warnings:
    """The warning about points (n,) that count and are not of the surface, if there are any."""
    strangers = np.flatnonzero(counted & (inliers < STRANGER))
    if not len(strangers):
        return {}
    first = ", ".join(map(str, strangers[:NAMED])) + (", ..." if len(strangers) > NAMED else "")
    return {WarningKind.OUTLIERS: f"{len(strangers)} of {len(inliers)} points are not of the surface: {first}"}


def _outside(box: ControlBox, surface: Superquadric) -> float:
    local = box.local(surface.grid(12)[0])
    return float(((local < -1e-9) | (local > 1 + 1e-9)).any(axis=1).mean())
