"""What is to be said of a refined model."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.coverage import coverage_warning
from quadriform.fitting.outcome import rms
from quadriform.fitting.tangent_fit import Result
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

POOR = 0.05
"""An RMS distance of the inliers above this share of the cloud's RMS radius is called a poor fit."""
STRANGER = 0.5
NAMED = 5


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
