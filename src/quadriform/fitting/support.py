"""How far data supports a fitted surface, measured from each part of it; whether points are of one surface.

`diagnostics.py` derives warnings from these measures. The option `support` is something else: a plane such as a table.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from quadriform.fitting.interpolation import interpolated
from quadriform.points import Array, unit_vectors
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class Limits:
    """The constants of support."""

    widest: float = 0.5
    """Largest limit, in RMS radii of the points. Gaps of more than two thirds of a radius are not interpolated: the
    shape there is unknown, and so few slices do not show their usual distance."""
    noise: float = 3.0
    """Standard deviations of the noise within which a point can be from the part of the surface that it measures."""
    at_base: float = 2.0
    """Standard deviations of the noise within which a surface that closes at its base is not distinguished from it."""
    others: int = 2
    """A point with fewer others within the limit is no data: an outlier whose place no other confirms. Of random points
    on a surface one in 5,000 has fewer."""
    resolution: int = 32
    """Of the mesh whose triangles are the parts."""
    directions: int = 12
    """Of the grid of directions in which a surface can extend beyond the data: one every eight degrees."""
    at_once: int = 300_000
    """Products of points and directions that are in memory at a time: more leave the cache."""


LIMITS = Limits()
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
        volume: share [0, 1] of the volume, seen from the centre of the data, that lies below supported area.
        below: the same of the volume below the base, seen from a point of it; that of all without a base.
        within: the share of the area on this side of the base, or of the volume there where that is less; the share of
            all of the area without a base.
        limit: distance from data up to which a part is supported, in the unit of the points.
        extends_beyond: how far the surface reaches beyond the data in the direction where that is farthest, likewise.
        reach: the same of the part on this side of the base.
        slices: number of parallel slices that all data lies in, where it is so small that nothing checks the shape
            between them; else 0.
    """

    area: float
    volume: float
    below: float
    within: float
    limit: float
    extends_beyond: float
    reach: Reach
    slices: int = 0

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
    """The support of a surface by its data.

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
    connected, distances, limit = _data(points, feet, middles, areas, max(LIMITS.noise * noise, step))
    points = points[connected]
    if not len(points):
        far = float(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1).max())
        return Support(0.0, 0.0, 0.0, 0.0, 0.0, far, Reach(far, 0.0))
    supported = distances <= limit
    volumes = below = _cones(corners, points.mean(axis=0))
    extends = reach = Reach.of(mesh.vertices, points)
    area = within = _fraction(areas, supported)
    if base is not None:
        heights = base.heights(middles)
        below = np.where(heights <= 0, _cones(corners, base.point), 0.0)
        # where it closes below the base for want of data, all of the space up to the base is extrapolated
        lid = ~supported & (heights <= 0) & (across @ base.direction > 0)
        below[lid] = -heights[lid] * (across[lid] @ base.direction)
        before = np.where(heights <= -LIMITS.at_base * noise, areas, 0.0)
        within = min(_fraction(before, supported), _fraction(below, supported))
        reach = Reach.of(mesh.vertices[base.heights(mesh.vertices) <= 0], points)
    fractions = area, _fraction(volumes, supported), _fraction(below, supported), within
    return Support(*fractions, limit, extends.distance, reach, sparse_slices(points))


def _data(
    points: Array, feet: Array, middles: Array, areas: Array, least: float
) -> tuple[NDArray[np.bool_], Array, float]:
    """Which points (n,) are data, the distances (m,) from it of the parts of a surface, and the limit of support."""
    distinct, number = np.unique(feet, axis=0, return_inverse=True)
    if len(distinct) <= LIMITS.others:
        return np.zeros(len(points), dtype=np.bool_), np.full(len(middles), np.inf), 0.0
    tree = cKDTree(distinct)
    neighbours = tree.query(distinct, k=[2, 1 + LIMITS.others])[0]
    distances, nearest = tree.query(middles)
    limit = max(interpolated(distances, nearest, areas, float(np.median(neighbours[:, 0]))), least)
    limit = min(limit, LIMITS.widest * _radius(points))
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


def _radius(points: Array) -> float:
    """The RMS distance of points (n, 3) from their centre."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


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


# --- slices ------------------------------------------------------------------------------------------------------

MOST_SLICES = 4
"""Slices. The profile of a superquadric along an axis across them has four parameters, two ends, the largest width and
an exponent, so that so many slices determine it, and none is left that could contradict it."""
WITHIN_SLICE = 0.2
"""Points of a slice are within this fraction of the least distance between slices; of even points two fifths are."""
NEARLY_ALL = 0.95
"""The fraction of the points that must be; the others may be outliers that were not found."""
SLICE_ROUNDS = 20
"""Of moving each slice to the mean height of the points nearest to it."""
LOOKED_AT = 500
"""Of more points an even sample is taken."""


def sparse_slices(points: Array) -> int:
    """The number of parallel slices that points (n, 3) lie in where it is two to four, else 0."""
    if len(points) <= MOST_SLICES:
        return 0
    some = points[_chosen(points, LOOKED_AT)]
    for across in _directions(some):
        heights = some @ across
        edge = (1 - NEARLY_ALL) / 2
        low, high = np.quantile(heights, [edge, 1 - edge])
        for count in range(2, MOST_SLICES + 1):
            if _is_in_slices(heights, np.linspace(low, high, count)):
                return count
    return 0


def _directions(points: Array) -> Iterator[Array]:
    """Unit vectors (3,) across which points may lie in slices: those least along the steps to neighbours.

    Near neighbours are apart by noise, distant ones may be of another slice, so neighbours of several ranks are tried.
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


# --- one surface -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OneSurface:
    """The constants of the tests whether points are of one surface."""

    asked: int = 2000
    """Points of an even sample, of which all near pairs are considered."""
    distant: float = 2.25
    """Points farther from all others than this many limits of support are of another cluster: far above the distance
    between slices, which is that limit."""
    least: float = 0.1
    """Least fraction of the points in a cluster that is a body."""
    fewest: int = 100
    """Least number of points in a cluster that is a body."""
    open_angle: float = np.radians(40)
    """Widest empty cone of a closed body of that many points, seen from its centre in units of its axes. That many
    random directions leave 25 degrees empty; half an ellipsoid, such as an end of a body without data in its middle,
    50 degrees."""
    directions: int = 8
    """Resolution of the grid of directions among which the widest empty cone is found."""
    neighbours: int = 16
    """Points of a neighbourhood in which two layers are sought."""
    layer: int = 4
    """Least number of these that are of the smaller layer."""
    split: float = 0.85
    """Least fraction of the variance of 16 neighbours that two layers explain. The best two halves of normal deviates
    explain two thirds, of uniform ones three quarters."""
    thick: float = 0.1
    """Least distance of layers in RMS radii, twice the distance of a poor fit: voxels and noise make thinner ones."""
    layered: float = 0.5
    """Fraction of neighbourhoods with two layers above which the points are of a double wall."""
    deep: float = 1 / 3
    """Depth, as a fraction of the mean thickness of a body, below which points are not of its surface."""
    most: float = 0.1
    """Largest fraction of the points deep inside; outliers everywhere around a body leave less than half of that."""


ONE = OneSurface()


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
        thickness = 2 * abs(mesh.volume()) / mesh.area()
        return cls(bodies(points, limit), layered(feet, signed, _radius(points)), filled(signed, thickness))


def bodies(points: Array, limit: float) -> int:
    """The number of separate closed bodies that points (n, 3) are of; 0 where no cluster of them is closed.

    Args:
        points: of one surface, as it was thought, or also of others that were left aside.
        limit: distance from data up to which the surface is supported.
    """
    if len(points) < ONE.fewest:
        return 0
    some = points[_chosen(points, ONE.asked)]
    pairs = cKDTree(some).query_pairs(ONE.distant * limit, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(some),) * 2)
    member = connected_components(graph, directed=False)[1]
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


def layered(feet: Array, deviations: Array, radius: float) -> float:
    """The fraction of neighbourhoods in which points form two layers along the normal.

    Args:
        feet: (n, 3), on the surface.
        deviations: (n,), signed distances of the points.
        radius: RMS radius of the points.
    """
    if len(feet) < ONE.neighbours:
        return 0.0
    some = feet[_chosen(feet, ONE.asked)]
    near = cKDTree(feet).query(some, k=ONE.neighbours)[1]
    ordered = np.sort(deviations[near], axis=1)
    # the best split into an inner and an outer layer: that of the largest variance between their means
    counts = np.arange(1, ONE.neighbours)
    inner = np.cumsum(ordered, axis=1)[:, :-1] / counts
    outer = (ordered.sum(axis=1, keepdims=True) - inner * counts) / (ONE.neighbours - counts)
    between = counts * (ONE.neighbours - counts) * (outer - inner) ** 2 / ONE.neighbours**2
    between, steps = (each[:, ONE.layer - 1 : -(ONE.layer - 1)] for each in (between, outer - inner))
    rows, best = np.arange(len(near)), between.argmax(axis=1)
    is_split = between[rows, best] > ONE.split * np.maximum(ordered.var(axis=1), 1e-300)
    return float((is_split & (steps[rows, best] > ONE.thick * radius)).mean())


def _chosen(points: Array, count: int) -> NDArray[np.int64]:
    """Indices of at most `count` of (n, 3) points, spread over their distances from their centre."""
    order = np.argsort(((points - points.mean(axis=0)) ** 2).sum(axis=1))
    return order[np.linspace(0, len(order) - 1, min(count, len(order))).astype(np.int64)]


def filled(deviations: Array, thickness: float) -> float:
    """The fraction of points deep inside a body, by their signed distances (n,) and its mean thickness."""
    return float((deviations < -ONE.deep * thickness).mean()) if len(deviations) else 0.0
