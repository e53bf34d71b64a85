"""How far data supports a fitted surface, measured from each part of it.

`diagnostics.py` derives warnings from these measures. The option `support` is something else: a plane such as a table.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import evenly_spread
from quadriform.fitting.connected import components
from quadriform.fitting.interpolation import interpolated
from quadriform.fitting.support_settings import LIMITS, ONE
from quadriform.points import Array, rms_length, unit_vectors
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric

PER_CELL = 8
"""Points of an even cloud in a cell of directions, enough that an empty cell means missing data."""


@dataclass(frozen=True)
class Reach:
    """The largest extent of a surface beyond its data in any direction, and the width of the data in that direction."""

    distance: float
    width: float

    @classmethod
    def of(cls, vertices: Array, points: Array) -> "Reach":
        """The reach of vertices (m, 3) beyond points (n, 3); at least 0."""
        directions = sphere_grid(LIMITS.directions)[0]
        far = _farthest(points, directions)
        farther = np.maximum(_farthest(vertices, directions) - far, 0.0)
        most = int(farther.argmax())
        return cls(float(farther[most]), float(far[most] + _farthest(points, -directions[[most]])[0]))


@dataclass(frozen=True)
class Support:
    """The support of one surface by its data.

    Attributes:
        area: share [0, 1] of its area that is supported.
        volume: share [0, 1] of the volume that lies between the centre of the data and supported area.
        below: the same of the volume on the side of the base with the data, between a point of the base and supported
            area; `volume` without a base.
        within: min(area share, volume share) on the data's side of the base: of the area that lies more than
            `at_base` standard deviations of the noise below the base, and of the volume, `below`. Without a base the
            share of all of the area.
        limit: distance from data up to which a part is supported, in the unit of the points: as far as the surface is
            interpolated between points or slices (`interpolation.py`), and at least the step of the measurement.
        extends_beyond: how far the surface reaches beyond the data in the direction where that is farthest, likewise.
        reach: the same of the part on this side of the base.
        slices: number of parallel slices that all data lies in, where it is so small that nothing checks the shape
            between them; else 0.
        by_volume: whether `within` is the share of the volume, which is less than that of the area.
    """

    area: float
    volume: float
    below: float
    within: float
    limit: float
    extends_beyond: float
    reach: Reach
    slices: int = 0
    by_volume: bool = False

    @property
    def has_data(self) -> bool:
        """Whether some points are near enough to others to be data of a surface."""
        return self.limit > 0

    def scaled(self, scale: float) -> "Support":
        """The support with its lengths times `scale`."""
        reach = Reach(scale * self.reach.distance, scale * self.reach.width)
        return replace(self, limit=scale * self.limit, extends_beyond=scale * self.extends_beyond, reach=reach)


def support_of(
    mesh: Mesh, points: Array, feet: Array, noise: float, base: BasePlane | None, step: float = 0.0
) -> Support:
    """The support of a surface by its data: which parts are nearer to it than a limit (`interpolation.py`).

    Args:
        mesh: of the surface, fine.
        points: (n, 3), the inliers; n may be 0.
        feet: (n, 3), the points of the surface nearest to them: a part of the surface without foot points, such as the
            other side of a thin bowl, has no support.
        noise: standard deviation of the points.
        base: the plane beyond which no data is expected, or None.
        step: distance at which the measurement samples, where it is known, as that of slices; else 0.
    """
    corners, across = mesh.vertices[mesh.faces], mesh.area_vectors()
    middles, areas = corners.mean(axis=1), np.linalg.norm(across, axis=1)
    connected, distances, limit = _distances_from_data(points, feet, middles, areas, max(LIMITS.noise * noise, step))
    points = points[connected]
    if not len(points):
        far = float(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1).max())
        return Support(0.0, 0.0, 0.0, 0.0, 0.0, far, Reach(far, 0.0))
    supported, slices = distances <= limit, sparse_slices(points)
    area, volume = _fraction(areas, supported), _fraction(_cones(corners, points.mean(axis=0)), supported)
    reach = Reach.of(mesh.vertices, points)
    if base is None:
        return Support(area, volume, volume, area, limit, reach.distance, reach, slices)
    heights = base.heights(middles)
    area_below = _fraction(np.where(heights <= -LIMITS.at_base * noise, areas, 0.0), supported)
    volume_below = _fraction(_volumes_below(corners, across @ base.direction, heights, base, supported), supported)
    within = min(area_below, volume_below)
    reach_below = Reach.of(mesh.vertices[base.heights(mesh.vertices) <= 0], points)
    by_volume = volume_below < area_below
    return Support(area, volume, volume_below, within, limit, reach.distance, reach_below, slices, by_volume)


def rms_without_data(mesh: Mesh, points: Array, feet: Array, noise: float, excluded: NDArray[np.bool_]) -> float:
    """The distance from data of the parts of a surface that have no support, as RMS over all of its area.

    Args:
        mesh: of the surface, fine.
        points, feet, noise: as in `support_of`.
        excluded: (m,), which triangles lie where no data is expected; they count as supported.
    """
    areas, middles = np.linalg.norm(mesh.area_vectors(), axis=1), mesh.vertices[mesh.faces].mean(axis=1)
    _, distances, limit = _distances_from_data(points, feet, middles, areas, LIMITS.noise * noise)
    if not limit > 0:
        return 0.0  # no points of which the distance means anything
    without = (distances > limit) & ~excluded
    return float(np.sqrt((areas[without] @ distances[without] ** 2) / areas.sum()))


def _volumes_below(
    corners: Array, upward: Array, heights: Array, base: BasePlane, supported: NDArray[np.bool_]
) -> Array:
    """The volume (m,) below the base that belongs to each triangle of a surface; zero for triangles above the base.

    A triangle has the cone (tetrahedron) from it to a point of the base. The cones of all triangles fill the space that
    the surface encloses below the base. Where data ends below the base, the surface may close there with a lid, and all
    of the space between this lid and the base is extrapolated. So a triangle of the lid, which faces the base and is
    not supported, has the prism from it up to the base: height times area as seen along the direction of the base.

    Args:
        corners: (m, 3, 3), of the triangles.
        upward: (m,), areas of the triangles as seen along the direction of the base; negative where they face away.
        heights: (m,), of their middles above the base.
        base: the plane.
        supported: (m,).
    """
    volumes = np.where(heights <= 0, _cones(corners, base.point), 0.0)
    lid = ~supported & (heights <= 0) & (upward > 0)
    volumes[lid] = -heights[lid] * upward[lid]
    return volumes


def _distances_from_data(
    points: Array, feet: Array, middles: Array, areas: Array, least: float
) -> tuple[NDArray[np.bool_], Array, float]:
    """Which points (n,) are data, the distances (m,) of the parts of a surface from it, and the limit of support.

    Args:
        points: (n, 3).
        feet: (n, 3), the points of the surface nearest to them.
        middles: (m, 3), of the parts of the surface.
        areas: (m,), of these parts.
        least: least limit; else it is the distance up to which the surface is interpolated (`interpolated`).
    """
    distinct, number = np.unique(feet, axis=0, return_inverse=True)
    if len(distinct) <= LIMITS.others:
        return np.zeros(len(points), dtype=np.bool_), np.full(len(middles), np.inf), 0.0
    tree = cKDTree(distinct)
    # of each foot point the first is itself: the nearest other, and the last of those that must be within the limit
    neighbours = tree.query(distinct, k=[2, 1 + LIMITS.others])[0]
    distances, nearest = tree.query(middles)
    limit = max(interpolated(distances, nearest, areas, float(np.median(neighbours[:, 0]))), least)
    limit = min(limit, LIMITS.widest * rms_length(points - points.mean(axis=0)))
    connected = neighbours[:, 1] <= limit
    if connected.any() and not connected.all():
        distances = cKDTree(distinct[connected]).query(middles)[0]
    return connected[number.reshape(-1)], distances, limit


def _farthest(points: Array, directions: Array) -> Array:
    """The largest coordinate (k,) of points (n, 3) along each direction (k, 3); a part of the directions at a time."""
    if not len(points):
        return np.full(len(directions), -np.inf)
    step = max(1, LIMITS.at_once // len(points))
    parts = [(directions[k : k + step] @ points.T).max(axis=1) for k in range(0, len(directions), step)]
    return np.concatenate(parts)


def _cones(corners: Array, apex: Array) -> Array:
    """Absolute volumes (m,) of the tetrahedra of triangles (m, 3, 3) and an apex."""
    a, b, c = (corners - apex).transpose(1, 0, 2)
    return np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6


def _fraction(values: Array, supported: NDArray[np.bool_]) -> float:
    """The share of the sum of values (m,) that is supported; 1 where the sum is zero."""
    total = float(values.sum())
    return float(values[supported].sum()) / total if total > 0 else 1.0


def covered_fraction(superquadric: Superquadric, points: Array, half_space: tuple[Array, Array] | None = None) -> float:
    """Fraction [0, 1] of even cells of the sphere, seen from the centre in units of the semi-axes, that have points.

    Cells whose surface point lies in the half-space (point, direction), where no data is expected, do not
    count. Kinds whose surface does not lie around their centre count as covered, without points as not.
    """
    if not len(points) or not superquadric.is_radial:
        return float(len(points) > 0)
    resolution = int(np.clip(np.sqrt(len(points) / PER_CELL / 6), 2, 8)) // 2 * 2
    cells, _ = sphere_grid(resolution)
    directions = unit_vectors(superquadric.to_local(points) / superquadric.semi_axes)
    seen = np.zeros(len(cells), dtype=bool)
    seen[cKDTree(cells).query(directions)[1]] = True  # the nearest direction stands for a cell
    if half_space is not None:
        at, direction = half_space
        seen = seen[(superquadric.surface(cells) - at) @ direction <= 0]
    return float(seen.mean()) if len(seen) else 0.0


# --- slices: whether all points lie in a few parallel ones, between which nothing checks the shape --------------------

MOST_SLICES = 4
"""Slices. The profile of a superquadric along an axis across them has four parameters, two ends, the largest width and
an exponent, so that so many slices determine it, and none is left that could contradict it."""
WITHIN_SLICE = 0.2
"""Points of a slice are nearer to its plane than this fraction of the least distance between slices, which is a band of
two fifths of that distance: of points that are spread evenly two fifths lie in it."""
NEARLY_ALL = 0.95
"""The fraction of the points that must lie so near to a slice; the others may be outliers that were not found."""
SLICE_ROUNDS = 20
"""Most rounds of k-means: each moves every slice to the mean height of the points nearest to it."""
LOOKED_AT = 500
"""Of more points a sample of so many is taken."""


def sparse_slices(points: Array) -> int:
    """The number of parallel slices that points (n, 3) lie in where it is two to four, else 0."""
    if len(points) <= MOST_SLICES:
        return 0
    some = points[spread_by_distance(points, LOOKED_AT)]
    for across in _directions(some):
        heights = some @ across
        edge = (1 - NEARLY_ALL) / 2
        low, high = np.quantile(heights, [edge, 1 - edge])
        for count in range(2, MOST_SLICES + 1):
            if _is_in_slices(heights, np.linspace(low, high, count)):
                return count
    return 0


def _directions(points: Array) -> Iterator[Array]:
    """Unit vectors (3,) across which points may lie in slices: those along which the steps to neighbours are shortest.

    The step to the nearest neighbours may be noise, and that to distant ones may lead to another slice. So one vector
    is found from the 2nd, one from the 4th, one from the 8th neighbours, and so on.
    """
    ranks = 2 ** np.arange(1, int(np.log2(len(points))))
    neighbours = cKDTree(points).query(points, k=ranks)[1]
    for rank in range(len(ranks)):
        steps = points[neighbours[:, rank]] - points
        yield np.linalg.eigh(steps.T @ steps)[1][:, 0]


def _is_in_slices(heights: Array, slices: Array) -> bool:
    """Whether heights (n,) lie near as many values as there are slices, found by k-means from these (m,)."""
    for _ in range(SLICE_ROUNDS):
        nearest = np.abs(heights[:, None] - slices).argmin(axis=1)
        sizes = np.bincount(nearest, minlength=len(slices))
        if not sizes.all():
            return False
        before, slices = slices, np.bincount(nearest, weights=heights) / sizes
        if (slices == before).all():
            break
    return bool((np.abs(heights - slices[nearest]) < WITHIN_SLICE * np.diff(slices).min()).mean() >= NEARLY_ALL)


def spread_by_distance(points: Array, count: int) -> NDArray[np.int64]:
    """Indices of at most `count` of (n, 3) points, spread over their distances from their centre."""
    return evenly_spread(np.argsort(((points - points.mean(axis=0)) ** 2).sum(axis=1)), count)


# --- one surface: whether points are of one, or of several bodies, a double wall, or a filled volume ------------------


@dataclass(frozen=True)
class Arrangement:
    """How points are arranged: by it they are of one surface, or of several bodies, a double wall, or a filled volume.

    Attributes:
        bodies: how many closed bodies the points are of, far from each other; 0 where no cluster of them is closed.
        layered: fraction of the neighbourhoods in which points form two layers along the normal.
        filled: fraction of the points that are deep inside.
    """

    bodies: int
    layered: float
    filled: float

    @classmethod
    def of(cls, mesh: Mesh, points: Array, feet: Array, signed: Array, limit: float) -> "Arrangement":
        """From a surface and its data.

        Args:
            mesh: of the surface.
            points: (n, 3), all that count.
            feet: (n, 3), their nearest points of the surface.
            signed: (n,), their distances, negative inside.
            limit: distance from data up to which the surface is supported.
        """
        layered = layered_fraction(feet, signed, rms_length(points - points.mean(axis=0)))
        return cls(closed_bodies(points, limit), layered, deep_fraction(signed, mean_thickness(mesh)))


def mean_thickness(mesh: Mesh) -> float:
    """2 |V| / A, from volume V and area A of a closed surface: that of a plate of this volume with this area.

    A plate of thickness t and area A / 2 on each side has V = t A / 2. A sphere of radius r has 2 r / 3.
    """
    return 2 * abs(mesh.volume()) / mesh.area()


def closed_bodies(points: Array, limit: float) -> int:
    """The number of separate closed bodies that points (n, 3) are of; 0 where no cluster of them is closed.

    Args:
        points: of one surface, as it was thought, or also of others that were left aside.
        limit: distance from data up to which the surface is supported.
    """
    if len(points) < ONE.fewest:
        return 0
    some = points[spread_by_distance(points, ONE.asked)]
    member = components(some, ONE.distant * limit)
    sizes = np.bincount(member)
    return sum(_is_closed(some[member == k]) for k in np.flatnonzero(sizes >= ONE.least * len(some)))


def _is_closed(points: Array) -> bool:
    """Whether points lie in all directions from their centre, in units of their own principal axes."""
    centred = points - points.mean(axis=0)
    values, axes = np.linalg.svd(centred, full_matrices=False)[1:]
    if len(points) < ONE.fewest or values[2] < 1e-6 * values[0]:
        return False
    chords = cKDTree(unit_vectors(centred @ axes.T / values)).query(sphere_grid(ONE.directions)[0])[0]
    return bool(2 * np.arcsin(chords.max() / 2) < ONE.open_angle)


def layered_fraction(feet: Array, deviations: Array, radius: float) -> float:
    """The fraction of neighbourhoods in which points form two layers along the normal.

    The signed distances of a neighbourhood are split at the threshold with the largest variance between the two parts
    (Otsu, IEEE Transactions on Systems, Man, and Cybernetics 9(1), 1979). They form two layers where the split explains
    most of their variance and the means of the parts are far enough from each other.

    Args:
        feet: (n, 3), on the surface.
        deviations: (n,), signed distances of the points.
        radius: RMS radius of the points.
    """
    if len(feet) < ONE.neighbours:
        return 0.0
    some = feet[spread_by_distance(feet, ONE.asked)]
    near = cKDTree(feet).query(some, k=ONE.neighbours)[1]
    ordered = np.sort(deviations[near], axis=1)
    # means of the inner and of the outer part for each number of points in the inner one
    counts = np.arange(1, ONE.neighbours)
    inner = np.cumsum(ordered, axis=1)[:, :-1] / counts
    outer = (ordered.sum(axis=1, keepdims=True) - inner * counts) / (ONE.neighbours - counts)
    between = counts * (ONE.neighbours - counts) * (outer - inner) ** 2 / ONE.neighbours**2
    between, steps = (each[:, ONE.layer - 1 : -(ONE.layer - 1)] for each in (between, outer - inner))
    rows, best = np.arange(len(near)), between.argmax(axis=1)
    is_split = between[rows, best] > ONE.split * np.maximum(ordered.var(axis=1), 1e-300)
    return float((is_split & (steps[rows, best] > ONE.thick * radius)).mean())


def deep_fraction(deviations: Array, thickness: float) -> float:
    """The fraction of points deep inside a body, by their signed distances (n,) and its mean thickness."""
    return float((deviations < -ONE.deep * thickness).mean()) if len(deviations) else 0.0
