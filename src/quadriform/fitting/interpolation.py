"""How far from its data a surface is interpolated: by the distance between slices, not that of points within them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array


@dataclass(frozen=True)
class Limits:
    """The constants of interpolation."""

    medians: float = 4.0
    """A part is interpolated where its distance from data is at most this many medians of the distances of the parts
    that lie between data. Between slices the median is a quarter of their distance, so a surface is interpolated up to
    one distance beyond the last slice. Of random points on a surface that is twice their mean spacing, and one part in
    2^16 is farther from all of them."""
    growth: float = 3.0
    """Medians of the distances of all supported parts to which the limit grows in a round. Parts beyond the data count
    there too; their distances are even up to the limit, so their median is half of it, and with four the limit would
    grow over holes."""
    first: float = 2.0
    """Medians of the distances between neighbouring points within which a part is supported in the first round."""
    rounds: int = 60
    """Most rounds; the limit grows by half at most in each, and dense slices need most of them."""
    enough: float = 0.1
    """Least share of the area that lies between data for its median to be used; else that of all supported parts is."""


LIMITS = Limits()


def interpolated(distances: Array, nearest: NDArray[np.intp], areas: Array, spacing: float) -> float:
    """The distance from data up to which a surface is interpolated.

    The median of the distances of the supported parts grows until the gaps between points and between slices are
    filled; parts that are farther have no data around them. It starts from below, because the median over all parts
    would be that of extrapolated ones where most of the surface has no data. The parts that are nearest to the same
    points as those do not lie between data either, and are left out of the median that decides.

    Args:
        distances: (m,) from the parts of the surface to the nearest data.
        nearest: (m,), the numbers of these points.
        areas: (m,), of the parts.
        spacing: median distance between neighbouring points.
    """
    first = LIMITS.first * spacing
    grown = _grown(distances, areas, first)
    ends = np.unique(nearest[distances > grown])
    between = (distances <= grown) & ~np.isin(nearest, ends)
    if areas[between].sum() < LIMITS.enough * areas.sum():
        return grown
    return max(first, LIMITS.medians * _median(distances[between], areas[between]))


def _grown(distances: Array, areas: Array, first: float) -> float:
    """The limit that is `growth` times the median distance of the parts within it, from a first one on."""
    order = np.argsort(distances)
    ordered, total = distances[order], np.cumsum(areas[order])
    limit = first
    for _ in range(LIMITS.rounds):
        count = int(np.searchsorted(ordered, limit, side="right"))
        if count == 0:
            return limit
        median = ordered[np.searchsorted(total, total[count - 1] / 2)]
        before, limit = limit, max(first, LIMITS.growth * float(median))
        if limit == before:
            break
    return limit


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])
