"""What the data of each frame supports, and the warnings about the frames of a motion."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.diagnostics import (
    INLIER,
    folding,
    named_texts,
    outliers,
    poor_fit,
    smoother_than_data,
    unsupported,
)
from quadriform.fitting.elements import Elements
from quadriform.fitting.noise import sampling_step
from quadriform.fitting.population.diagnostics import from_population
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.fitting.refinement.unfolding import accepted_sigma
from quadriform.fitting.support import Support, support_of
from quadriform.fitting.support_settings import LIMITS
from quadriform.motion.cycle import CycleFit
from quadriform.points import Array, Frame
from quadriform.shapes.closest import FootPoints
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.model import DeformableModel


def support_of_frame(
    model: DeformableModel,
    datasets: Mapping[str, SurfaceData],
    feet: Mapping[str, FootPoints],
    normalisation: Frame,
    sigma: float,
    base: BasePlane | None,
    noise: Mapping[str, Array],
) -> dict[str, Support]:
    """How far the inliers of one frame support its surfaces, by name.

    Args:
        model: of the frame, in the unit of the points.
        datasets: name -> data with inlier probabilities, in centred, scaled coordinates.
        feet: name -> the points of the surface nearest to the data, in the unit of the points.
        normalisation: the coordinates of the data.
        sigma: standard deviation of the points, in their unit.
        base: where the data ends on purpose, in the unit of the points.
        noise: name -> covariances (n, 3, 3) that are known of the points, in their unit.
    """
    found = dict[str, Support]()
    for name, data in datasets.items():
        kept, nearest = data.inliers >= INLIER, feet[name]
        mesh, step = model.mesh(name, LIMITS.resolution), sampling_step(noise.get(name))
        found[name] = support_of(
            mesh, normalisation.to_world(data.points[kept]), nearest.points[kept], sigma, base, step
        )
    return found


def cycle_warnings(
    models: Sequence[DeformableModel], feet: Sequence[Mapping[str, FootPoints]], found: CycleFit, scale: float
) -> Warnings:
    """The warnings about the surfaces of a cycle; `scale` is the RMS radius, in the unit of the points."""
    result = []
    for model, nearest, datasets, verified in zip(models, feet, found.datasets, found.verified):
        each = {n: outliers(data.inliers) | _poor_fit(data, nearest[n], found, scale) for n, data in datasets.items()}
        result.append(named_texts(each) | ({} if verified else folding(model)))
    return fold_removal_warnings(found) | by_frame(result)


def fold_removal_warnings(found: CycleFit) -> Warnings:
    """POOR_FIT where the removal of folds made the noise larger than is accepted; else none."""
    before = found.sigma_before
    if before is None or found.sigma <= accepted_sigma(before):
        return {}
    return smoother_than_data(found.sigma, before)


def _poor_fit(data: SurfaceData, nearest: FootPoints, found: CycleFit, scale: float) -> Warnings:
    kept = data.inliers >= INLIER
    known = found.least_sigma**2 * data.known_variances(nearest.normals)
    return poor_fit(nearest.signed[kept] / scale, known=known[kept])


def support_warnings(frames: Sequence[Mapping[str, Support]]) -> Warnings:
    """PARTIAL_COVERAGE, UNSUPPORTED and RUNAWAY of the frames, by the one that is supported least."""
    return _least_supported(frames, [{name: unsupported(each) for name, each in frame.items()} for frame in frames])


def support_warnings_of_members(
    models: Sequence[DeformableModel],
    frames: Sequence[Mapping[str, Support]],
    feet: Sequence[Mapping[str, FootPoints]],
    found: CycleFit,
    scale: float,
) -> Warnings:
    """PARTIAL_COVERAGE and UNSUPPORTED of the frames of a member of a population, by the one that is supported least.

    Args:
        models: of the frames, with their posteriors.
        frames: the support of their surfaces.
        feet: the points of the surfaces nearest to the data.
        found: the cycle.
        scale: the RMS radius of the points.
    """
    result = []
    for model, frame, nearest, datasets in zip(models, frames, feet, found.datasets):
        result.append(dict[str, Warnings]())
        for name, support in frame.items():
            kept = nearest[name].points[datasets[name].inliers >= INLIER]
            result[-1][name] = from_population(support, _open_deviation(model, name, kept, support.limit) / scale)
    return _least_supported(frames, result)


def _open_deviation(model: DeformableModel, name: str, data: Array, limit: float) -> float:
    """The standard deviation of the part of a surface without data by its posterior, as RMS over its area.

    Args:
        model: of one frame.
        name: of the surface.
        data: (n, 3), its points nearest to the inliers.
        limit: distance from these beyond which there is no data.
    """
    elements, samples = Elements.of(model, name, None), model.posterior
    is_open = np.ones(len(elements.points), dtype=np.bool_)
    if len(data):
        is_open = cKDTree(data).query(elements.points)[0] > limit
    areas = elements.areas * is_open
    if samples is None or not areas.any():
        return 0.0
    deviations = samples.deviations.reshape(len(samples), -1, 3)
    moved = np.einsum("nk,ski,ni->sn", model.box.matrix(elements.origins), deviations, elements.normals, optimize=True)
    return float(np.sqrt(areas @ (moved**2).mean(axis=0) / areas.sum()))


def _least_supported(frames: Sequence[Mapping[str, Support]], found: Sequence[Mapping[str, Warnings]]) -> Warnings:
    """The warnings of all frames as one mapping; of each kind the text of the frame that is supported least."""
    result = dict[str, Warnings]()
    for name in frames[0]:
        result[name] = {}
        # the least supported frame first: its texts are kept
        for frame in sorted(range(len(frames)), key=lambda number: frames[number][name].within):
            result[name] = {kind: f"frame {frame}: {text}" for kind, text in found[frame][name].items()} | result[name]
    return named_texts(result)


def by_frame(found: Sequence[Warnings]) -> Warnings:
    """Warnings of all frames as one mapping; each text names its frames."""
    joined: dict[WarningKind, dict[str, list[int]]] = {}
    for frame, warnings in enumerate(found):
        for kind, text in warnings.items():
            joined.setdefault(kind, {}).setdefault(text, []).append(frame)
    return {
        kind: "; ".join(f"frame{'s'[: len(at) > 1]} {', '.join(map(str, at))}: {text}" for text, at in texts.items())
        for kind, texts in joined.items()
    }
