"""Intersections of triangle meshes with themselves or each other.

Two triangles cross exactly where an edge of one passes through the other, so edges are tested against triangles;
candidates share a cell of a grid. Touching counts as crossing; triangles that share a vertex are skipped.
"""

from functools import reduce
from itertools import product

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array, unit_vectors
from quadriform.shapes.mesh import Mesh, ranks, solid_angles, sorted_unique

CELL = 1.5
"""Side of a grid cell, in mean sizes of a triangle's box."""
MOST = 30
"""Lengths of a grid cell, at most, along the largest triangle."""
FILLED = 1e-6
"""Largest error of the sum of solid angles of triangles that cover the sphere once; covered twice it is 4 pi larger."""
LEAST = 1e-12
"""Solid angle of a triangle above which rounding does not change its sign."""
BLOCK = 200_000
"""Pairs of triangles tested at once."""

Index = NDArray[np.int64]


def crossings(mesh: Mesh, other: Mesh | None = None) -> Array:
    """Points where the edges of triangles pass through other triangles.

    Args:
        mesh: triangles, open or closed.
        other: a second mesh; without it the mesh is tested against itself.

    Returns:
        (n, 3), in the unit of the meshes; an empty array where nothing crosses. Flat faces that lie in one plane are
        seen by the edges of their neighbours only.
    """
    if other is None and _is_star_shaped(mesh):
        return np.empty((0, 3))
    triangles, faces, side = _together(mesh, other)
    corners = [triangles[:, corner] for corner in range(3)]
    low, high = reduce(np.minimum, corners), reduce(np.maximum, corners)
    a, b = _sharing_a_cell(low, high)
    if other is not None:
        across = side[a] != side[b]
        a, b = a[across], b[across]
    a, b = _overlapping(low, high, a, b)
    if other is None:
        disjoint = ~_neighbours(faces, a, b)
        a, b = a[disjoint], b[disjoint]
    a, b = np.divmod(sorted_unique(a * len(faces) + b), len(faces))
    found = [np.empty((0, 3))]
    for start in range(0, len(a), BLOCK):
        part = slice(start, start + BLOCK)
        one, two = triangles[a[part]], triangles[b[part]]
        found += [_pierced(one, two), _pierced(two, one)]
    return _distinct(np.concatenate(found))


def _is_star_shaped(mesh: Mesh) -> bool:
    """Whether every ray from the centroid meets a closed mesh once: then it does not intersect itself.

    All triangles have positive solid angles seen from the centroid, and these sum up to that of the sphere.
    """
    rays = unit_vectors(mesh.vertices - mesh.vertices.mean(axis=0))
    views = solid_angles(*(rays[corner] for corner in mesh.faces.T))
    return bool((views > LEAST).all() and abs(views.sum() - 4 * np.pi) < FILLED) and mesh.is_closed()


def _together(mesh: Mesh, other: Mesh | None) -> tuple[Array, Index, NDArray[np.bool_]]:
    """All triangles (m, 3, 3), their vertex numbers (m, 3), and which belong to the second mesh."""
    first = mesh.vertices[mesh.faces]
    if other is None:
        return first, mesh.faces, np.zeros(len(first), dtype=bool)
    second = other.vertices[other.faces]
    faces = np.concatenate([mesh.faces, other.faces + len(mesh.vertices)])
    return np.concatenate([first, second]), faces, np.arange(len(faces)) >= len(first)


def _sharing_a_cell(low: Array, high: Array) -> tuple[Index, Index]:
    """Pairs a < b of boxes that enter the same cell of a grid, once for each such cell."""
    # Cells of the mean size, unless one box is so large that it would enter too many of them.
    size = max(CELL * float((high - low).mean()), float((high - low).max()) / MOST, 1e-300)
    first = np.floor((low - low.min(axis=0)) / size).astype(np.int64)
    last = np.floor((high - low.min(axis=0)) / size).astype(np.int64)
    shape = last.max(axis=0) + 1
    owner, code = np.arange(len(low)), np.zeros(len(low), dtype=np.int64)
    for axis in range(3):  # a box stands in the list once for each cell along this axis
        counts = (last[:, axis] - first[:, axis] + 1)[owner]
        owner, code = np.repeat(owner, counts), np.repeat(code, counts)
        code = code * shape[axis] + first[owner, axis] + ranks(counts)
    order = np.argsort(code, kind="stable")  # stable: owners rise within a cell
    return _pairs(code[order], owner[order])


def _pairs(code: Index, owner: Index) -> tuple[Index, Index]:
    """Pairs of owners within each run of equal codes."""
    # The k-th entry of a run pairs with all later entries of the run.
    end = np.searchsorted(code, code, side="right")
    later = end - np.arange(len(code)) - 1
    a = np.repeat(np.arange(len(code)), later)
    b = a + 1 + ranks(later)
    return owner[a], owner[b]


def _overlapping(low: Array, high: Array, a: Index, b: Index) -> tuple[Index, Index]:
    """The pairs whose boxes overlap; axis by axis, for most are separate along the first."""
    for lowest, highest in zip(low.T.copy(), high.T.copy()):
        met = (lowest[a] <= highest[b]) & (lowest[b] <= highest[a])
        a, b = a[met], b[met]
    return a, b


def _neighbours(faces: Index, a: Index, b: Index) -> NDArray[np.bool_]:
    """Which pairs of triangles, of vertex numbers (m, 3), share a vertex."""
    shared = np.zeros(len(a), dtype=bool)
    ones, others = ([column[side] for column in faces.T.copy()] for side in (a, b))
    for one, other in product(ones, others):
        shared |= one == other
    return shared


def _pierced(edges_of: Array, triangles: Array) -> Array:
    """Points where edges of triangles (k, 3, 3) pass through their partners (k, 3, 3)."""
    corner = triangles[:, 0]
    u, v = triangles[:, 1] - corner, triangles[:, 2] - corner
    normal = np.cross(u, v)
    height = np.einsum("kei,ki->ke", edges_of - corner[:, None], normal)
    # An edge crosses the plane of a triangle where its ends lie on different sides.
    pair, edge = np.nonzero((height * np.roll(height, -1, axis=1) <= 0) & (height != np.roll(height, -1, axis=1)))
    start, stop = edges_of[pair, edge], edges_of[pair, (edge + 1) % 3]
    from_start, to_stop = height[pair, edge], height[pair, (edge + 1) % 3]
    points = start + (from_start / (from_start - to_stop))[:, None] * (stop - start)
    n, offset = normal[pair], points - corner[pair]
    squared = np.einsum("ki,ki->k", n, n)
    # Barycentric coordinates of the crossing within the triangle.
    s = np.einsum("ki,ki->k", np.cross(offset, v[pair]), n) / squared
    t = np.einsum("ki,ki->k", np.cross(u[pair], offset), n) / squared
    return points[(s >= 0) & (t >= 0) & (s + t <= 1)]


def _distinct(points: Array) -> Array:
    """The points, without those found again from the neighbour across the edge."""
    if not len(points):
        return points
    size = max(float(np.ptp(points, axis=0).max()), float(np.abs(points).max()) * 1e-3, 1e-300)
    return points[np.sort(np.unique(np.round(points / size / 1e-9), axis=0, return_index=True)[1])]
