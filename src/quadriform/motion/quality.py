"""What the data of each frame supports, and the warnings about the frames of a motion."""

from collections.abc import Mapping, Sequence

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
from quadriform.fitting.noise import sampling_step
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
    return named_texts({name: _least_supported([each[name] for each in frames]) for name in frames[0]})


def _least_supported(frames: Sequence[Support]) -> Warnings:
    """The same warnings about one surface."""
    found: Warnings = {}
    # the least supported frame first: its texts are kept
    for frame in sorted(range(len(frames)), key=lambda number: frames[number].within):
        found = {kind: f"frame {frame}: {text}" for kind, text in unsupported(frames[frame]).items()} | found
    return found


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
