"""Where a body cannot be: on the rays of a sensor that met nothing, and beyond a plane on which it stands.

A sum over points does not show that a part of a surface has no points. But where the sensor sees the surface of a body
there are points. So the ray of the sensor in any direction is empty up to the point that was measured in this
direction, and all along where none was. Rays in the plane of the support are empty too.

The penalty: an empty ray is sampled at K positions. With d(x) the signed distance of a position to a candidate,
negative inside, and d_min the least one of the ray, the ray counts as w points at the distance min(d_min, 0): a
candidate that contains a piece of it loses the log likelihood

    w (log p(0) - log p(min(d_min, 0))),

p the density of a distance by the mixture. w is the number of points that a ray that meets the body has on average.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import Candidates, distances
from quadriform.fitting.superquadric.surroundings import Surroundings
from quadriform.points import Array, unit_vectors


@dataclass(frozen=True)
class EmptySpaceSettings:
    """The constants of empty space."""

    grid: int = 32
    """Rays along each side of a square grid around the inliers, in the image of the sensor or in the support plane. The
    outline of a body is known to one step of it. A multiple of `depths`."""
    field: float = 1.5
    """Side of the grid over the extent of the inliers: a surface that extends beyond it crosses its outer rays."""
    depths: int = 8
    """Positions along each ray: several within a body."""
    neighbours: int = 8
    """Measured directions next to a ray. The least of their ranges is taken as the range of the ray."""
    farther: float = 1.25
    """A measured direction stands for a disc around it, with the distance to its last neighbour times this as radius;
    where no disc lies nothing was measured. With 8 neighbours the radius is twice the mean distance of points, and one
    direction in 100,000 is outside of all discs by chance. Where points are sparse, as in a cloud that was thinned out,
    the discs are larger, so that a surface still hides what is behind it."""
    least: int = 100
    """Inliers that were seen from a position: fewer show no outline."""
    views: int = 8
    """Positions that are used, those with the most inliers."""
    margin: float = 0.2
    """RMS radii in front of what was measured that are not taken as empty: noise, and edges between neighbours."""


EMPTY = EmptySpaceSettings()


@dataclass(frozen=True)
class PenaltyTerms:
    """A penalty at M candidates: the log likelihood that they lose, and its derivatives times sigma squared.

    The factor makes the derivatives add up with those of the weighted squared distances in `Descent`.

    Attributes:
        cost: (M,).
        gradient: (M, p).
        matrix: (M, p, p), of second derivatives by Gauss and Newton: without those of the distances.
    """

    cost: Array
    gradient: Array
    matrix: Array


@dataclass(frozen=True)
class EmptySpace:
    """Rays that are empty.

    Attributes:
        rays: (R, K, 3), positions along each.
        weights: (R,), points that each stands for.
    """

    rays: Array
    weights: Array

    def of_sample(self, fraction: float) -> "EmptySpace":
        """The same beside a sample with a fraction of the points."""
        return replace(self, weights=fraction * self.weights)

    def penalty(self, candidates: Candidates, mixture: Mixture) -> PenaltyTerms:
        """The log likelihood that candidates lose by empty rays inside them, and its derivatives."""
        count, rays = len(candidates), len(self.rays)
        found, derivatives = distances(candidates, self.rays.reshape(-1, 3))
        found = found.reshape(count, rays, -1)
        deepest = found.argmin(axis=2)
        inside = np.minimum(np.take_along_axis(found, deepest[:, :, None], 2)[:, :, 0], 0)
        rows = derivatives.reshape(count, -1, rays, self.rays.shape[1])
        rows = np.take_along_axis(rows, deepest[:, None, :, None], 3)[..., 0]
        inliers, density = mixture.densities(inside)
        outside = mixture.densities(np.zeros((count, 1)))[1]
        weighted = rows * (self.weights * inliers * (inside < 0))[:, None]
        return PenaltyTerms(
            cost=(self.weights * (outside - density)).sum(axis=1),
            gradient=(weighted @ inside[:, :, None])[..., 0],
            matrix=weighted @ np.swapaxes(rows, 1, 2),
        )


def empty_space(surroundings: Surroundings, points: Array, inlier_mask: NDArray[np.bool_]) -> EmptySpace | None:
    """Empty rays around those of all points (n, 3) that are of the body, by a mask (n,); None without any ray."""
    parts = [*_of_views(surroundings, points, inlier_mask), *_of_support(surroundings, points, inlier_mask)]
    if not parts:
        return None
    return EmptySpace(np.concatenate([p.rays for p in parts]), np.concatenate([p.weights for p in parts]))


def _of_views(surroundings: Surroundings, points: Array, inlier_mask: NDArray[np.bool_]) -> Iterator[EmptySpace]:
    """The empty rays of each position that saw enough inliers."""
    if surroundings.viewpoints is None:
        return
    eyes, view = np.unique(surroundings.viewpoints, axis=0, return_inverse=True)
    counts = np.bincount(view.reshape(-1), inlier_mask)
    most = np.argsort(-counts, kind="stable")[: EMPTY.views]
    for number in most[counts[most] >= EMPTY.least]:
        seen = view.reshape(-1) == number
        yield _seen_from(eyes[number], points[seen], inlier_mask[seen])


def _of_support(surroundings: Surroundings, points: Array, inlier_mask: NDArray[np.bool_]) -> Iterator[EmptySpace]:
    """Rays in the plane of the support: parts of the rows of a grid around the inliers' projections onto it."""
    if surroundings.plane is None or inlier_mask.sum() <= EMPTY.neighbours:
        return
    at, normal = surroundings.plane
    frame = _frame_about(normal)
    centres, occupied = _grid_around(((points[inlier_mask] - at) @ frame)[:, :2])
    on_plane = np.column_stack([centres, np.zeros(len(centres))]) @ frame.T + at
    rays = on_plane.reshape(-1, EMPTY.depths, 3)
    yield EmptySpace(rays, np.full(len(rays), EMPTY.depths * inlier_mask.sum() / occupied))


def _seen_from(eye: Array, points: Array, inlier_mask: NDArray[np.bool_]) -> EmptySpace:
    """Empty rays of a sensor at a position (3,), around the inliers, by a mask (n,), of its points (n, 3).

    Rays that end at the body are left out. Directions are positions in the sensor's image, at unit distance from it.
    """
    frame = _frame_about((points[inlier_mask] - eye).mean(axis=0))
    local, ranges = (points - eye) @ frame, np.linalg.norm(points - eye, axis=1)
    ahead = local[:, 2] > 0
    image, ranges = local[ahead, :2] / local[ahead, 2:], ranges[ahead]
    of_body = inlier_mask[ahead]
    centres, occupied = _grid_around(image[of_body])
    near, far = ranges[of_body].min(), ranges[of_body].max()
    # a body extends behind what is seen of it, at most as far as it is wide there
    depth = max(far - near, far * float(np.ptp(image[of_body], axis=0).max()))
    ends, passes = _empty_range(centres, image, ranges, of_body)
    begin, ends = max(near - depth, 0.0), np.minimum(ends, far + depth)
    kept = passes & (ends > begin)
    centres, ends = centres[kept], ends[kept]
    along = begin + (ends - begin)[:, None] * np.linspace(0, 1, EMPTY.depths)
    towards = unit_vectors(np.column_stack([centres, np.ones(len(centres))])) @ frame.T
    rays = eye + along[:, :, None] * towards[:, None]
    return EmptySpace(rays, np.full(len(rays), of_body.sum() / occupied))


def _grid_around(points: Array) -> tuple[Array, float]:
    """Centres (R, 2) of a grid around points (m, 2) of a plane, along their axes, and how many cells have points."""
    axes = np.linalg.eigh(np.cov(points.T))[1]
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    middle, side = (low + high) / 2, EMPTY.field * np.maximum(high - low, 1e-12)
    cells = np.floor((local - middle) / side * EMPTY.grid).astype(np.int64)
    steps = (np.arange(EMPTY.grid) + 0.5) / EMPTY.grid - 0.5
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return (middle + grid * side) @ axes.T, float(len(np.unique(cells, axis=0)))


def _empty_range(
    centres: Array, image: Array, ranges: Array, of_body: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """The distance (R,) from the sensor up to which rays are empty, infinite where no disc lies, and a mask (R,).

    The mask is true for rays that pass the body: on none of the discs of its own points, which show its surface
    themselves. The discs are those of `EmptySpaceSettings.farther`.

    Args:
        centres: directions (R, 2) of the rays, in the image.
        image: measured directions (n, 2).
        ranges: (n,), of the measured points.
        of_body: (n,), which of them are of the body.
    """
    count = min(EMPTY.neighbours, len(image) - 1)
    radii = EMPTY.farther * cKDTree(image).query(image, k=count + 1)[0][:, -1]
    # discs of about the same radius together (within a factor of two): among these a ray lies on those next to it
    octave = np.floor(np.log2(np.maximum(radii / radii.max(), 1e-9))).astype(np.int64)
    ends, passes = np.full(len(centres), np.inf), np.ones(len(centres), dtype=np.bool_)
    for number in np.unique(octave):
        group = np.flatnonzero(octave == number)
        distance, near = cKDTree(image[group]).query(centres, k=[*range(1, min(count, len(group)) + 1)])
        within = distance <= radii[group][near]
        ends = np.minimum(ends, np.where(within, ranges[group][near], np.inf).min(axis=1) - EMPTY.margin)
        passes &= ~(within & of_body[group][near]).any(axis=1)
    return ends, passes


def _frame_about(axis: Array) -> Array:
    """A frame (3, 3), in columns, whose z is an axis of any length."""
    z = unit_vectors(axis)
    x = unit_vectors(np.cross(np.eye(3)[np.abs(z).argmin()], z))
    return np.stack([x, np.cross(z, x), z], axis=1)
