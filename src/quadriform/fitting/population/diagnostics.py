"""Warnings about a fit with a prior: what is known from the population alone, and whether the shape is one of it."""

from collections.abc import Collection, Mapping

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import fdtrc

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.diagnostics import MOSTLY_SUPPORTED, POOR, SurfaceQuality, named_texts
from quadriform.fitting.elements import Elements
from quadriform.fitting.result import Result
from quadriform.fitting.support import Support
from quadriform.points import Array
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.record import OBSERVED

RARE = 1e-3
"""A shape is outside of the population where fewer of its members than this fraction are as far from the mean."""


THICKNESS = (
    "the space between the surfaces is not that of the data: with a prior, wall thickness is measured along oblique "
    "lines and can be millimetres too large; volumes are not concerned"
)


def notes_on_walls(surfaces: Collection[str]) -> tuple[str, ...]:
    """What the lines between several surfaces of a fit with a prior do not measure."""
    return (THICKNESS,) if len(surfaces) > 1 else ()


def population_warnings(result: Result, quality: Mapping[str, SurfaceQuality], unit: float) -> Warnings:
    """PARTIAL_COVERAGE where a surface has no data and is that of the population; UNSUPPORTED where that says little.

    Args:
        result: of a fit with a prior; of others there are none.
        quality: by surface, with the standard deviation of its part without data.
        unit: the length of one in the centred, scaled frame, in the unit of the points.
    """
    if result.prior_distance is None:
        return {}
    found = {name: from_population(each.support.scaled(unit), each.open_deviation) for name, each in quality.items()}
    return named_texts(found)


def from_population(support: Support, deviation: float) -> Warnings:
    """The same warnings about one surface.

    Args:
        support: in the unit of the points.
        deviation: standard deviation of the part without data, over the RMS radius of the cloud.
    """
    if support.within >= OBSERVED:
        return {}
    known = f"known to {100 * deviation:.2g} % of the cloud's RMS radius (one standard deviation)"
    part = f"{100 * (1 - support.within):.0f} % of the surface is farther than {support.limit:.3g} from all data"
    warnings = {WarningKind.PARTIAL_COVERAGE: f"{part}; there it is that of the population of the prior, {known}"}
    if support.within < MOSTLY_SUPPORTED and deviation > POOR:
        warnings[WarningKind.UNSUPPORTED] = f"{part}, and the population does not determine it: it is {known}"
    return warnings


def outside_population(prior: ShapePrior, distance: float) -> Warnings:
    """OUTSIDE_POPULATION where a shape is farther from the mean of a population than nearly all of its members.

    By Hotelling's test: with m modes of n models, n (n - m) / ((n + 1) (n - 1) m) times the square of the distance has
    an F distribution with m and n - m degrees of freedom (Annals of Mathematical Statistics 2(3), 1931).

    Args:
        prior: the population.
        distance: as `ShapePrior.distance`.
    """
    m, n = len(prior.modes), prior.n_models
    if n <= m or fdtrc(m, n - m, n * (n - m) / ((n + 1) * (n - 1) * m) * distance**2) >= RARE:
        return {}
    text = (
        f"the shape is farther from the mean of the prior than all but one in {1 / RARE:.0f} of its population "
        f"(distance {distance:.2g}, usual {np.sqrt(m):.2g}): where there is no data, that population may mislead"
    )
    return {WarningKind.OUTSIDE_POPULATION: text}


def open_deviations_with_prior(
    result: Result, support: Mapping[str, Support], feet: Mapping[str, Array]
) -> dict[str, float]:
    """Name -> standard deviation of the part of a surface without data, as RMS over its area, by posterior and prior.

    Args:
        result: of a fit with a prior; of others there are none.
        support: name -> of the surfaces by their data.
        feet: name -> (n, 3), the points of the surfaces nearest to their inliers.
    """
    found, model = dict[str, float](), result.model
    if result.prior_distance is None or result.enriched is None:
        return found
    for name, near in feet.items():
        elements = Elements.of(model, name, result.half_space)
        is_open = np.ones(len(elements.points), dtype=np.bool_)
        if len(near):
            is_open = cKDTree(near).query(elements.points)[0] > support[name].limit
        areas = elements.areas * is_open
        squares = result.enriched.deviation(model.box, elements.origins, elements.normals) ** 2
        found[name] = float(np.sqrt(areas @ squares / areas.sum())) if areas.any() else 0.0
    return found
