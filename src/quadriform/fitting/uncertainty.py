"""How far the true surface may be from the fitted one: what noise and gaps leave open, and what the box cannot say.

The covariance of the control points knows only the noise. A box with two more control points a side, held by the same
regulariser at its own strength of largest evidence, sees what the smaller one smooths away: its surface lies beside
the fitted one by a shift, with a variance of its own, and the expected square of the error is the sum of both.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class FinerBox:
    """The same data seen by a finer box.

    Attributes:
        degrees: of the finer box.
        shift: (3 k,), its control points relative to those of the fitted box raised to the same degrees.
        factor: (3 k, 3 k), lower Cholesky factor of its normal matrix.
        noise: standard deviation of the data, as the finer box finds it.
    """

    degrees: tuple[int, int, int]
    shift: Array
    factor: Array
    noise: float

    def scaled(self, scale: float) -> "FinerBox":
        """The same in another unit of length."""
        return FinerBox(self.degrees, scale * self.shift, self.factor, scale * self.noise)

    def deviation(self, box: ControlBox, origins: Array, normals: Array) -> Array:
        """One standard deviation (n,) along the normals (n, 3) at (n, 3) points of the undeformed surface."""
        rows = box.elevate(self.degrees).matrix(origins)[:, :, None] * normals[:, None, :]
        rows = rows.reshape(len(origins), -1)
        spread = solve_triangular(self.factor, rows.T, lower=True)
        return np.sqrt((rows @ self.shift) ** 2 + self.noise**2 * (spread**2).sum(axis=0))
