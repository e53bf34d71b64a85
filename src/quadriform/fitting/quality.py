"""Quality of the surfaces of a refinement: what supports them, and from what warnings about them are taken."""

from collections.abc import Mapping

import numpy as np

from quadriform.fitting.cloud import effective_fraction
from quadriform.fitting.diagnostics import INLIER, SurfaceQuality
from quadriform.fitting.extrapolation import open_deviations
from quadriform.fitting.noise import sampling_step, variances_along
from quadriform.fitting.result import Result
from quadriform.fitting.support import LIMITS, Sampled, Support, support_of
from quadriform.points import Array
from quadriform.shapes.closest import FootPoints
from quadriform.shapes.landmarks import BasePlane


def support_of_each(
    result: Result,
    clouds: Mapping[str, Array],
    feet: Mapping[str, FootPoints],
    inliers: Mapping[str, Array],
    sigma: float,
    noise: Mapping[str, Array],
) -> dict[str, Support]:
    """How far the inliers of each cloud, of standard deviation `sigma`, support its surface."""
    base, found = None if result.half_space is None else BasePlane(*result.half_space), dict[str, Support]()
    for name, cloud in clouds.items():
        kept, mesh = inliers[name] >= INLIER, result.model.mesh(name, LIMITS.resolution)
        step = sampling_step(noise.get(name))
        found[name] = support_of(mesh, cloud[kept], feet[name].points[kept], sigma, base, step)
    return found


def qualities(
    result: Result,
    feet: Mapping[str, FootPoints],
    inliers: Mapping[str, Array],
    support: Mapping[str, Support],
    clouds: Mapping[str, Array],
    noise: Mapping[str, Array],
) -> dict[str, SurfaceQuality]:
    """The quality of each surface, from which warnings about it are taken."""
    sampled = _sampled(result, clouds, feet, support)
    deviations = open_deviations(result, support, {n: each.points[inliers[n] >= INLIER] for n, each in feet.items()})
    found = {}
    for name, each in feet.items():
        known, deviation = _known(noise.get(name), each, inliers[name]), deviations.get(name, np.inf)
        found[name] = SurfaceQuality(each.signed, inliers[name], support[name], sampled[name], *known, deviation)
    return found


def _known(noise: Array | None, feet: FootPoints, inliers: Array) -> tuple[Array, float]:
    """Variances (n,) of points along the normals that are known, or zeros, and how many errors are independent."""
    if noise is None or not inliers.any():
        return np.zeros(len(inliers)), np.inf
    known = variances_along(noise, feet.normals)
    return known, float(inliers.sum()) * effective_fraction(feet.points, feet.signed / np.sqrt(known), inliers)


def _sampled(
    result: Result,
    clouds: Mapping[str, Array],
    feet: Mapping[str, FootPoints],
    support: Mapping[str, Support],
) -> dict[str, Sampled]:
    """Whether the points of each cloud that have a weight are of one surface."""
    found = {}
    for name, cloud in clouds.items():
        counted = np.ones(len(cloud), dtype=np.bool_) if result.counted is None else result.counted[name]
        points, nearest, signed = cloud[counted], feet[name].points[counted], feet[name].signed[counted]
        mesh = result.model.mesh(name, LIMITS.resolution)
        found[name] = Sampled.of(mesh, points, nearest, signed, support[name].limit)
    return found
