"""Displacements of control points as features, in which the distance of two shapes is that of their surfaces."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from quadriform.points import Array
from quadriform.shapes.bending import Bending
from quadriform.shapes.control_box import ControlBox

BENDING_WEIGHT = 1e-8
"""Of the bending energy beside the squared displacement: it determines only what the surface does not."""


@dataclass(frozen=True)
class Features:
    """The least-squares map from displaced surface points to features of their control points, and back.

    Attributes:
        box: undeformed, of k control points.
        origins: (n, 3), points of the surfaces before deformation.
    """

    box: ControlBox
    origins: Array

    @cached_property
    def matrix(self) -> Array:
        """Matrix (n, k) from control points to the surface points (P5)."""
        return self.box.matrix(self.origins)

    @cached_property
    def gram(self) -> Array:
        """Symmetric (k, k): the mean square of the points' displacements, and a small bending energy."""
        shape = self.box.control_points.shape[:3]
        bending = Bending().matrix((shape[0], shape[1], shape[2]))
        return self.matrix.T @ self.matrix / len(self.matrix) + BENDING_WEIGHT * bending

    @cached_property
    def root(self) -> Array:
        """Cholesky factor L (k, k) with L L^T the Gram matrix."""
        return np.asarray(np.linalg.cholesky(self.gram), dtype=np.float64)

    def row(self, points: Array) -> Array:
        """The features (3 k,) of a shape whose points (n, 3) correspond to the origins.

        They are the displacements of its control points, in coordinates in which the distance of two shapes is the RMS
        distance between the points of their surfaces.
        """
        right_side = self.matrix.T @ (points - self.origins) / len(points)
        displacements: Array = cho_solve(cho_factor(self.gram), right_side)
        return (self.root.T @ displacements).ravel()

    def displacements(self, row: Array) -> Array:
        """The displacements (k, 3) of the control points that have such features (3 k,)."""
        return np.asarray(solve_triangular(self.root.T, np.reshape(row, (-1, 3))), dtype=np.float64)
