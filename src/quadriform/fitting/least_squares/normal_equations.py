"""Normal equations of the control points from sums over a few moments, without a matrix that has a row for each point.

    r_i     (3,), what the displacement of point i should be: from the undeformed surface to the data point
    M_i     (3, 3), its weight: symmetric (`refinement/point_to_plane.py`)
    phi_i   (k,), products of Bernstein polynomials at its local coordinates, one for each control point; phi_ij is that
            of control point j
    B_i     (3, 3 k), kron(phi_i', I) with I (3, 3), so that B_i p is the displacement of the point by those p of the
            control points; here and below ' is the transpose

The sum of squares is sum_i (r_i - B_i p)' M_i (r_i - B_i p). In its matrix the block of control points j and h is
sum_i phi_ij phi_ih M_i. A product of two Bernstein polynomials of degree l is a multiple of one of degree 2 l, so every
entry is a multiple of one of (2 l + 1)(2 m + 1)(2 n + 1) moments. Points are taken in chunks: memory does not grow.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes import bernstein

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""The six different entries of a symmetric 3 x 3 matrix."""


@dataclass(frozen=True)
class NormalEquations:
    """The sum of squares sum_i (r_i - B_i p)' M_i (r_i - B_i p) over the displacements p, as p' A p - 2 b' p + c.

    Attributes:
        matrix: (3 k, 3 k), A; the coordinates of a control point stand together.
        right: (3 k,), b.
        constant: c.
    """

    matrix: Array
    right: Array
    constant: float

    @classmethod
    def of_rows(cls, rows: Array, target: Array, weight: float) -> "NormalEquations":
        """Of weight |rows p - target|^2, with rows (n, 3 k) and target (n,)."""
        return cls(weight * rows.T @ rows, weight * rows.T @ target, float(weight * target @ target))

    def __add__(self, other: "NormalEquations") -> "NormalEquations":
        return NormalEquations(self.matrix + other.matrix, self.right + other.right, self.constant + other.constant)

    def __sub__(self, other: "NormalEquations") -> "NormalEquations":
        return NormalEquations(self.matrix - other.matrix, self.right - other.right, self.constant - other.constant)

    def squares(self, displacement: Array) -> float:
        """The sum of squares at displacements (k, 3)."""
        p = displacement.ravel()
        return float(p @ (self.matrix @ p) - 2 * self.right @ p + self.constant)

    def about(self, displacement: Array) -> "NormalEquations":
        """The equations in the deviations from displacements (k, 3)."""
        return NormalEquations(self.matrix, self.right - self.matrix @ displacement.ravel(), self.squares(displacement))

    def in_basis(self, vectors: Array) -> "NormalEquations":
        """The equations in the coefficients of a basis, the columns of `vectors` (k, k)."""
        size = len(vectors)
        # one side at a time: the basis acts on control points and leaves coordinates alone
        half = (vectors.T @ self.matrix.reshape(size, -1)).reshape(3 * size, size, 3)
        # one product for each coordinate: products of three rows each take several times as long
        of_coordinates = [np.ascontiguousarray(half[:, :, each]) @ vectors for each in range(3)]
        matrix = np.stack(of_coordinates, axis=2).reshape(3 * size, 3 * size)
        return NormalEquations(matrix, (vectors.T @ self.right.reshape(size, 3)).ravel(), self.constant)


def normal_equations(local: Array, metric: Array, target: Array, degrees: tuple[int, int, int]) -> NormalEquations:
    """The normal equations of n points.

    Args:
        local: (n, 3) local coordinates of the points in the box.
        metric: (n, 3, 3) symmetric weights M_i.
        target: (n, 3), r_i, what the displacement of each should be.
        degrees: of the box.
    """
    weighted = np.einsum("nij,nj->ni", metric, target)
    weights = np.stack([metric[:, a, b] for a, b in PAIRS], axis=1)
    # the product of polynomials j and h is a factor times polynomial j + h of twice the degree: k^2 entries are
    # multiples of few moments
    doubled = (2 * degrees[0], 2 * degrees[1], 2 * degrees[2])
    moments = _sums(local, weights, doubled)
    right = right_sides(local, weighted[:, None], degrees)[0]
    index, factor = _doubling(degrees)
    k = len(index)
    matrix = np.empty((k, 3, k, 3))
    for pair, (a, b) in enumerate(PAIRS):
        matrix[:, a, :, b] = moments[index, pair] * factor
        matrix[:, b, :, a] = matrix[:, a, :, b]
    return NormalEquations(matrix.reshape(3 * k, 3 * k), right, float(np.einsum("ni,ni->", target, weighted)))


def right_sides(local: Array, weighted: Array, degrees: tuple[int, int, int]) -> Array:
    """Several right sides (m, 3 k) of the same points, from targets times weights (n, m, 3)."""
    n, m, _ = weighted.shape
    return _sums(local, weighted.reshape(n, -1), degrees).reshape(-1, m, 3).transpose(1, 0, 2).reshape(m, -1)


def _sums(local: Array, values: Array, degrees: tuple[int, int, int]) -> Array:
    """Sums over points of products of polynomials at local coordinates (n, 3) and values (n, c): (k, c), k products."""
    sides, columns = [degree + 1 for degree in degrees], values.shape[1]
    result = np.zeros((sides[0] * sides[1], sides[2] * columns))
    for start in range(0, len(local), bernstein.CHUNK):
        part = slice(start, start + bernstein.CHUNK)
        s, t, u = (bernstein.basis(local[part, axis], degree) for axis, degree in enumerate(degrees))
        n = len(s)
        # two of three axes at once: the sum over points is then one product of matrices
        first = (s[:, :, None] * t[:, None, :]).reshape(n, -1)
        second = (u[:, :, None] * values[part, None, :]).reshape(n, -1)
        result += first.T @ second
    return result.reshape(-1, columns)


@lru_cache(maxsize=8)
def _doubling(degrees: tuple[int, int, int]) -> tuple[NDArray[np.int64], Array]:
    """For each pair of control points the index of the moment of their product, and its factor, both (k, k)."""
    index: NDArray[np.int64] = np.zeros((1, 1), np.int64)
    for degree in degrees:
        i = np.arange(degree + 1)
        total = i[:, None] + i[None, :]
        # the index of a moment is that of its slower axes, times the moments along this axis, plus that along it
        index = np.kron(index * (2 * degree + 1), np.ones_like(total)) + np.kron(np.ones_like(index), total)
    l, m, n = (bernstein.product_factor(degree) for degree in degrees)
    return index, bernstein.kronecker(l, m, n)
