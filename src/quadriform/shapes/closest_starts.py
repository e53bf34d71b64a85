"""Starts of a search for the nearest surface point: a grid over the surface with bounds on what lies between."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.points import Array, unit_vectors
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.mesh import sorted_unique
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import threads_for

RESOLUTION = 32
NEAREST = 20
"""Vertices that are compared first; targets for which more of them may qualify are compared with all."""
MOST = 24
"""Starts of one target; only near the centre of a sphere are there more, all as good as each other."""
SAFETY = 1.5
"""The sampled curvature of a cell times this is taken for its largest."""
SAME_FACE = 0.9
"""Cosine between the normals of neighbours that count as parts of one face."""
BLOCK = 256

Index = NDArray[np.int64]


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
    def _slack(self) -> Array:
        """The distance (n,) by which a vertex may be farther than the nearest one.

        Where its cell holds the nearest point, at distance d, its squared distance is at most
        d^2 + cell^2 + d slack; to second order with the curvature, to first order at most.
        """
        return np.minimum(self.cell**2 * self.curvature, 2 * self.cell)

    def starts(self, targets: Array) -> tuple[Index, Index]:
        """Pairs (target, vertex) to search from, sorted; the nearest vertex of each target is among them."""
        n, slack = len(self.points), self._slack
        distance, vertex = cKDTree(self.points).query(targets, k=NEAREST, workers=threads_for(len(targets)))
        nearest = distance[:, :1]
        # A vertex qualifies where its cell may come nearer than the nearest vertex (see `_slack`).
        room = distance**2 - nearest**2
        owner, column = np.nonzero(room <= self.cell[vertex] ** 2 + nearest * slack[vertex])
        ambiguous = np.flatnonzero(room[:, -1] <= self.cell.max() ** 2 + nearest[:, 0] * slack.max())
        codes = [owner * n + vertex[owner, column], *self._among_all(ambiguous, targets, nearest[:, 0])]
        return self._local_minima(targets, *np.divmod(sorted_unique(np.concatenate(codes)), n))

    def _among_all(self, ambiguous: Index, targets: Array, nearest: Array) -> list[Index]:
        """For ambiguous targets all vertices that qualify, as target * n + vertex."""
        centre, n = self.points.mean(axis=0), len(self.points)
        points = self.points - centre
        columns = np.column_stack([-2 * points, -self._slack]).T
        fixed = (points**2).sum(axis=1) - self.cell**2
        codes = []
        for start in range(0, len(ambiguous), BLOCK):
            part = ambiguous[start : start + BLOCK]
            x, d = targets[part] - centre, nearest[part]
            # |x - p|^2 - cell^2 - d slack for all vertices at once, as one matrix product.
            excess = np.column_stack([x, d]) @ columns
            excess += fixed
            row, vertex = np.nonzero(excess <= (d**2 - (x**2).sum(axis=1) * (1 - 1e-14))[:, None])
            codes.append(part[row] * n + vertex)
        return codes

    def _local_minima(self, targets: Array, owner: Index, vertex: Index) -> tuple[Index, Index]:
        """Pairs whose vertex is as near as all its neighbours."""
        several = np.bincount(owner, minlength=len(targets))[owner] > 1
        o, v = owner[several], vertex[several]
        own = np.linalg.norm(targets[o] - self.points[v], axis=1)
        lowest = np.ones(len(o), dtype=bool)
        for neighbour in self.around:
            left = np.flatnonzero(lowest)
            ring = np.linalg.norm(targets[o[left]] - self.points[neighbour[v[left]]], axis=1)
            lowest[left] = own[left] <= ring * (1 + 1e-12)
        kept = ~several
        kept[several] = lowest
        owner, vertex = owner[kept], vertex[kept]
        _, first, count = np.unique(owner, return_index=True, return_counts=True)
        rank = np.arange(len(owner)) - np.repeat(first, count)
        # Near the centre of a sphere all vertices are equally near; an even selection is enough.
        thinned = rank % np.repeat(-(-count // MOST), count) == 0
        return owner[thinned], vertex[thinned]


@lru_cache(maxsize=len(KINDS))
def _neighbours(kind: str) -> Index:
    """For each of n vertices the others of its cells, (k, n), padded with itself; alike for all surfaces of a kind."""
    vertices, quads = KINDS[kind].grid(RESOLUTION, np.ones(2), 2.0, 2.0)
    n = len(vertices)
    pairs = np.concatenate([quads[:, [i, j]] for i in range(4) for j in range(4) if i != j])
    one, other = np.divmod(sorted_unique(pairs[:, 0] * n + pairs[:, 1]), n)
    rank = np.arange(len(one)) - np.searchsorted(one, np.arange(n))[one]  # of each pair among those of its vertex
    table = np.tile(np.arange(n), (int(rank.max()) + 1, 1))
    table[rank, one] = other
    return table


def _vertex_normals(points: Array, quads: Index) -> Array:
    """Unit normals (n, 3), the mean of the adjoining cells' area vectors."""
    corners = points[quads]
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    total = np.stack([np.bincount(quads.ravel(), np.repeat(area[:, k], 4), len(points)) for k in range(3)], axis=1)
    return unit_vectors(total)
