"""Closest points on a deformed superquadric, by damped Newton steps of foot points along the surface.

A foot point is kept as its origin on the undeformed superquadric. A step lies in the tangent plane there, and is
followed by the projection back onto the surface, so there is no chart and no pole. The starts that lead to the nearest
of several local minima are vertices of a grid over the surface, with bounds on what lies between. A target may have
several starts; `owner` is the index of the target that each of them, or the foot point it led to, belongs to.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.points import Array, lengths, unit_vectors
from quadriform.shapes import _kernel
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.mesh import ranks, sorted_unique
from quadriform.shapes.ridges import beside_ridges, has_ridges
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import threads_for
from quadriform.words import short_repr

MAX_STEPS = 60
SHALLOW = 0.3
"""Below this curvature of half the squared distance (1 on a plane) a second minimum may be hidden within a cell."""
EQUAL, SAME_POINT = 1e-10, 1e-6
"""Distances are equal, and points are the same, but for rounding: below these fractions of the box's diagonal."""
RESOLUTION = 32
"""Of the grid over the surface that a search starts from."""
NEAREST = 20
"""Vertices that are compared first; targets for which more of them may qualify are compared with all."""
MOST = 24
"""Most starts of one target; there are more near the centre of a sphere only, where all are equally near."""
SAFETY = 1.5
"""Factor from the sampled curvature of a cell to an upper bound of its curvature."""
SAME_FACE = 0.9
"""Cosine between the normals of neighbours that count as parts of one face."""
BLOCK = 256
BESIDE = 0.12
"""A coordinate below this fraction of the largest lies beside its plane."""
LEFT_OUT = 0.03
"""Foot points farther than the nearest by more than this fraction of the box's diagonal are no starts."""
SAME = 1e-3
"""Foot points in one cell of this fraction of the box's diagonal lead to the same minimum."""
ANY_SHAPE = (np.ones(2), 2.0, 2.0)
"""Exponents, hole radius and cut of a grid of which the numbers of the vertices alone count."""
ASYMMETRIC = np.array([1.0, 0.618, 0.271])
"""A direction that no symmetry of a superquadric leaves unchanged."""

Index = NDArray[np.int64]


@dataclass(frozen=True, repr=False)
class FootPoints:
    """The nearest surface point of each of n points.

    Attributes:
        origins: (n, 3), on the undeformed superquadric.
        points: (n, 3), the same after deformation.
        normals: (n, 3), unit, outward.
        signed: (n,), distance of the data, negative inside.
    """

    __repr__ = short_repr

    origins: Array
    points: Array
    normals: Array
    signed: Array


def closest_on(superquadric: Superquadric, box: ControlBox, targets: Array) -> FootPoints:
    """The globally nearest points to (n, 3) targets.

    The search starts at every vertex of a grid whose cell could contain the nearest point and that is nearer than its
    neighbours. Where the minimum found is shallow (near a focal point), it starts again on both sides of it. Beside the
    edges of exponents above 1 every part of the surface is searched separately.
    """
    candidates = CandidateIndex.of(superquadric, box)
    owner, vertex = candidates.starts(targets)
    found = _converge(superquadric, box, targets[owner], candidates.origins[vertex])
    owners, origins = [owner], [found.origins]
    best = _nearest(superquadric, box, owner, targets[owner], found.points)
    # Near a focal point the distance is flat, and a second minimum may lie within the same cell.
    flat = best[found.curvature[best] < SHALLOW]
    if len(flat):
        shifts = found.direction[flat] * candidates.cell[vertex[flat]][:, None]
        owners.append(np.tile(owner[flat], 4))
        again = np.tile(found.origins[flat], (4, 1)) + np.concatenate([k * shifts for k in (-2, -1, 1, 2)])
        origins.append(_converge(superquadric, box, targets[owners[-1]], superquadric.project(again)).origins)
    if has_ridges(superquadric):
        # Newton steps in the tangent plane fail where the curvature is infinite.
        others, feet = np.concatenate(owners), np.concatenate(origins)
        kept, beside = _feet_beside_planes(superquadric, box, targets, others, feet)
        index, found_beside = beside_ridges(superquadric, box, targets[others[kept]], feet[kept], beside)
        owners.append(others[kept][index])
        origins.append(found_beside)
    every_owner, every_origin = np.concatenate(owners), np.concatenate(origins)
    points = box.deform(every_origin)
    best = _nearest(superquadric, box, every_owner, targets[every_owner], points)
    return _foot_points(superquadric, box, targets, every_origin[best], points[best])


def update_foot_points(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, steps: int
) -> Array:
    """Origins (n, 3) after a few tangential Gauss-Newton steps towards their targets (n, 3); no foot point gets worse.

    A step takes the surface for flat. The error that remains is the step times distance times curvature, which is small
    for data near the surface; the next call continues from there.
    """
    result = np.array(origins, dtype=np.float64, order="C")
    given, threads = np.ascontiguousarray(targets), threads_for(len(targets))
    _kernel.update_foot_points(box.compiled(), superquadric.compiled(), _diagonal(box), given, result, steps, threads)
    return result


@dataclass(frozen=True)
class _Converged:
    """Foot points at local minima of the distance.

    Attributes:
        origins: (n, 3), on the undeformed superquadric.
        points: (n, 3), the same after deformation.
        curvature: (n,), the least one of half the squared distance over the surface.
        direction: (n, 3), in which it is least, before deformation.
    """

    origins: Array
    points: Array
    curvature: Array
    direction: Array


def _converge(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array) -> _Converged:
    """The local minima of |target - X|^2 that damped Newton steps over the two tangent coordinates lead to.

    In coordinates in which the deformed tangents are orthonormal the Hessian is 1 + distance x shape, the shape
    operator being the difference of two nearby normals. Directions in which the distance is at a maximum are
    followed downhill; a step that would lead away is rejected and shortened, so a foot point never gets worse.
    """
    moved, points, direction = np.array(origins, order="C"), np.empty_like(origins), np.empty_like(origins)
    curvature, threads = np.empty(len(origins)), threads_for(len(origins))
    given, diagonal = np.ascontiguousarray(targets), _diagonal(box)
    surface = superquadric.compiled()
    _kernel.converge_foot_points(
        box.compiled(), surface, diagonal, given, moved, points, curvature, direction, MAX_STEPS, threads
    )
    return _Converged(moved, points, curvature, direction)


def _diagonal(box: ControlBox) -> float:
    return float(np.linalg.norm(box.edges))


def _nearest(superquadric: Superquadric, box: ControlBox, owner: Index, targets: Array, points: Array) -> Index:
    """Index of the nearest point for each owner, in the owners' order.

    A target on a plane of symmetry, such as a voxel on the edge of a cube, has two or more nearest points. Rounding
    does not choose among these: the one farthest along a direction of the superquadric's frame is taken.
    """
    distance, along = lengths(targets - points), points @ (superquadric.rotation @ ASYMMETRIC)
    tied = distance <= _extreme(np.minimum, owner, distance) + EQUAL * _diagonal(box)
    along = np.where(tied, along, -np.inf)
    same = along >= _extreme(np.maximum, owner, along) - SAME_POINT * _diagonal(box)
    order = np.lexsort((np.where(same, distance, np.inf), owner))
    return np.asarray(order[np.unique(owner[order], return_index=True)[1]], dtype=np.int64)


def _extreme(least_or_most: np.ufunc, owner: Index, values: Array) -> Array:
    """For each of n values the least or the largest among those of the same owner, (n,)."""
    found = np.empty(owner.max(initial=-1) + 1)
    found[owner] = values
    least_or_most.at(found, owner, values)
    return np.asarray(found[owner])


def _feet_beside_planes(
    superquadric: Superquadric, box: ControlBox, targets: Array, owner: Index, origins: Array
) -> tuple[Index, NDArray[np.bool_]]:
    """Indices (k,) of near foot points beside a coordinate plane, one for each cell, and masks of small coordinates."""
    size, distance = _diagonal(box), lengths(targets[owner] - box.deform(origins))
    own = np.abs(superquadric.scaled(origins))
    beside = own < BESIDE * own.max(axis=1, keepdims=True)
    near = distance <= _extreme(np.minimum, owner, distance) + LEFT_OUT * size
    index = np.flatnonzero(near & beside.any(axis=1))
    cells = np.column_stack([owner[index], np.round(origins[index] / (SAME * size)).astype(np.int64)])
    kept = index[np.unique(cells, axis=0, return_index=True)[1]]
    return kept, beside[kept]


def _foot_points(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, points: Array
) -> FootPoints:
    """Foot points with normals and signed distances of their targets."""
    normals = surface_normals(superquadric, box, origins)
    offset = targets - points
    # A point on the surface has no side; it counts as outside, with distance zero.
    side = np.where(np.einsum("ij,ij->i", offset, normals) < 0, -1.0, 1.0)
    return FootPoints(origins, points, normals, side * lengths(offset))


def surface_normals(superquadric: Superquadric, box: ControlBox, origins: Array) -> Array:
    """Unit outward normals (n, 3) of the deformed surface at the images of its origins."""
    return surface_points(superquadric, box, origins)[1]


def surface_points(superquadric: Superquadric, box: ControlBox, origins: Array) -> tuple[Array, Array]:
    """Surface points (n, 3) after deformation, and the unit outward normals (n, 3) there."""
    given = np.ascontiguousarray(origins, dtype=np.float64)
    points, normals = np.empty_like(given), np.empty_like(given)
    _kernel.normals(box.compiled(), superquadric.compiled(), given, points, normals, threads_for(len(given)))
    return points, normals


@dataclass(frozen=True)
class CandidateIndex:
    """Vertices of a deformed surface, and how far the surface within their cells may be from them.

    Attributes:
        origins: (n, 3), before deformation.
        points: (n, 3), after.
        around: (k, n), for each the vertices of the adjoining cells that face nearly the same way, padded with the
            vertex itself: across an edge there may be a second minimum.
        cell: (n,), the largest distance of a surface point of its own cell.
        curvature: (n,), the largest of the surface within the cell, 1 / radius.
    """

    origins: Array
    points: Array
    around: Index
    cell: Array
    curvature: Array

    @classmethod
    def of(cls, superquadric: Superquadric, box: ControlBox) -> "CandidateIndex":
        """The index of a surface in a control box."""
        origins, quads = superquadric.grid(RESOLUTION)
        points = box.deform(origins)
        around = _neighbours(superquadric.kind)
        positions, normals = np.ascontiguousarray(points.T), np.ascontiguousarray(_vertex_normals(points, quads).T)
        chords = np.take(positions, around, axis=1) - positions[:, None]  # coordinate, neighbour, vertex
        # The curvature of a cell is that of circles through its vertex and each neighbour: 2 sag / chord^2.
        squared = np.einsum("ikn,ikn->kn", chords, chords)
        sag = np.abs(np.einsum("ikn,in->kn", chords, normals))
        alike = np.einsum("ikn,in->kn", np.take(normals, around, axis=1), normals) > SAME_FACE
        curvature = (2 * sag / np.maximum(squared, 1e-300)).max(axis=0)
        # A neighbour across an edge is replaced by the vertex itself, so that it hides no second minimum.
        around = np.where(alike, around, np.arange(len(points)))
        return cls(origins, points, around, 1.1 * np.sqrt(squared.max(axis=0)) / 2, SAFETY * curvature)

    @property
    def _coefficient(self) -> Array:
        """The coefficient c (n,) in the bound of the squared distance from a target x to a vertex v.

        Where the cell of v holds the surface point nearest to x, at distance d,

            |x - v|^2 <= d^2 + cell^2 + c d

        with c = cell^2 curvature by the second order of the surface, and c = 2 cell by the triangle inequality.
        """
        return np.minimum(self.cell**2 * self.curvature, 2 * self.cell)

    def starts(self, targets: Array) -> tuple[Index, Index]:
        """Pairs (target, vertex) to search from, sorted; the nearest vertex of each target is among them."""
        n, coefficient = len(self.points), self._coefficient
        distance, vertex = cKDTree(self.points).query(targets, k=NEAREST, workers=threads_for(len(targets)))
        nearest = distance[:, :1]
        # A vertex qualifies where its cell may come nearer than the nearest vertex (see `_coefficient`).
        room = distance**2 - nearest**2
        owner, column = np.nonzero(room <= self.cell[vertex] ** 2 + nearest * coefficient[vertex])
        ambiguous = np.flatnonzero(room[:, -1] <= self.cell.max() ** 2 + nearest[:, 0] * coefficient.max())
        codes = [owner * n + vertex[owner, column], *self._among_all(ambiguous, targets, nearest[:, 0])]
        return self._local_minima(targets, *np.divmod(sorted_unique(np.concatenate(codes)), n))

    def _among_all(self, ambiguous: Index, targets: Array, nearest: Array) -> list[Index]:
        """For ambiguous targets all vertices that qualify, as target * n + vertex."""
        if not len(ambiguous):
            return []
        centre, n = self.points.mean(axis=0), len(self.points)
        points = self.points - centre
        columns = np.column_stack([-2 * points, -self._coefficient]).T
        fixed = (points**2).sum(axis=1) - self.cell**2
        codes = []
        for start in range(0, len(ambiguous), BLOCK):
            part = ambiguous[start : start + BLOCK]
            x, d = targets[part] - centre, nearest[part]
            # |x - v|^2 - cell^2 - c d for all vertices at once, as one matrix product.
            excess = np.column_stack([x, d]) @ columns
            excess += fixed
            row, vertex = np.nonzero(excess <= (d**2 - (x**2).sum(axis=1) * (1 - 1e-14))[:, None])
            codes.append(part[row] * n + vertex)
        return codes

    def _local_minima(self, targets: Array, owner: Index, vertex: Index) -> tuple[Index, Index]:
        """Pairs whose vertex is as near as all its neighbours."""
        several = np.bincount(owner, minlength=len(targets))[owner] > 1
        o, v = owner[several], vertex[several]
        own = lengths(targets[o] - self.points[v])
        lowest = np.ones(len(o), dtype=bool)
        for neighbour in self.around:
            left = np.flatnonzero(lowest)
            ring = lengths(targets[o[left]] - self.points[neighbour[v[left]]])
            lowest[left] = own[left] <= ring * (1 + 1e-12)
        kept = ~several
        kept[several] = lowest
        owner, vertex = owner[kept], vertex[kept]
        count = np.unique(owner, return_counts=True)[1]
        # Near the centre of a sphere all vertices are equally near; an even selection is enough.
        thinned = ranks(count) % np.repeat(-(-count // MOST), count) == 0
        return owner[thinned], vertex[thinned]


@lru_cache(maxsize=len(KINDS))
def _neighbours(kind: str) -> Index:
    """For each of n vertices the others of its cells, (k, n), padded with itself; alike for all surfaces of a kind."""
    vertices, quads = KINDS[kind].grid(RESOLUTION, *ANY_SHAPE)
    n = len(vertices)
    pairs = np.concatenate([quads[:, [i, j]] for i in range(4) for j in range(4) if i != j])
    one, other = np.divmod(sorted_unique(pairs[:, 0] * n + pairs[:, 1]), n)
    rank = ranks(np.bincount(one))  # of each pair among those of its vertex
    table = np.tile(np.arange(n), (int(rank.max()) + 1, 1))
    table[rank, one] = other
    return table


def _vertex_normals(points: Array, quads: Index) -> Array:
    """Unit normals (n, 3), the mean of the adjoining cells' area vectors."""
    corners = points[quads]
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    total = np.stack([np.bincount(quads.ravel(), np.repeat(area[:, k], 4), len(points)) for k in range(3)], axis=1)
    return unit_vectors(total)
