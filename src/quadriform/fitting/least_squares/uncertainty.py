"""Standard deviation of the surface along its normal: from noise, from missing data, and from too few control points.

The covariance of the control points contains the noise only. A box with more control points along each axis
(`refinement/refine.py`), with the same regulariser at its own best strength, represents details that the smaller one
smooths away. The shift between both surfaces estimates the bias, and the expected square of the error is bias squared
plus variance.
"""

from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from quadriform.fitting.least_squares.marginal_likelihood import Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.threads import one_blas_thread
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


class Linear(Protocol):
    """A linear problem as a function of the strength."""

    @property
    def data(self) -> NormalEquations:
        """The normal equations of the data."""

    @property
    def regulariser_matrix(self) -> Array:
        """The matrix (k, k) of the regulariser."""

    @property
    def effective_fraction(self) -> float:
        """The number of independent residuals over that of all."""

    def best(self, start: float | None = None) -> Solution:
        """The solution at the best strength, near a given one."""


@dataclass(frozen=True)
class EnrichedBox:
    """The problem of the same data in a box with more control points, solved when an uncertainty is first asked for.

    Attributes:
        box: the fitted one elevated to higher degrees, in the centred, scaled frame.
        linear: the linear problem of the data in it.
        strength: of the regularisation of the fitted box, near which its own is sought.
        scale: RMS radius of the data, which the frame has as its unit.
    """

    box: ControlBox
    linear: Linear
    strength: float
    scale: float = 1.0

    @cached_property
    def _solution(self) -> Solution:
        return one_blas_thread(self.linear.best)(self.strength)

    @property
    def degrees(self) -> tuple[int, int, int]:
        """The degrees of the enriched box."""
        return self.box.degrees

    @property
    def shift(self) -> Array:
        """Displacements (3 k,) of its control points from those of the fitted box elevated to the same degrees."""
        return self.scale * ((self.box.rest - self.box.control_points).ravel() + self._solution.displacement.ravel())

    @property
    def independent_sigma(self) -> float:
        """s / sqrt(f) of the enriched box, in the unit of the data; with correlated residuals it is above their s."""
        return self.scale * self._solution.independent_sigma

    def rotation_to(self, box: ControlBox) -> Array:
        """The rotation (3, 3) from the axes of this box to those of the same one in other coordinates of the world."""
        own, other = (each.edges / np.linalg.norm(each.edges, axis=1, keepdims=True) for each in (self.box, box))
        return other.T @ own

    def samples(self, normal: Array, signs: Array) -> Array:
        """Deviations (n, 3 k) of its control points from those of the fitted box, elevated, in the unit of the data.

        By noise and missing data as its posterior, s / sqrt(f) T^-T z; and by the bias of the fitted box, once to each
        side, so that the mean square of the deviation along the normal is the variance of `deviation`.

        Args:
            normal: (n, 3 k), rows z of independent standard normal numbers.
            signs: (n,), +1 and -1, by which the bias is multiplied.
        """
        solution, sigma = self._solution, self.independent_sigma
        halved = solve_triangular(solution.factor, sigma * normal.T, lower=True, trans=1)
        halved = halved.reshape(len(solution.eigenvectors), 3, len(normal))
        noise = np.einsum("kj,jin->nki", solution.eigenvectors, halved, optimize=True)
        return noise.reshape(len(normal), -1) + signs[:, None] * self.shift

    @property
    def regulariser(self) -> Array:
        """The matrix (k, k) of its regulariser."""
        return self.linear.regulariser_matrix

    @property
    def source(self) -> str:
        """A hash of the data, by its normal equations."""
        return sha256(self.linear.data.right.tobytes()).hexdigest()

    def deviation(self, box: ControlBox, origins: Array, normals: Array) -> Array:
        """One standard deviation (n,) along the normals (n, 3) at (n, 3) points of the undeformed surface.

        It is sqrt(beta^2 + (s^2 / f) g), with s, f, A, lambda and K of the enriched box (`marginal_likelihood.py`). The
        bias beta of the fitted box is its difference from the enriched one along the normal. The second term is the
        variance of the enriched box along the normal: s^2 g if all residuals were independent, with
        g = v' (A + lambda K)^-1 v, v (3 k,) the derivatives of the normal displacement by its control points; divided
        by f, the fraction of the residuals that are.

        Args:
            box: fitted, in the unit of the data; its elevated form has the same undeformed lattice as the enriched box.
            origins: (n, 3), in the unit of the data.
            normals: (n, 3), unit; box, points and normals may be in other coordinates of the world than the data.
        """
        normals = normals @ self.rotation_to(box)
        # derivatives of the normal displacement by the control points of the enriched box
        rows = box.elevate(self.degrees).matrix(origins)[:, :, None] * normals[:, None, :]
        rows = rows.reshape(len(origins), -1)
        relative_variance = self._solution.variance(rows) / self._solution.sigma**2  # g
        return np.sqrt((rows @ self.shift) ** 2 + self.independent_sigma**2 * relative_variance)
