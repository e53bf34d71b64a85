"""Where a body cannot be: on the rays of a sensor that met nothing, and beyond a plane on which it stands.

A face without points costs nothing in a sum over points. But the surface of a body has points wherever the sensor sees
it. So each ray is empty up to what was measured in its direction, or all along where nothing was. For a body with a
piece of an empty ray inside this ray counts as a point that is as deep inside.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.levenberg_marquardt import distances
from quadriform.fitting.superquadric.penalty import PenaltyTerms
from quadriform.points import Array, unit_vectors


@dataclass(frozen=True)
class EmptySpaceSettings:
    """The constants of empty space."""

    grid: int = 32
    """Rays along each side of a field around the inliers; a surface is bounded to one step of it. A multiple of
    `depths`."""
    field: float = 1.5
    """Side of the field over that of the inliers: surface that goes farther crosses its border first."""
    depths: int = 8
    """Positions along each ray: several within a body."""
    neighbours: int = 8
    """Measured directions next to a ray. Together they say how far away the nearest thing is there."""
    farther: float = 1.25
    """Nothing was measured in a direction that is farther from the next measured one than this times the distance of
    that one from so many neighbours, twice the mean distance: one such hole in 100,000 is by chance. What was thinned
    out, as what is nearer often is, still hides what is behind it."""
    least: int = 100
    """Inliers that were seen from a position: fewer show no outline."""
    views: int = 8
    """Positions that are used, those with the most inliers."""
    margin: float = 0.2
    """RMS radii in front of what was measured that are not taken as empty: noise, and edges between neighbours."""


EMPTY = EmptySpaceSettings()


@dataclass(frozen=True)
class EmptySpace:
    """Rays that are empty.

    Attributes:
        rays: (R, K, 3), positions along each.
        weights: (R,), points that each stands for.
    """

    rays: Array
    weights: Array

    def scaled(self, factor: float) -> "EmptySpace":
        """The same for a sample of the points."""
        return replace(self, weights=factor * self.weights)

    def __call__(self, candidates: Candidates, mixture: Mixture) -> PenaltyTerms:
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


@dataclass(frozen=True)
class Surroundings:
    """What is known beside the points, in their frame.

    Attributes:
        points: (n, 3), all that were measured.
        viewpoints: (n, 3), where each was seen from; None where that is not known.
        plane: a point of a plane that no part of the body is beyond, and its unit normal to the side of the body; or
            None.
    """

    points: Array
    viewpoints: Array | None
    plane: tuple[Array, Array] | None

    def empty_space(self, inliers: NDArray[np.bool_]) -> EmptySpace | None:
        """Empty rays around those points (n,) that are of the body; None without any."""
        parts = [*self._views(inliers), *self._support(inliers)]
        if not parts:
            return None
        return EmptySpace(np.concatenate([p.rays for p in parts]), np.concatenate([p.weights for p in parts]))

    def _views(self, inliers: NDArray[np.bool_]) -> Iterator[EmptySpace]:
        if self.viewpoints is None:
            return
        eyes, view = np.unique(self.viewpoints, axis=0, return_inverse=True)
        counts = np.bincount(view.reshape(-1), inliers)
        most = np.argsort(-counts, kind="stable")[: EMPTY.views]
        for number in most[counts[most] >= EMPTY.least]:
            of = view.reshape(-1) == number
            yield _seen_from(eyes[number], self.points[of], inliers[of])

    def _support(self, inliers: NDArray[np.bool_]) -> Iterator[EmptySpace]:
        if self.plane is None or inliers.sum() <= EMPTY.neighbours:
            return
        at, normal = self.plane
        frame = _frame_about(normal)
        local = (self.points[inliers] - at) @ frame
        centres, occupied = _field(local[:, :2])
        on_plane = np.column_stack([centres, np.zeros(len(centres))]) @ frame.T + at
        rays = on_plane.reshape(-1, EMPTY.depths, 3)  # parts of its rows
        yield EmptySpace(rays, np.full(len(rays), EMPTY.depths * inliers.sum() / occupied))


def _seen_from(eye: Array, points: Array, inliers: NDArray[np.bool_]) -> EmptySpace:
    """Empty rays of a sensor at a position (3,), around the inliers (n,) of its points (n, 3), and past all of them."""
    frame = _frame_about((points[inliers] - eye).mean(axis=0))
    local, ranges = (points - eye) @ frame, np.linalg.norm(points - eye, axis=1)
    ahead = local[:, 2] > 0
    plane, ranges = local[ahead, :2] / local[ahead, 2:], ranges[ahead]
    of_body = inliers[ahead]
    centres, occupied = _field(plane[of_body])
    near, far = ranges[of_body].min(), ranges[of_body].max()
    # a body goes on behind what is seen of it, as far as it is wide there at most
    reach = max(far - near, far * float(np.ptp(plane[of_body], axis=0).max()))
    ends, past = _empty_range(centres, plane, ranges, of_body)
    begin, ends = max(near - reach, 0.0), np.minimum(ends, far + reach)
    kept = past & (ends > begin)
    centres, ends = centres[kept], ends[kept]
    along = begin + (ends - begin)[:, None] * np.linspace(0, 1, EMPTY.depths)
    towards = unit_vectors(np.column_stack([centres, np.ones(len(centres))])) @ frame.T
    rays = eye + along[:, :, None] * towards[:, None]
    return EmptySpace(rays, np.full(len(rays), of_body.sum() / occupied))


def _field(plane: Array) -> tuple[Array, float]:
    """Centres (R, 2) of a grid around points (m, 2) of a plane, along their axes, and how many cells have points."""
    axes = np.linalg.eigh(np.cov(plane.T))[1]
    local = plane @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    middle, side = (low + high) / 2, EMPTY.field * np.maximum(high - low, 1e-12)
    cells = np.floor((local - middle) / side * EMPTY.grid).astype(np.int64)
    steps = (np.arange(EMPTY.grid) + 0.5) / EMPTY.grid - 0.5
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return (middle + grid * side) @ axes.T, float(len(np.unique(cells, axis=0)))


def _empty_range(
    centres: Array, plane: Array, ranges: Array, of_body: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """How far rays in directions (R, 2) are empty, by measured directions (n, 2) and their ranges (n,); which pass.

    Each measured direction stands for a disc, large where few were measured.
    """
    count = min(EMPTY.neighbours, len(plane) - 1)
    radii = EMPTY.farther * cKDTree(plane).query(plane, k=count + 1)[0][:, -1]
    octave = np.floor(np.log2(np.maximum(radii / radii.max(), 1e-9))).astype(np.int64)
    ends, past = np.full(len(centres), np.inf), np.ones(len(centres), dtype=np.bool_)
    for number in np.unique(octave):
        of = np.flatnonzero(octave == number)
        away, near = cKDTree(plane[of]).query(centres, k=[*range(1, min(count, len(of)) + 1)])
        within = away <= radii[of][near]
        ends = np.minimum(ends, np.where(within, ranges[of][near], np.inf).min(axis=1) - EMPTY.margin)
        # where the body was measured its points say the same
        past &= ~(within & of_body[of][near]).any(axis=1)
    return ends, past


def _frame_about(axis: Array) -> Array:
    """A frame (3, 3), in columns, whose z is an axis of any length."""
    z = unit_vectors(axis)
    x = unit_vectors(np.cross(np.eye(3)[np.abs(z).argmin()], z))
    return np.stack([x, np.cross(z, x), z], axis=1)
