"""Which points of a regular grid lie inside a closed mesh."""

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes.mesh import Mesh, ranks

OFF_GRID = (0.5772157e-7, 0.6931472e-7)
"""Columns of voxel centres are moved so far, in voxels, lest they run along the edges of triangles."""


def voxel_spacing(world_from_voxel: Array) -> Array:
    """Return the distances (3,) between neighbouring voxel centres: the column lengths of a transform (4, 4)."""
    return np.linalg.norm(world_from_voxel[:3, :3], axis=0)


def voxels_inside(mesh: Mesh, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which voxels have their centre inside a closed mesh, given in voxel coordinates; by its windings."""
    corners = mesh.vertices[mesh.faces]
    triangle, i, j = _columns(corners, shape)
    a, b, c = (corners[triangle, n] for n in range(3))
    at = np.stack([i + OFF_GRID[0], j + OFF_GRID[1]], axis=1)
    # A column meets a triangle where the three areas towards it have the sign of the whole.
    areas = [_cross(q - p, at - p) for p, q in ((b[:, :2], c[:, :2]), (c[:, :2], a[:, :2]), (a[:, :2], b[:, :2]))]
    total = np.sum(areas, axis=0)
    hit = (np.sign(areas) == np.sign(total)).all(axis=0) & (total != 0)
    height = (np.stack(areas) * [a[:, 2], b[:, 2], c[:, 2]]).sum(axis=0)[hit] / total[hit]
    first = np.clip(np.ceil(height), 0, shape[2]).astype(np.int64)
    # Each crossing adds its orientation to all voxels above it; inside, the sum is not zero.
    windings = np.zeros((shape[0], shape[1], shape[2] + 1), dtype=np.int64)
    np.add.at(windings, (i[hit], j[hit], first), np.sign(total[hit]).astype(np.int64))
    inside: NDArray[np.bool_] = np.cumsum(windings, axis=2)[:, :, :-1] != 0
    return inside


def _columns(corners: Array, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
    """Triangles with each column of voxels (i, j) that passes through the rectangle around them."""
    low = np.clip(np.floor(corners[:, :, :2].min(axis=1)), 0, shape[:2]).astype(np.int64)
    high = np.clip(np.ceil(corners[:, :, :2].max(axis=1)) + 1, 0, shape[:2]).astype(np.int64)
    size = np.maximum(high - low, 0)
    counts = size.prod(axis=1)
    triangle = np.repeat(np.arange(len(corners)), counts)
    rank, width = ranks(counts), size[triangle, 1]
    return triangle, low[triangle, 0] + rank // width, low[triangle, 1] + rank % width


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
