"""Polygons as mesh files hold them, and their triangles: fans of convex ones, ears cut one by one from the others."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, FileLimitError
from quadriform.points import Array

Indices = NDArray[np.int64]
Cells = tuple[Indices, Indices]
"""The corners of polygons, lines or strips, those of one after those of the other, and how many each has."""

NO_CELLS: Cells = (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))

MOST_CORNERS = 5000
"""Of a polygon that is not convex: cutting ears takes time with the square of their number."""
FLAT = 1e-12
"""A corner or triangle whose area is below this share of the polygon's is flat."""


@dataclass(frozen=True)
class Polygons:
    """Vertices, and polygons over them.

    Attributes:
        vertices: (n, 3).
        corners: indices into the vertices, those of one polygon after those of the other.
        lengths: (m,) how many corners each polygon has.
    """

    vertices: Array
    corners: Indices
    lengths: Indices

    @classmethod
    def with_strips(cls, vertices: Array, polygons: Cells, strips: Cells) -> "Polygons":
        """Polygons, and the triangles of strips behind them, over vertices as a file holds them, (3 n,)."""
        triangles = strip_triangles(*strips)
        corners = np.append(polygons[0], triangles).astype(np.int64)
        lengths = np.append(polygons[1], np.full(len(triangles), 3)).astype(np.int64)
        return cls(vertices.reshape(-1, 3).astype(np.float64), corners, lengths)

    def triangles(self, where: str) -> Indices:
        """Triangles (k, 3) that cover the polygons, those of one after those of the other, wound as they are.

        Raises:
            FileFormatError: a polygon with fewer than three corners, or with a vertex that is not there.
            FileLimitError: a polygon that is not convex has more than 5000 corners.
        """
        self._check(where)
        if (self.lengths == 3).all():
            return self.corners.reshape(-1, 3)
        # A polygon of k corners gives k - 2 triangles; polygons of equal length are handled together, as a table.
        corner, triangle = starts_of(self.lengths), starts_of(self.lengths - 2)
        found = np.empty((int((self.lengths - 2).sum()), 3), dtype=np.int64)
        for length in np.unique(self.lengths):
            which = np.flatnonzero(self.lengths == length)
            rows = self.corners[corner[which, None] + np.arange(length)]
            found[triangle[which, None] + np.arange(length - 2)] = _triangles_of(self.vertices, rows, where)
        return found

    def _check(self, where: str) -> None:
        short = np.flatnonzero(self.lengths < 3)
        if len(short):
            found = f"polygon {short[0]} with {self.lengths[short[0]]}"
            raise FileFormatError(f"{where}: expected polygons with three corners or more, found {found}")
        if len(self.corners) and not (self.corners.min() >= 0 and self.corners.max() < len(self.vertices)):
            wrong = self.corners[(self.corners < 0) | (self.corners >= len(self.vertices))][0]
            raise FileFormatError(f"{where}: a face names vertex {wrong}, but there are {len(self.vertices)}")


def starts_of(lengths: Indices) -> Indices:
    """Where lists of these lengths begin that are put one behind the other, as 0, 3, 7 of the lengths 3, 4, 2."""
    return np.asarray(np.cumsum(lengths) - lengths)


def strip_triangles(corners: Indices, lengths: Indices) -> Indices:
    """Triangles (k, 3) of triangle strips, every second one reversed, so that all have the same winding."""
    found = [np.empty((0, 3), dtype=np.int64)]
    for strip in np.split(corners, np.cumsum(lengths)[:-1]) if len(lengths) else []:
        rows = np.lib.stride_tricks.sliding_window_view(strip, 3).copy() if len(strip) >= 3 else found[0]
        rows[1::2] = rows[1::2, [1, 0, 2]]
        found.append(rows)
    return np.concatenate(found)


def _triangles_of(vertices: Array, rows: Indices, where: str) -> Indices:
    """Triangles (m, length - 2, 3) of polygons of one length, (m, length)."""
    count, length = rows.shape
    fan = np.stack([np.broadcast_to(rows[:, :1], (count, length - 2)), rows[:, 1:-1], rows[:, 2:]], axis=-1)
    if length == 3:
        return fan
    points = vertices[rows] - vertices[rows[:, :1]]
    points = points / max(np.abs(points).max(), 1e-300)  # fourth powers of small sizes would vanish
    with np.errstate(all="ignore"):  # vertices that are not finite are refused by those who look at them
        vectors = np.cross(points[:, 1:-1] - points[:, :1], points[:, 2:] - points[:, :1])
        normals = vectors.sum(axis=1)
        signed = np.einsum("mkx,mx->mk", vectors, normals)
        folded = (signed < -FLAT * (normals**2).sum(axis=1, keepdims=True)).any(axis=1)
    result = np.array(fan)
    for polygon in np.flatnonzero(folded):
        if length > MOST_CORNERS:
            raise FileLimitError(f"{where}: a polygon that is not convex has {length} corners; save triangles instead")
        result[polygon] = rows[polygon][_ears(_in_plane(points[polygon], normals[polygon]))]
    return result


def _in_plane(points: Array, normal: Array) -> Array:
    """Corners (n, 2) of a polygon as seen along its normal, counter-clockwise, centred and scaled to its size."""
    axis = int(np.abs(normal).argmax())
    kept = [(axis + 1) % 3, (axis + 2) % 3] if normal[axis] > 0 else [(axis + 2) % 3, (axis + 1) % 3]
    flat = points[:, kept] - points[:, kept].mean(axis=0)
    return flat / max(np.abs(flat).max(), 1e-300)


def _ears(points: Array) -> Indices:
    """Triangles (n - 2, 3) of a simple polygon (n, 2), counter-clockwise; every corner is used.

    Ears are cut one by one (Meisters, Polygons have ears, American Mathematical Monthly 1975; 82: 648-651). Where no
    ear is left, as of polygons that cross themselves, the flattest corner is cut.
    """
    left, found = list(range(len(points))), []
    while len(left) > 3:
        at = _ear(points[left])
        found.append([left[at - 1], left[at], left[(at + 1) % len(left)]])
        del left[at]
    return np.array([*found, left])


def _ear(points: Array) -> int:
    """Index of the corner to cut."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    areas = _doubled_area(before, points, after)
    for at in np.flatnonzero(areas > FLAT):
        a, b, c = before[at], points[at], after[at]
        # Neither its own corners nor others at the same points, as where a hole is joined to the outline, block an ear.
        others = points[~(points[:, None] == np.stack([a, b, c])).all(axis=2).any(axis=1)]
        inside = (_doubled_area(a, b, others) >= 0) & (_doubled_area(b, c, others) >= 0)
        if not (inside & (_doubled_area(c, a, others) >= 0)).any():
            return int(at)
    return int(np.abs(areas).argmin())


def _doubled_area(a: Array, b: Array, c: Array) -> Array:
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
