"""Copies of a point become one point of more weight; points of weight zero are not there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.points import Array


@dataclass(frozen=True)
class Distinct:
    """The distinct points of a cloud of n, those of weight zero left out.

    Attributes:
        points: (m, 3).
        weights: (m,), of all copies together.
        there: (n,) whether a point of the cloud counts.
        place: for each that does, the index of its distinct point.
    """

    points: Array
    weights: Array
    there: NDArray[np.bool_]
    place: NDArray[np.int64]

    @classmethod
    def of(cls, cloud: Array, weights: Array) -> "Distinct":
        """From points (n, 3) and weights (n,)."""
        there = weights > 0
        points, weights = cloud[there], weights[there]
        if (np.diff(np.sort(points[:, 0])) > 0).all():  # no two alike: the common case, and quick to see
            return cls(points, weights, there, np.arange(len(points)))
        distinct, place = np.unique(points, axis=0, return_inverse=True)
        place = place.reshape(-1).astype(np.int64)
        return cls(distinct, np.bincount(place, weights).astype(np.float64), there, place)

    def of_distinct(self, values: Array) -> Array:
        """Values (n, ...) of the whole cloud for its distinct points (m, ...): of copies those of the first."""
        first = np.empty(len(self.points), dtype=np.int64)
        first[self.place[::-1]] = np.flatnonzero(self.there)[::-1]
        return values[first]

    def spread(self, values: Array) -> Array:
        """Values (m,) of the distinct points for the whole cloud (n,), zero where a point does not count."""
        result = np.zeros(len(self.there))
        result[self.there] = values[self.place]
        return result

    def warnings(self) -> Warnings:
        """What is to be said of copies."""
        copies = len(self.place) - len(self.points)
        text = f"{copies} of {len(self.there)} points are copies of others and were counted as weights"
        return {WarningKind.DUPLICATES: text} if copies else {}
