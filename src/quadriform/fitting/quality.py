"""Assessment of a refinement: distances of the points, how far they support each surface, and the warnings that follow.

All is in the centred, scaled frame and by the name of the surface. `inliers` are probabilities (n,): points of at least
`INLIER` count as inliers. `noise` are the covariances (n, 3, 3) of points whose errors are known; `sigma` is the
estimated standard deviation of the points along the normal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from quadriform.errors import Warnings
from quadriform.fitting.cloud import effective_fraction_of_points
from quadriform.fitting.diagnostics import INLIER, SurfaceQuality, model_warnings
from quadriform.fitting.extrapolation import open_deviations
from quadriform.fitting.noise import sampling_step, variances_along
from quadriform.fitting.population.diagnostics import open_deviations_with_prior, population_warnings
from quadriform.fitting.result import Result, rms
from quadriform.fitting.support import Arrangement, Support, covered_fraction, support_of
from quadriform.fitting.support_settings import LIMITS
from quadriform.points import Array
from quadriform.shapes.closest import FootPoints, closest_on
from quadriform.shapes.landmarks import BasePlane


@dataclass(frozen=True)
class Assessment:
    """The assessment of a refinement by its points.

    Attributes:
        feet: the points of the surfaces nearest to all points.
        superquadric_residuals: (n,), signed distances to the superquadrics before refinement.
        inliers: (n,), one where none were estimated.
        sigma: the RMS distance where none was estimated.
        support: how far inliers support the surface.
        coverage: fraction of the directions from the centre with inliers, of surfaces around their centre.
        warnings: about the model, with lengths in the unit of the points.
    """

    feet: dict[str, FootPoints]
    superquadric_residuals: dict[str, Array]
    inliers: dict[str, Array]
    sigma: float
    support: dict[str, Support]
    coverage: dict[str, float]
    warnings: Warnings

    @classmethod
    def of(cls, result: Result, clouds: Mapping[str, Array], noise: Mapping[str, Array], unit: float) -> Assessment:
        """From points (n, 3) and covariances (n, 3, 3) by name; `unit` is the length of one in that of the points."""
        model = result.model
        boxes = model.box, model.box.with_control_points(model.box.rest)
        feet, before = ({n: closest_on(model.surfaces[n], box, cloud) for n, cloud in clouds.items()} for box in boxes)
        inliers = result.inliers or {name: np.ones(len(cloud)) for name, cloud in clouds.items()}
        sigma = result.sigma if result.sigma is not None else rms({name: each.signed for name, each in feet.items()})
        support = support_of_each(result, clouds, feet, inliers, sigma, noise)
        quality = qualities(result, feet, inliers, support, clouds, noise)
        coverage = {
            name: covered_fraction(model.surfaces[name], cloud[inliers[name] >= INLIER], result.half_space)
            for name, cloud in clouds.items()
            if model.surfaces[name].is_radial
        }
        before_refinement = {name: each.signed for name, each in before.items()}
        warnings = model_warnings(result, quality, unit) | population_warnings(result, quality, unit)
        return cls(feet, before_refinement, inliers, sigma, support, coverage, warnings)

    @property
    def residuals(self) -> dict[str, Array]:
        """Signed distances (n,) of the points to the surfaces, negative inside."""
        return {name: each.signed for name, each in self.feet.items()}

    @property
    def feet_of_inliers(self) -> dict[str, Array]:
        """The points (k, 3) of the surfaces nearest to inliers."""
        return _feet_of_inliers(self.feet, self.inliers)


def support_of_each(
    result: Result,
    clouds: Mapping[str, Array],
    feet: Mapping[str, FootPoints],
    inliers: Mapping[str, Array],
    sigma: float,
    noise: Mapping[str, Array],
) -> dict[str, Support]:
    """How far the inliers of each cloud support its surface."""
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
    near, found = _feet_of_inliers(feet, inliers), dict[str, SurfaceQuality]()
    deviations = open_deviations(result, support, near) | open_deviations_with_prior(result, support, near)
    for name, each in feet.items():
        arrangement = _arrangement(result, name, clouds, each, support[name].limit)
        known = _known_variances(noise.get(name), each, inliers[name])
        deviation = deviations.get(name, np.inf)
        found[name] = SurfaceQuality(each.signed, inliers[name], support[name], arrangement, *known, deviation)
    return found


def _feet_of_inliers(feet: Mapping[str, FootPoints], inliers: Mapping[str, Array]) -> dict[str, Array]:
    return {name: each.points[inliers[name] >= INLIER] for name, each in feet.items()}


def _known_variances(noise: Array | None, feet: FootPoints, inliers: Array) -> tuple[Array, float]:
    """Known variances (n,) of points along the normals, zero where none are; and how many errors are independent."""
    if noise is None or not inliers.any():
        return np.zeros(len(inliers)), np.inf
    known = variances_along(noise, feet.normals)
    fraction = effective_fraction_of_points(feet.points, feet.signed / np.sqrt(known), inliers)
    return known, float(inliers.sum()) * fraction


def _arrangement(result: Result, name: str, clouds: Mapping[str, Array], feet: FootPoints, limit: float) -> Arrangement:
    """How those points of one cloud are arranged that have a weight, outliers among them."""
    mesh, cloud = result.model.mesh(name, LIMITS.resolution), clouds[name]
    counted = np.ones(len(cloud), dtype=np.bool_) if result.counted is None else result.counted[name]
    return Arrangement.of(mesh, cloud[counted], feet.points[counted], feet.signed[counted], limit)
