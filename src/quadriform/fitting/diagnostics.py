"""Warnings about a fit, one function and one text for each kind; each returns a mapping that is empty without cause."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.elements import Elements
from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.result import HalfSpace, Result, SuperquadricFit, rms
from quadriform.fitting.support import MOST_SLICES, Arrangement, Support, mean_thickness
from quadriform.fitting.support_settings import ONE
from quadriform.point_sets import PointSet
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import OBSERVED
from quadriform.shapes.solid import Solid
from quadriform.shapes.superquadric import Superquadric

INLIER = 0.5
"""A point of at least this probability belongs to the surface."""
MANY = 0.25
"""Where more than this fraction of the points are outliers, much of what was measured is not the surface."""
NAMED = 5
"""How many outliers are named by index."""
POOR = 0.05
"""An RMS distance above this fraction of the cloud's RMS radius is that of a poor fit."""
SCATTER = 2.0
"""Standard deviations of the mean of chi-squares that chance explains (`poor_fit`)."""
OVERLAP_RESOLUTION = 48
"""Of the mesh of a fitted body that is compared with the mask or closed mesh that it was fitted to."""
SAME_VOLUME = 0.05
"""Largest difference of the volumes of a fitted body and of the data, as a fraction: as large as the part of a surface
that may be extrapolated without a warning (`OBSERVED`)."""
MOSTLY_SUPPORTED = 0.5
"""Where data supports a smaller fraction of a surface than this, the result must not be used (UNSUPPORTED), unless the
standard deviation of the extrapolated part is below `POOR`, as that of a superquadric that was seen from one side.
Between this and `OBSERVED` there is only PARTIAL_COVERAGE; from `OBSERVED` on no warning."""
LONGER = 1.5
"""RUNAWAY: most of the length of a surface is extrapolated where it reaches beyond data by more than this many widths
of the data in the same direction. Half a body that is extrapolated from the other half reaches one width beyond it."""
SURE = 0.005
"""In RMS radii of the cloud. A surface is uncertain where its standard deviation, as RMS over its area, exceeds that of
a single point by more than this. Of exact points, with a standard deviation of zero, a model may be so uncertain."""
ROUNDING_MOVES = 5e9
"""Condition above which rounding, 2e-16 for each unit of it, may move the surface by a millionth of the RMS radius."""
THIN = 0.25
"""Noise above this fraction of a body's mean thickness leaves it open which points belong to which side."""
THICKNESS_RESOLUTION = 16
"""Of the mesh that a body's mean thickness is measured on."""
FARTHEST = 1e6
"""Control points farther from their lattice, in RMS radii of the points, leave less than nine digits to the surface."""
SAME = 1e-9
"""Superquadrics that differ by less, relative to their size, are the same but for rounding."""
NOT_CONVERGED = (WarningKind.AT_BOUND, WarningKind.MAX_ITERATIONS)
"""Of a superquadric: another order or pose of the points can then give another one, and another model."""


def named_texts(found: Mapping[str, Warnings]) -> Warnings:
    """Warnings of several surfaces as one mapping, each text under the name of its surface."""
    joined: Warnings = {}
    for name, warnings in found.items():
        for kind, text in warnings.items():
            about = text if len(found) == 1 else f"{name}: {text}"
            joined[kind] = f"{joined[kind]}; {about}" if kind in joined else about
    return joined


@dataclass(frozen=True)
class SurfaceQuality:
    """What the warnings about one surface of a model are taken from, in the centred, scaled frame.

    Attributes:
        residuals: (n,), signed distances of the points.
        inliers: (n,), probabilities.
        support: of the surface by its inliers.
        arrangement: of the points: whether they are of one surface.
        known: (n,), variances along the normals that are known of the measurement; zero where nothing is.
        independent: effective number of points.
        open_deviation: standard deviation of the part without data, as RMS over its area; infinite where not known.
    """

    residuals: Array
    inliers: Array
    support: Support
    arrangement: Arrangement
    known: Array
    independent: float
    open_deviation: float = np.inf


def model_warnings(result: Result, quality: Mapping[str, SurfaceQuality], unit: float) -> Warnings:
    """Warnings about a model in the centred, scaled frame.

    Args:
        result: with the model.
        quality: by surface.
        unit: the length of one in this frame, in the unit of the points.
    """
    found = {name: _of_surface(result, name, each, unit) for name, each in quality.items()}
    # where a kind occurs twice the later text is kept: that of the refinement itself
    return named_texts(found) | base_not_observed(result, quality) | uncertain(result, unit) | result.warnings


def _of_surface(result: Result, name: str, found: SurfaceQuality, unit: float) -> Warnings:
    counted = None if result.counted is None else result.counted[name]
    kept, surface = found.inliers >= INLIER, result.model.surfaces[name]
    return (
        outliers(found.inliers, counted)
        | poor_fit(found.residuals[kept], known=found.known[kept], independent=found.independent)
        | not_one_surface(found.arrangement, KINDS[surface.kind].cut_axis is None)
        # with a prior there is a population for parts without data: `population/diagnostics.py`
        | (unsupported(found.support.scaled(unit), found.open_deviation) if result.prior_distance is None else {})
        | _outside_lattice(result.model, surface)
    )


def not_one_surface(found: Arrangement, is_closed: bool) -> Warnings:
    """SEVERAL_BODIES, DOUBLE_WALL or FILLED_VOLUME where points are not of one surface, which may have no inside."""
    warnings: Warnings = {}
    if found.bodies > 1:
        warnings[WarningKind.SEVERAL_BODIES] = (
            f"the points are of {found.bodies} closed bodies with nothing between them, and the surface is of one of "
            "them or around several: fit each alone"
        )
    if found.layered > ONE.layered:
        warnings[WarningKind.DOUBLE_WALL] = (
            "the points form two layers, one inside the other, such as both sides of a wall: fit them as two surfaces"
        )
    elif is_closed and found.filled > ONE.most:
        warnings[WarningKind.FILLED_VOLUME] = (
            f"{100 * found.filled:.0f} % of the points are deep inside, as of a filled volume: take its boundary only"
        )
    return warnings


def low_overlap(model: DeformableModel, sets: Mapping[str, PointSet], base: BasePlane | None) -> Warnings:
    """LOW_OVERLAP where the inside of a surface is not that of the mask or closed mesh that it was fitted to.

    Nothing is compared beyond a base; the model is in the world, and the bodies are those of the point sets.
    """
    return named_texts(
        {
            name: _low_overlap(model.mesh(name, OVERLAP_RESOLUTION), each.solid, base)
            for name, each in sets.items()
            if each.solid is not None and KINDS[model.surfaces[name].kind].cut_axis is None
        }
    )


def _low_overlap(mesh: Mesh, solid: Solid, base: BasePlane | None) -> Warnings:
    found = solid.overlap(mesh, base)
    if found.dice >= solid.least_dice and abs(found.larger) <= SAME_VOLUME + found.uncertain:
        return {}
    text = (
        f"the surface encloses another body than that of the data: they overlap by a Dice of {found.dice:.2f}, "
        f"expected {solid.least_dice} or more, and its volume is {abs(found.larger):.0%} "
        f"{'larger' if found.larger > 0 else 'smaller'}; a wall or a capsule has two sides, each a surface of its own, "
        "and branches or thin parts may need a larger box"
    )
    return {WarningKind.LOW_OVERLAP: text}


def unsupported(found: Support, open_deviation: float = np.inf) -> Warnings:
    """PARTIAL_COVERAGE where data does not support a surface, with UNSUPPORTED or RUNAWAY where it must not be used.

    Args:
        found: in the unit of the points.
        open_deviation: standard deviation of the part without data, in RMS radii of the points.
    """
    if not found.has_data:
        return {
            WarningKind.PARTIAL_COVERAGE: "the whole surface is extrapolated",
            WarningKind.UNSUPPORTED: "all points are isolated: none has two others near it, which could confirm it",
        }
    distance, width = found.reach.distance, found.reach.width
    part = "volume below the base is under surface that" if found.by_volume else "surface"
    text = (
        f"{100 * (1 - found.within):.0f} % of the {part} is farther than {found.limit:.3g} from all data, and the "
        f"surface reaches {distance:.3g} beyond it; there the surface is extrapolated"
    )
    is_covered = found.within >= OBSERVED and distance <= found.limit
    warnings = _not_checked_between(found.slices) if is_covered else {WarningKind.PARTIAL_COVERAGE: text}
    if found.within < MOSTLY_SUPPORTED and open_deviation > POOR:
        known = f", and the rest is known to {100 * open_deviation:.2g} % of the cloud's RMS radius"
        text = f"data supports {100 * found.within:.0f} % of the {'volume' if found.by_volume else 'area'} only"
        warnings[WarningKind.UNSUPPORTED] = text + known if np.isfinite(open_deviation) else text
    if distance > max(LONGER * width, found.limit):
        warnings[WarningKind.RUNAWAY] = f"the surface reaches {distance:.3g} beyond data that is {width:.3g} wide there"
    return warnings


def _not_checked_between(slices: int) -> Warnings:
    """PARTIAL_COVERAGE where all points lie in a few slices, of which the number is given, else 0."""
    text = (
        f"the points lie in {slices} parallel slices, and nothing checks the shape between them; expected "
        f"{MOST_SLICES + 1} or more, or contours across them"
    )
    return {WarningKind.PARTIAL_COVERAGE: text} if slices else {}


def base_not_observed(result: Result, quality: Mapping[str, SurfaceQuality]) -> Warnings:
    """BASE_NOT_OBSERVED, a note, where a base ends the data: the share of the closed surfaces that is not observed."""
    if result.half_space is None:
        return {}
    fractions = [f"{name} {100 * (1 - each.support.area):.0f} %" for name, each in quality.items()]
    text = f"beyond the base the surface is not observed; share of the area without data: {', '.join(fractions)}"
    return {WarningKind.BASE_NOT_OBSERVED: text}


def uncertain(result: Result, unit: float) -> Warnings:
    """UNCERTAIN where the surfaces are known less well than the noise of single points."""
    if result.covariance is None or result.sigma is None or result.prior_distance is not None:
        return {}
    deviation = rms_deviation(result.model, result.covariance, result.half_space)
    text = (
        f"the surface is known to {unit * deviation:.2g} only (one standard deviation), a single point to "
        f"{unit * result.sigma:.2g}: there are too few points for so many control points"
    )
    return {WarningKind.UNCERTAIN: text} if deviation > result.sigma + SURE else {}


def rms_deviation(model: DeformableModel, covariance: Array, half_space: HalfSpace | None) -> float:
    """Standard deviation of the surfaces along their normals, as RMS over their area outside the half-space.

    Args:
        model: in the frame of the covariance.
        covariance: (3 k, 3 k) of the control points.
        half_space: where no data is expected.
    """
    squares, total = 0.0, 0.0
    for name in model.surfaces:
        elements = Elements.of(model, name, half_space)
        squares += float(elements.areas @ elements.variances(model, covariance))
        total += float(elements.areas.sum())
    return float(np.sqrt(squares / total)) if total else 0.0


def outliers(inliers: Array, counted: NDArray[np.bool_] | None = None) -> Warnings:
    """OUTLIERS where points (n,) that count, all by default, are not of the surface, or MANY_OUTLIERS."""
    counted = np.ones(len(inliers), dtype=np.bool_) if counted is None else counted
    found = np.flatnonzero((inliers < INLIER) & counted)
    if not len(found):
        return {}
    first = ", ".join(map(str, found[:NAMED])) + (", ..." if len(found) > NAMED else "")
    kind = WarningKind.MANY_OUTLIERS if len(found) > MANY * counted.sum() else WarningKind.OUTLIERS
    return {kind: f"{len(found)} of {len(inliers)} points are outliers: {first}"}


def duplicates(copies: int, count: int) -> Warnings:
    """DUPLICATES where some of the points are copies of others."""
    text = f"{copies} of {count} points are copies of others and were counted as weights"
    return {WarningKind.DUPLICATES: text} if copies else {}


def poor_fit(
    distances: Array, limit: float = POOR, known: Array | float = 0.0, independent: float = np.inf
) -> Warnings:
    """POOR_FIT where inliers are farther from the surface than a limit and what is known of their noise explain.

    It is a poor fit where mean_i d_i^2 / (limit^2 + v_i (1 + 2 sqrt(2 / N))) > 1, with the distances d_i, their known
    variances v_i and the number N of independent points. The mean square of N independent errors has a relative
    standard deviation of sqrt(2 / N), so the v_i are enlarged by `SCATTER` = 2 of these. The points of a mask with long
    voxels may be a tenth of a small body away from its surface; as these variances are known, that is no poor fit.

    Args:
        distances: d_i (n,), of the inliers, in RMS radii of the cloud; without inliers the fit is poor.
        limit: of the RMS distance of points without noise.
        known: v_i (n,), variances along the normals that are known of the measurement, or zero.
        independent: N, the effective number of points.
    """
    explained = known * (1 + SCATTER * np.sqrt(2 / max(independent, 1.0)))
    relative, noise = (rms(distances), float(np.sqrt(np.mean(known)))) if len(distances) else (1.0, 0.0)
    text = (
        f"the RMS distance of the inliers is {100 * relative:.1f} % of the cloud's RMS radius"
        f"{f', their known noise {100 * noise:.1f} %' if noise else ''}: are the points one closed surface, without "
        "inner walls, filled volumes or other bodies?"
    )
    is_poor = not len(distances) or float((distances**2 / (limit**2 + explained)).mean()) > 1
    return {WarningKind.POOR_FIT: text} if is_poor else {}


def max_error_missed(side: int, error: float, sigma: float) -> Warnings:
    """POOR_FIT of the largest box, whose error and the noise are given in units of `max_error`."""
    text = (
        f"no box up to {side} control points a side reached max_error: the last one's error is {error:.2f} times it, "
        f"the noise of the points {sigma:.2f} times"
    )
    return {WarningKind.POOR_FIT: text}


def _outside_lattice(model: DeformableModel, surface: Superquadric) -> Warnings:
    local = model.box.local(surface.grid(12)[0])
    outside = float(((local < -1e-9) | (local > 1 + 1e-9)).any(axis=1).mean())
    return {WarningKind.OUTSIDE_LATTICE: f"{100 * outside:.0f} % of the surface is beyond the box"} if outside else {}


def smoother_than_data(sigma: float, before: float) -> Warnings:
    """POOR_FIT of surfaces that are much farther from the points than those of the map before its folds were removed.

    Args:
        sigma: standard deviation of the inliers' residuals, in RMS radii of the cloud.
        before: that of the map that folds.
    """
    text = (
        f"folds were removed by a smoother map, whose surfaces are {sigma / before:.1f} times as far from the points: "
        f"{100 * sigma:.1f} % of the cloud's RMS radius; a larger box may follow the points"
    )
    return {WarningKind.POOR_FIT: text}


def folding(model: DeformableModel) -> Warnings:
    """FOLDING of a model whose map is not verified to be free of folds."""
    crossed = ", ".join(" and ".join(dict.fromkeys(pair)) for pair in model.crossings())
    end = f"crossing: {crossed}" if crossed else "no surface crosses itself or another"
    text = f"the map is not verified to be free of folds: it folds at {len(model.folds())} sampled points; {end}"
    return {WarningKind.FOLDING: text}


def ill_conditioned(model: DeformableModel, solution: Solution, noise: float) -> Warnings:
    """ILL_CONDITIONED of bodies too thin for the noise of their points, or of a solution that rounding moves."""
    if thin := _thin(model, noise):
        text = (
            f"{', '.join(thin)}: their sides are not distinguished and volumes mean nothing; expected 4 times or more"
        )
        return {WarningKind.ILL_CONDITIONED: text}
    text = (
        f"at strength {solution.strength:g} rounding may move the surface by more than a millionth of its size, "
        f"condition {solution.condition:.1e}; try a larger strength, or fewer control points"
    )
    return {} if solution.condition < ROUNDING_MOVES else {WarningKind.ILL_CONDITIONED: text}


def _thin(model: DeformableModel, sigma: float) -> list[str]:
    """A text for each body so thin that the noise does not distinguish its two sides."""
    texts = []
    for name, surface in model.surfaces.items():
        mesh = model.mesh(name, THICKNESS_RESOLUTION)
        thickness = mean_thickness(mesh)
        if KINDS[surface.kind].cut_axis is None and sigma > THIN * thickness:
            about = "the body" if len(model.surfaces) == 1 else name
            texts.append(f"{about} is {thickness / sigma:.3g} times as thick as the noise of the points")
    return texts


def far_control_points(model: DeformableModel) -> Warnings:
    """ILL_CONDITIONED where control points are so far from their lattice that rounding moves the surface.

    Args:
        model: in units of the RMS radius of its points.
    """
    farthest = float(np.abs(model.box.control_points - model.box.rest).max())
    text = (
        f"control points are up to {farthest:.0e} RMS radii from their lattice, as near an ellipsoid, on which many "
        "of their motions cancel; rounding moves the surface. Use fewer singular values, as by strength=1e-6"
    )
    return {WarningKind.ILL_CONDITIONED: text} if farthest > FARTHEST else {}


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
    return np.abs(lengths).max() < SAME * (size + np.abs(one.translation).max()) and np.allclose(
        one.exponents, other.exponents, rtol=0, atol=SAME
    )
