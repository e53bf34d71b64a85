"""Where triangle meshes cross themselves or each other.

Two triangles cross exactly where an edge of one passes through the other, so edges are tested against triangles;
candidates share a cell of a grid. Touching counts as crossing; triangles that share a vertex are skipped.
"""

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes.different import different
from quadriform.shapes.mesh import Mesh

CELL = 1.5
"""Side of a grid cell, in mean sizes of a triangle's box."""
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
    triangles, faces, side = _together(mesh, other)
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    a, b = _sharing_a_cell(low, high)
    kept = (low[a] <= high[b]).all(axis=1) & (low[b] <= high[a]).all(axis=1)
    kept &= side[a] != side[b] if other is not None else ~_neighbours(faces[a], faces[b])
    a, b = a[kept], b[kept]
    found = [np.empty((0, 3))]
    for start in range(0, len(a), BLOCK):
        part = slice(start, start + BLOCK)
        one, two = triangles[a[part]], triangles[b[part]]
        found += [_pierced(one, two), _pierced(two, one)]
    return _distinct(np.concatenate(found))


def _together(mesh: Mesh, other: Mesh | None) -> tuple[Array, Index, NDArray[np.bool_]]:
    """All triangles (m, 3, 3), their vertex numbers (m, 3), and which belong to the second mesh."""
    first = mesh.vertices[mesh.faces]
    if other is None:
        return first, mesh.faces, np.zeros(len(first), dtype=bool)
    second = other.vertices[other.faces]
    faces = np.concatenate([mesh.faces, other.faces + len(mesh.vertices)])
    return np.concatenate([first, second]), faces, np.arange(len(faces)) >= len(first)


def _sharing_a_cell(low: Array, high: Array) -> tuple[Index, Index]:
    """Pairs a < b of boxes that enter the same cell of a grid, each once."""
    size = max(CELL * float((high - low).mean()), float((high - low).max()) / 30, 1e-300)
    first = np.floor((low - low.min(axis=0)) / size).astype(np.int64)
    last = np.floor((high - low.min(axis=0)) / size).astype(np.int64)
    counts = last - first + 1
    total = counts.prod(axis=1)
    owner = np.repeat(np.arange(len(low)), total)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(total) - total, total)
    along_yz, z = counts[owner, 1] * counts[owner, 2], counts[owner, 2]
    cell = first[owner] + np.stack([rank // along_yz, rank // z % counts[owner, 1], rank % z], axis=1)
    shape = last.max(axis=0) + 1
    code = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    order = np.lexsort((owner, code))
    return _pairs(code[order], owner[order], len(low))


def _pairs(code: Index, owner: Index, n: int) -> tuple[Index, Index]:
    """Pairs of owners within each run of equal codes."""
    end = np.searchsorted(code, code, side="right")
    later = end - np.arange(len(code)) - 1
    a = np.repeat(np.arange(len(code)), later)
    b = a + 1 + np.arange(len(a)) - np.repeat(np.cumsum(later) - later, later)
    return np.divmod(different(owner[a] * n + owner[b]), n)


def _neighbours(a: Index, b: Index) -> NDArray[np.bool_]:
    """Which pairs of triangles, vertex numbers (k, 3) each, share a vertex."""
    return (a[:, :, None] == b[:, None, :]).any(axis=(1, 2))


def _pierced(edges_of: Array, triangles: Array) -> Array:
    """Where edges of triangles (k, 3, 3) pass through their partners (k, 3, 3)."""
    corner = triangles[:, 0]
    u, v = triangles[:, 1] - corner, triangles[:, 2] - corner
    normal = np.cross(u, v)
    height = np.einsum("kei,ki->ke", edges_of - corner[:, None], normal)
    pair, edge = np.nonzero((height * np.roll(height, -1, axis=1) <= 0) & (height != np.roll(height, -1, axis=1)))
    start, stop = edges_of[pair, edge], edges_of[pair, (edge + 1) % 3]
    from_start, to_stop = height[pair, edge], height[pair, (edge + 1) % 3]
    points = start + (from_start / (from_start - to_stop))[:, None] * (stop - start)
    n, offset = normal[pair], points - corner[pair]
    squared = np.einsum("ki,ki->k", n, n)
    s = np.einsum("ki,ki->k", np.cross(offset, v[pair]), n) / squared
    t = np.einsum("ki,ki->k", np.cross(u[pair], offset), n) / squared
    return points[(s >= 0) & (t >= 0) & (s + t <= 1)]


def _distinct(points: Array) -> Array:
    """The points, without those found again from the neighbour across the edge."""
    if not len(points):
        return points
    size = max(float(np.ptp(points, axis=0).max()), float(np.abs(points).max()) * 1e-3, 1e-300)
    return points[np.sort(np.unique(np.round(points / size / 1e-9), axis=0, return_index=True)[1])]
