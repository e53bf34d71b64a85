"""A triangle mesh and what can be read off it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array


@dataclass(frozen=True)
class Mesh:
    """Triangles in space, counter-clockwise seen from outside.

    Attributes:
        vertices: (n, 3), in the unit of the data.
        faces: (m, 3) int64, indices into `vertices`.
    """

    vertices: Array
    faces: NDArray[np.int64]

    def area_vectors(self) -> Array:
        """Outward area vectors of the triangles, (m, 3): direction normal, length area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a) / 2

    def area(self) -> float:
        """Sum of the triangles' areas, in squared units."""
        return float(np.linalg.norm(self.area_vectors(), axis=1).sum())

    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, in cubed units; meaningful for closed meshes."""
        centred = self.vertices - self.vertices.mean(axis=0)
        a, b, c = (centred[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    def is_closed(self) -> bool:
        """Whether every edge is run through as often one way as the other; vertices are told apart by their number."""
        start, stop, n = self.faces.reshape(-1), np.roll(self.faces, -1, axis=1).reshape(-1), len(self.vertices)
        return np.array_equal(np.sort(start * n + stop), np.sort(stop * n + start))
