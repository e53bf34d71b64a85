"""The data of one surface during the refinement: points, weights, neighbourhoods, foot points and inliers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from quadriform.fitting.cloud import (
    Neighbourhood,
    canonical_order,
    dense_points,
    evenly_spread,
    has_edge,
    is_surface,
    oriented,
    outward_normals,
)
from quadriform.fitting.mixture import LEAST_RATIO, Mixture
from quadriform.fitting.noise import variances_along
from quadriform.fitting.result import HalfSpace
from quadriform.points import Array, lengths
from quadriform.shapes.closest import closest_on, surface_normals, update_foot_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

MISFIT = 5e-3
"""Least sigma of the inliers, in RMS radii of the cloud: smaller distances are the model's own misfit. It is a choice,
a tenth of the distance of a poor fit."""
MOST_INLIERS = 1 - 1e-6
"""Below one, so that an outlier of a later round can still be detected."""
FIRST_RATIO, EM_ROUNDS = 0.9, 20
"""The inlier ratio at first, and the rounds of EM, after which it changes by less than a thousandth."""


@dataclass(frozen=True)
class SurfaceData:
    """The data of one surface; lengths in the centred, scaled frame. Updates are new objects.

    Attributes:
        superquadric: the surface before deformation.
        points: (n, 3).
        weights: (n,), how often each point counts.
        half_space: where the data ends on purpose (point, direction), or None.
        normals: (n, 3) that were given, unit or zero where a point has none; None without.
        neighbourhood: principal axes of the neighbours of each point.
        origins: (n, 3), points of the undeformed superquadric that the box moves to the foot points; the data points
            themselves until these are first found.
        inliers: (n,), probabilities.
        inlier_ratio: mean of these, once they were estimated.
        covariances: (n, 3, 3) of the measurement errors of the points, divided by the square of `least_sigma`; None
            where all points are alike.
        least_sigma: the known standard deviation of the measurement errors, s0; zero where nothing is known.
        excess: x, variance by which the errors exceed the known ones, over s0^2 (`with_excess`).
    """

    superquadric: Superquadric
    points: Array
    weights: Array
    half_space: HalfSpace | None
    normals: Array | None
    neighbourhood: Neighbourhood
    origins: Array
    inliers: Array
    inlier_ratio: float = 1.0
    covariances: Array | None = None
    least_sigma: float = 0.0
    excess: float = 0.0

    @classmethod
    def of(
        cls,
        superquadric: Superquadric,
        points: Array,
        weights: Array,
        half_space: HalfSpace | None = None,
        normals: Array | None = None,
        covariances: Array | None = None,
        least_sigma: float = 0.0,
    ) -> "SurfaceData":
        """The data with all points as inliers, each its own foot point until these are updated."""
        near, ones = Neighbourhood.of(points), np.ones(len(points))
        return cls(
            superquadric, points, weights, half_space, normals, near, points, ones, 1.0, covariances, least_sigma
        )

    @property
    def effective_weights(self) -> Array:
        """How much each point counts, (n,): its weight times its probability to be an inlier."""
        return self.weights * self.inliers

    @property
    def total_weight(self) -> float:
        """The sum of the effective weights, which `LinearProblem.total_weight` adds up over the surfaces."""
        return float(self.effective_weights.sum())

    def subsample(self, count: int, robust: bool) -> "SurfaceData":
        """About `count` points, spread over their distances to the centre: whatever their order and pose.

        All are inliers at first. With `robust` those without near neighbours are left out: rounds on few points have no
        robust weights.
        """
        # the order is by distance from the centre, so every k-th point spreads over the whole cloud
        order = canonical_order(self.points - self.points.mean(axis=0))
        if robust:
            order = order[dense_points(self.points)[order]]
        chosen = evenly_spread(order, count)
        normals, covariances = (None if each is None else each[chosen] for each in (self.normals, self.covariances))
        points, weights = self.points[chosen], self.weights[chosen]
        half_space, least = self.half_space, self.least_sigma
        return SurfaceData.of(self.superquadric, points, weights, half_space, normals, covariances, least)

    def with_superquadric(self, superquadric: Superquadric) -> "SurfaceData":
        """The data of another superquadric with the same points."""
        return replace(self, superquadric=superquadric)

    def with_tangential_steps(self, box: ControlBox, steps: int) -> "SurfaceData":
        """The data with foot points moved along the deformed surface by tangential Gauss-Newton steps."""
        origins = update_foot_points(self.superquadric, box, self.points, self.origins, steps)
        return replace(self, origins=origins)

    def with_nearest_foot_points(self, box: ControlBox) -> "SurfaceData":
        """The data with the nearest foot points on the deformed surface."""
        return replace(self, origins=closest_on(self.superquadric, box, self.points).origins)

    def oriented(self) -> "OrientedCloud":
        """The points with outward normals: the given ones where there are any, else those of the neighbourhoods."""
        near = self.neighbourhood
        if self.normals is None:
            return OrientedCloud(self.points, oriented(self.points, near.normals), near.flatness)
        given: NDArray[np.bool_] = np.any(self.normals, axis=1)  # zero where a point has none
        normals = outward_normals(self.points, np.where(given[:, None], self.normals, near.normals))
        return OrientedCloud(self.points, normals, np.where(given, 1.0, near.flatness))

    def is_covered(self) -> bool:
        """Whether the points are dense on a surface, not on contours or in a volume, and this has no edge.

        Edges of data with a base count as those at the base.
        """
        if not is_surface(self.neighbourhood):
            return False
        return self.half_space is not None or not has_edge(self.points, self.neighbourhood)

    def in_half_space(self, points: Array) -> NDArray[np.bool_]:
        """Which of (m, 3) points lie where no data is expected."""
        if self.half_space is None:
            return np.zeros(len(points), dtype=np.bool_)
        at, direction = self.half_space
        return (points - at) @ direction > 0

    def distances(self, box: ControlBox) -> Array:
        """Distances (n,) from the points to their foot points."""
        return lengths(self.points - box.deform(self.origins))

    def along_normals(self, box: ControlBox) -> "NormalResiduals":
        """Foot points, normals and residuals at a box."""
        feet, normals = box.deform(self.origins), surface_normals(self.superquadric, box, self.origins)
        return NormalResiduals(feet, normals, np.einsum("ni,ni->n", self.points - feet, normals))

    def variances(self, normals: Array) -> Array:
        """(v_i + x) / (1 + x), the variance (n,) of each point along a normal (n, 3), relative to the mean one."""
        return (self.known_variances(normals) + self.excess) / (1 + self.excess)

    def known_variances(self, normals: Array) -> Array:
        """v_i, the variance (n,) of the measurement error of each point along a normal (n, 3), over s0^2."""
        return np.ones(len(normals)) if self.covariances is None else variances_along(self.covariances, normals)

    def standardised_distances(self, box: ControlBox) -> Array:
        """Distances (n,) from the points to their foot points, divided by the roots of `variances`."""
        if self.covariances is None:
            return self.distances(box)
        normals = surface_normals(self.superquadric, box, self.origins)
        return self.distances(box) / np.sqrt(self.variances(normals))

    def with_inliers(self, box: ControlBox, sigma: float) -> "SurfaceData":
        """The data with inlier probabilities and inlier ratio at a standard deviation of the residuals."""
        return self.with_inliers_at_distances(self.standardised_distances(box), sigma)

    def with_inliers_at_ratio(self, box: ControlBox, sigma: float) -> "SurfaceData":
        """The data with inlier probabilities at a standard deviation of the residuals; the inlier ratio is kept."""
        distances = self.standardised_distances(box)
        return replace(self, inliers=inlier_probabilities(distances, sigma, self.inlier_ratio))

    def with_inliers_at_distances(self, distances: Array, sigma: float) -> "SurfaceData":
        """The data with inlier probabilities and ratio, by EM at a given sigma, from standardised distances (n,)."""
        ratio, total = FIRST_RATIO, self.weights.sum()
        for _ in range(EM_ROUNDS):
            inliers, before = inlier_probabilities(distances, sigma, ratio), ratio
            ratio = float(np.clip((inliers * self.weights).sum() / total, LEAST_RATIO, MOST_INLIERS))
            if ratio == before:
                break
        return replace(self, inliers=inliers, inlier_ratio=ratio)

    def beside(
        self, points: Array, weights: Array, near: NDArray[np.int64], covariances: Array | None = None
    ) -> "SurfaceData":
        """The data of other points (m, 3), with neighbourhoods and foot points of the points at the indices `near`."""
        return replace(
            self,
            points=points,
            weights=weights,
            inliers=np.ones(len(points)),
            neighbourhood=self.neighbourhood.take(near),
            origins=self.origins[near],
            covariances=covariances,
        )


def inlier_probabilities(distances: Array, sigma: float, inlier_ratio: float) -> Array:
    """Inlier probabilities (n,) of points at Euclidean distances (n,) from their foot points.

    `sigma` is of the residuals along the normal. At a foot point that has converged the residual is normal to the
    surface, so both are the same there; elsewhere the Euclidean distance is the larger one, and the point counts less.
    """
    # with exact data sigma would be that of the model's own misfit, and every corner an outlier
    mixture = Mixture(np.array([inlier_ratio]), np.array([max(sigma, MISFIT)]))
    return mixture.densities(distances[None])[0][0]


def with_excess(datasets: Sequence[SurfaceData], boxes: Sequence[ControlBox]) -> tuple[SurfaceData, ...]:
    """The data with the variance x by which its errors exceed the known ones, of all surfaces together.

    With residuals n_i . e_i along the normals, known variances s0^2 v_i and weights w_i, it is the x >= 0 where the
    mean of w_i (n_i . e_i)^2 / (s0^2 (v_i + x)) is that of w_i, or zero where the residuals are smaller than the known
    errors. Known errors have a direction, as that of a voxel's edge. Others are alike in all directions, as where
    slices of a mask are displaced against each other: scaling the known covariances instead would give such points a
    weight along the slices that they do not deserve.

    Args:
        datasets: one or more surfaces; without known covariances they stay as they are.
        boxes: the deformed box of each.
    """
    if all(data.covariances is None for data in datasets):
        return tuple(datasets)
    found = [data.along_normals(box) for data, box in zip(datasets, boxes)]
    squares = np.concatenate([(each.residuals / data.least_sigma) ** 2 for data, each in zip(datasets, found)])
    known = np.concatenate([data.known_variances(each.normals) for data, each in zip(datasets, found)])
    weights = np.concatenate([data.effective_weights for data in datasets])

    def surplus(excess: float) -> float:
        """How far the sum of the weighted ratios is above that of the weights; it decreases."""
        return float(weights @ (squares / (known + excess) - 1))

    # the mean of d^2 / (v + x) is below that of d^2 / x, so the root is below the mean of d^2
    largest = 2 * float(weights @ squares) / max(float(weights.sum()), np.finfo(float).tiny)
    excess = float(brentq(surplus, 0.0, largest, maxiter=1000)) if surplus(0.0) > 0 else 0.0
    return tuple(replace(data, excess=excess) for data in datasets)


class NormalResiduals(NamedTuple):
    """Foot points (n, 3), normals (n, 3) there, and the components (n,) along them from foot points to data points."""

    feet: Array
    normals: Array
    residuals: Array


@dataclass(frozen=True)
class OrientedCloud:
    """Points with outward normals.

    Attributes:
        points: (n, 3), centred and scaled.
        normals: (n, 3), outward; unit, or shorter where several disagree.
        flatness: (n,) in [0, 1], the reliability of the normal.
    """

    points: Array
    normals: Array
    flatness: Array


@dataclass(frozen=True)
class Subsample:
    """Few points of every surface with their normals, as the search of new correspondences needs them.

    Attributes:
        datasets: one a surface.
        clouds: the same points with outward normals.
        covered: whether they sample all of it.
    """

    datasets: tuple[SurfaceData, ...]
    clouds: tuple[OrientedCloud, ...]
    covered: tuple[bool, ...]

    @classmethod
    def of(cls, datasets: Sequence[SurfaceData], count: int, robust: bool) -> "Subsample":
        """About `count` points of each."""
        chosen = tuple(data.subsample(count, robust) for data in datasets)
        return cls(chosen, tuple(data.oriented() for data in chosen), tuple(data.is_covered() for data in chosen))

    def with_superquadrics(self, superquadrics: Iterable[Superquadric]) -> "Subsample":
        """The subsample of other superquadrics with the same points."""
        datasets = tuple(data.with_superquadric(each) for data, each in zip(self.datasets, superquadrics))
        return replace(self, datasets=datasets)
