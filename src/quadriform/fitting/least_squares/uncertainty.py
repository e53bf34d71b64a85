"""Standard deviation of the surface along its normal: from noise, from missing data, and from too few control points.

The covariance of the control points contains the noise only. A box with more control points along each axis
(`refinement/refine.py`), with the same regulariser at its own best strength, represents details that the smaller one
smooths away. The shift between both surfaces estimates the bias, and the expected square of the error is bias squared
plus variance.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem, Solution
from quadriform.fitting.threads import one_blas_thread
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


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
    linear: LinearProblem
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
            normals: (n, 3), unit.
        """
        # derivatives of the normal displacement by the control points of the enriched box
        rows = box.elevate(self.degrees).matrix(origins)[:, :, None] * normals[:, None, :]
        rows = rows.reshape(len(origins), -1)
        relative_variance = self._solution.variance(rows) / self._solution.sigma**2  # g
        return np.sqrt((rows @ self.shift) ** 2 + self.independent_sigma**2 * relative_variance)
