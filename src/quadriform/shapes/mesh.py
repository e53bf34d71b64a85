"""A triangle mesh, its measures, and triangles from quads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array, lengths
from quadriform.words import short_repr

Faces = NDArray[np.int64]


@dataclass(frozen=True, repr=False)
class Mesh:
    """Triangles in space, counter-clockwise seen from outside.

    Attributes:
        vertices: (n, 3), in the unit of the data.
        faces: (m, 3) int64, indices into `vertices`.
    """

    __repr__ = short_repr

    vertices: Array
    faces: Faces

    def area_vectors(self) -> Array:
        """Outward area vectors of the triangles, (m, 3): direction normal, length area."""
        a, b, c = corners(self.vertices, self.faces)
        return np.cross(b - a, c - a) / 2

    def area(self) -> float:
        """Sum of the triangles' areas, in squared units."""
        return float(lengths(self.area_vectors()).sum())

    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, in cubed units; meaningful for closed meshes."""
        # Far from the origin the tetrahedra would cancel to few digits.
        centred = self.vertices - self.vertices.mean(axis=0)
        a, b, c = corners(centred, self.faces)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    def is_closed(self) -> bool:
        """Whether every edge occurs as often in one direction as in the other; vertices are compared by number."""
        # Edges as single whole numbers: the directed edges of a closed mesh are a permutation of their reverses.
        start, stop, n = self.faces.reshape(-1), np.roll(self.faces, -1, axis=1).reshape(-1), len(self.vertices)
        return np.array_equal(np.sort(start * n + stop), np.sort(stop * n + start))


def corners(vertices: Array, faces: Faces) -> list[Array]:
    """The vertices (m, 3) at the first corner of all faces, at the second, and so on."""
    return [vertices.take(column, axis=0) for column in faces.T]


def split_quads(quads: Faces, vertices: Array) -> Faces:
    """Two triangles for each quad (m, 4), cut along the shorter diagonal (ties keep the first)."""
    a, b, c, d = corners(vertices, quads)
    first = lengths(a - c) <= lengths(b - d) * (1 + 1e-9)
    one, two, three, four = quads.T
    # one, two, three and one, three, four; or one, two, four and two, three, four
    columns = (one, two, np.where(first, three, four), np.where(first, one, two), three, four)
    return np.stack(columns, axis=1).reshape(-1, 3)


def solid_angles(a: Array, b: Array, c: Array) -> Array:
    """Signed solid angles (m,) of triangles whose corners lie in unit directions (m, 3): positive counter-clockwise.

    Van Oosterom and Strackee, The solid angle of a plane triangle, IEEE Trans Biomed Eng 1983; 30: 125-126.
    """
    dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
    return 2 * np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), 1 + sum(dots))


def richardson(coarse: float, fine: float) -> float:
    """Richardson's extrapolation of a measure from two meshes, the second twice as fine: its error is of order 2."""
    return fine + (fine - coarse) / 3


def ranks(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, ... up to each count less one, for one count after the other."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def sorted_unique(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The distinct values of whole numbers (n,), in ascending order.

    NumPy 2.4 hashes first when only values are asked for, which takes far longer than sorting; with counts it sorts.
    """
    return np.unique(codes, return_counts=True)[0]
