"""Grids of samples and quads on the unit sphere, on the torus and on a disc, for the surfaces of all kinds.

The sphere's grid is that of a cube, projected: without poles and slivers, invariant under the symmetries of the cube,
with lines on the coordinate planes and on the cube's edges, where superellipsoids have their edges.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes.mesh import Faces


@lru_cache(maxsize=16)
def sphere_grid(resolution: int) -> tuple[Array, Faces]:
    """Unit directions and the quads between them.

    Args:
        resolution: cells along an edge of the cube, made even; n gives 6 n^2 + 2 directions.

    Returns:
        Directions (6 n^2 + 2, 3) and quads (6 n^2, 4), counter-clockwise from outside. Do not write into them.
    """
    n = 2 * max(1, (resolution + 1) // 2)
    corners, quads = _cube_surface(n)
    # Equal angles instead of equal lengths along the edges make the cells of similar size.
    tangents = np.tan(np.pi / 4 * (2 * corners / n - 1))
    directions = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    directions.setflags(write=False)
    return directions, quads


def _cube_surface(n: int) -> tuple[NDArray[np.int64], Faces]:
    """Integer points (k, 3) of the surface of the cube [0, n]^3 and its unit quads (6 n^2, 4)."""
    i, j = (g.ravel() for g in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    loops = []
    for axis in range(3):
        for level in (0, n):
            # counter-clockwise from outside: the other way round on the opposite face
            around = [(0, 0), (1, 0), (1, 1), (0, 1)] if level else [(0, 0), (0, 1), (1, 1), (1, 0)]
            quad = np.empty((n * n, 4, 3), np.int64)
            quad[:, :, axis] = level
            for corner, (di, dj) in enumerate(around):
                quad[:, corner, (axis + 1) % 3], quad[:, corner, (axis + 2) % 3] = i + di, j + dj
            loops.append(quad)
    # each lattice point has one number, so that faces share the points on their common edges
    codes = np.concatenate(loops).reshape(-1, 3) @ np.array([(n + 1) ** 2, n + 1, 1])
    used = np.zeros((n + 1) ** 3, dtype=bool)
    used[codes] = True
    number = np.cumsum(used) - 1
    return np.stack(np.unravel_index(np.flatnonzero(used), (n + 1,) * 3), axis=1), number[codes].reshape(-1, 4)


@lru_cache(maxsize=16)
def torus_grid(resolution: int) -> tuple[Array, Faces]:
    """Latitude and longitude (n, 2) on a torus, 2 n of the first by 4 n of the second, and the quads between."""
    rows, columns = 2 * max(2, resolution), 4 * resolution  # two rows would fold onto themselves
    return _angle_grid(2 * np.pi * np.arange(rows) / rows, 2 * np.pi * np.arange(columns) / columns, wrap_rows=True)


def tube_grid(latitudes: Array, columns: int) -> tuple[Array, Faces]:
    """Given latitudes by an even ring of longitudes: (n, 2) angles and quads, open at both ends."""
    return _angle_grid(latitudes, 2 * np.pi * np.arange(columns) / columns, wrap_rows=False)


def _angle_grid(latitudes: Array, longitudes: Array, wrap_rows: bool) -> tuple[Array, Faces]:
    rows, columns = len(latitudes), len(longitudes)
    angles = np.stack(np.meshgrid(latitudes, longitudes, indexing="ij"), -1).reshape(-1, 2)
    index = np.arange(rows * columns).reshape(rows, columns)
    up = np.roll(index, -1, axis=0) if wrap_rows else index[1:]
    low = index if wrap_rows else index[:-1]
    quads = np.stack([low, np.roll(low, -1, axis=1), np.roll(up, -1, axis=1), up], -1).reshape(-1, 4)
    return angles, quads


@lru_cache(maxsize=16)
def disc_grid(resolution: int) -> tuple[Array, Faces]:
    """Points (n, 2) of the unit disc and quads between them: half of the projected cube, flattened.

    Rays and distances along them are preserved, so cells are distorted little, in the middle and at the rim.
    """
    directions, quads = sphere_grid(resolution)
    upper = quads[(directions[quads, 0] > -1e-12).all(axis=1)]
    kept, index = np.unique(upper, return_inverse=True)
    x, yz = directions[kept, 0], directions[kept, 1:]
    around = np.linalg.norm(yz, axis=1)
    radius = np.arctan2(around, x) / (np.pi / 2)
    return yz * (radius / np.maximum(around, 1e-300))[:, None], index.reshape(-1, 4)
