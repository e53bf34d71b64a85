"""The points that stand for a triangle mesh in a fit: its vertices where they are dense, else points spread by area."""

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes.mesh import Mesh

DENSE = 0.2
"""Vertices are dense where no edge is longer than this share of the root of the area (0.7 radii of a sphere)."""
SPARSE_AREA = 0.01
"""Share of the area that may lie in longer triangles: slivers and filled pinholes do not make a dense mesh sparse."""
SAMPLES, MOST_SAMPLES = 5000, 50_000
"""Points by area: as many as there are vertices, within these limits."""
STEPS = np.array([0.7548776662466927, 0.5698402909980532])
"""Of the sequence that fills the unit square evenly: 1/p and 1/p^2 with p^3 = p + 1 (M. Roberts, 2018)."""
GRID_BITS = 21
"""Cells of the curve that orders the triangles, along each axis, as a power of two; three fit in 64 bits."""


def mesh_points(mesh: Mesh) -> tuple[Array, str | None]:
    """Points (n, 3) of a mesh's surface for a fit, and a note on how they were taken; None where they are the vertices.

    Where the vertices are dense they are returned as they are, in their order. Elsewhere, as in a block of twelve
    triangles, vertices do not show where the surface is between them: points are spread evenly over its area then. The
    order of vertices and triangles does not matter, nor do triangles that are listed twice or have no area; vertices
    that no triangle uses are added as they are. The same mesh gives the same points.

    Args:
        mesh: open or closed, in any unit.
    """
    faces = _distinct_faces(mesh)
    corners, scale = _unit_corners(mesh, faces)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    if not _sparse(corners, areas):
        return mesh.vertices, None
    alone = np.setdiff1d(np.arange(len(mesh.vertices)), mesh.faces)
    count = int(np.clip(len(mesh.vertices) - len(alone), SAMPLES, MOST_SAMPLES))
    # in a cube of side one for the areas, then in the world with the same barycentric weights
    triangle, weights = _spread(corners, areas, count)
    points = np.einsum("nk,nki->ni", weights, mesh.vertices[faces[triangle]])
    spacing = scale * np.sqrt(areas.sum() / count)
    note = f"{count} points spread evenly over the area of {len(faces)} triangles, {spacing:.3g} apart, stand for "
    note += f"the mesh: its {len(mesh.vertices)} vertices leave large parts of the surface without points"
    note += f"; {len(alone)} vertices that no triangle uses were added" if len(alone) else ""
    return np.concatenate([points, mesh.vertices[alone]]), note


def _distinct_faces(mesh: Mesh) -> NDArray[np.int64]:
    """Each triangle once, (m, 3), whatever its winding and its first corner; its corners in canonical order."""
    _, first, number = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    return first[np.unique(np.sort(number.reshape(-1)[mesh.faces], axis=1), axis=0)]


def _unit_corners(mesh: Mesh, faces: NDArray[np.int64]) -> tuple[Array, float]:
    """Corners (m, 3, 3) in a cube of side one, so that no area underflows; and the extent."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    half = float((high / 2 - low / 2).max()) or 0.5  # halves: the largest numbers must not overflow
    return (mesh.vertices[faces] / 2 - low / 2) / half, 2 * half


def _sparse(corners: Array, areas: Array) -> bool:
    total = areas.sum()
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0)
    return bool(areas[edges > DENSE * np.sqrt(total)].sum() > SPARSE_AREA * total)


def _spread(corners: Array, areas: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    """Triangle (count,) and barycentric weights (count, 3) of points at equal steps of the area."""
    order = np.argsort(_curve(corners.mean(axis=1)), kind="stable")
    total = np.cumsum(areas[order])
    at = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    square = np.mod(np.arange(1, count + 1)[:, None] * STEPS, 1.0)  # any run of it is even, so each triangle's is
    square = np.where(square.sum(axis=1, keepdims=True) > 1, 1 - square, square)  # the triangle is half of the square
    return order[at], np.column_stack([1 - square.sum(axis=1), square])


def _curve(points: Array) -> NDArray[np.int64]:
    """Position along a curve through all cells of a grid (Z order): near each other in space are near on the curve."""
    cells = np.minimum(points * 2**GRID_BITS, 2**GRID_BITS - 1).astype(np.int64)
    # the bits of the three coordinates in turn, the highest first
    return sum((((cells >> bit) & 1) @ [4, 2, 1]) << 3 * bit for bit in range(GRID_BITS))
