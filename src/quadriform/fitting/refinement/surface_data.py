"""One surface with its data, while the refinement goes on."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import canonical_order, evenly_spread
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.neighbourhood import (
    Neighbourhood,
    dense_points,
    has_edge,
    is_surface,
    oriented,
    outward_normals,
)
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

MISFIT = 5e-3
"""Of the cloud's RMS radius: a distance of this size is the model's own misfit, so no smaller sigma tells strangers."""
SHARE_ROUNDS = 20


@dataclass
class Sheet:
    """A superquadric and its points; lengths in the centred, scaled frame.

    Attributes:
        superquadric: before deformation.
        points: (n, 3).
        weights: (n,), how often each point counts.
        beyond: half-space (point, direction) where the data ends on purpose, or None.
        normals: (n, 3) that were given, unit or zero where a point has none; None without.
        around: what the neighbours of each point tell.
        origins: (n, 3), foot points on the superquadric.
        inliers: (n,), probabilities.
        share: of inliers, once they were weighed.
    """

    superquadric: Superquadric
    points: Array
    weights: Array
    half_space: tuple[Array, Array] | None = None
    normals: Array | None = None
    around: Neighbourhood = field(init=False)
    origins: Array = field(init=False)
    inliers: Array = field(init=False)
    inlier_ratio: float = 1.0

    def __post_init__(self) -> None:
        self.around = Neighbourhood.of(self.points)
        self.inliers = np.ones(len(self.points))

    def thinned(self, count: int, robust: bool) -> "Sheet":
        """About `count` points, spread over their distances to the centre: whatever their order and pose.

        With `robust` those without near neighbours are left out: sums over few points have no other defence.
        """
        order = canonical_order(self.points - self.points.mean(axis=0))
        if robust:
            order = order[self._dense[order]]
        chosen = evenly_spread(order, count)
        normals = None if self.normals is None else self.normals[chosen]
        return Sheet(self.superquadric, self.points[chosen], self.weights[chosen], self.half_space, normals)

    @cached_property
    def _dense(self) -> NDArray[np.bool_]:
        return dense_points(self.points)

    def with_superquadric(self, superquadric: Superquadric) -> "Sheet":
        """The same data around another start."""
        other = copy(self)
        other.superquadric = superquadric
        return other

    def facing(self) -> "FacingCloud":
        """The points with outward normals: those that were given, where there are any."""
        if self.normals is None:
            return FacingCloud(self.points, oriented(self.points, self.around.normals), self.around.flatness)
        given: NDArray[np.bool_] = np.any(self.normals, axis=1)
        normals = outward_normals(self.points, np.where(given[:, None], self.normals, self.around.normals))
        return FacingCloud(self.points, normals, np.where(given, 1.0, self.around.flatness))

    def is_covered(self) -> bool:
        """Whether the data samples the whole surface, or all of it on this side of the base."""
        if not is_surface(self.around):
            return False
        return self.half_space is not None or not has_edge(self.points, self.around)

    def ends(self) -> bool:
        """Whether the data is a sampled surface that stops somewhere, where nobody said that it would."""
        return self.half_space is None and is_surface(self.around) and has_edge(self.points, self.around)

    def missing(self, points: Array) -> NDArray[np.bool_]:
        """Which of (m, 3) points lie beyond the base, where no data is expected."""
        if self.half_space is None:
            return np.zeros(len(points), dtype=np.bool_)
        at, direction = self.half_space
        return (points - at) @ direction > 0

    def distances(self, box: ControlBox) -> Array:
        """From the points to their foot points, (n,)."""
        return np.linalg.norm(self.points - box.deform(self.origins), axis=1)

    def weigh(self, distances: Array, noise: float) -> None:
        """Find which points are inliers by their distances to the surface, and their share on the way."""
        self.inlier_ratio = 0.9
        for _ in range(SHARE_ROUNDS):
            self.inliers = self.probabilities(distances, noise)
            self.inlier_ratio = float(np.clip(np.average(self.inliers, weights=self.weights), 0.02, 1 - 1e-6))

    def probabilities(self, distances: Array, noise: float) -> Array:
        """Of points at such distances (m,) to be inliers, by the share that was found."""
        mixture = Mixture(np.array([self.inlier_ratio]), np.array([max(noise, MISFIT)]))
        return mixture.densities(distances[None])[0][0]

    def beside(self, points: Array, weights: Array, near: NDArray[np.int64]) -> "Sheet":
        """Other points (m, 3) that take after those of this sheet which they are near to, by index."""
        other = copy(self)
        other.points, other.weights, other.inliers = points, weights, np.ones(len(points))
        other.around, other.origins = self.around.take(near), self.origins[near]
        return other


@dataclass(frozen=True)
class FacingCloud:
    """Points with the way they face.

    Attributes:
        points: (n, 3), centred and scaled.
        normals: (n, 3), outward; unit, or shorter where several disagree.
        flatness: (n,) in [0, 1], how much the normal is to be trusted.
    """

    points: Array
    normals: Array
    flatness: Array


@dataclass(frozen=True)
class Few:
    """Few points of every surface, and what a search of new neighbours needs to know of them.

    Attributes:
        sheets: one a surface.
        clouds: the same points, facing.
        covered: whether they sample all of it.
    """

    sheets: tuple[Sheet, ...]
    clouds: tuple[FacingCloud, ...]
    covered: tuple[bool, ...]

    @classmethod
    def of(cls, sheets: Sequence[Sheet], count: int, robust: bool) -> "Few":
        """About `count` points of each."""
        few = tuple(sheet.thinned(count, robust) for sheet in sheets)
        return cls(few, tuple(sheet.facing() for sheet in few), tuple(sheet.is_covered() for sheet in few))

    def around(self, superquadrics: Sequence[Superquadric]) -> "Few":
        """The same points around other starts."""
        sheets = tuple(sheet.with_superquadric(each) for sheet, each in zip(self.sheets, superquadrics))
        return replace(self, sheets=sheets)
