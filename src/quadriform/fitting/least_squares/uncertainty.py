"""How far the true surface may be from the fitted one: by noise, by missing data, and by too few control points.

The covariance of the control points contains only the noise. A box with two more control points a side, with the same
regulariser at its own strength of largest evidence, shows what the smaller one smooths away: its surface lies beside
the fitted one by a shift, with a variance of its own, and the expected square of the error is the sum of both.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from quadriform.fitting.least_squares.marginal_likelihood import Evidence, Solution
from quadriform.fitting.threads import one_blas_thread
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class EnrichedBox:
    """The same data in a box with more control points, solved on first use: a fit without uncertainties needs none.

    Attributes:
        box: the fitted one elevated to the finer degrees, in the centred, scaled frame.
        evidence: of the data about it.
        near: the strength of the fitted box.
        scale: RMS radius of the data, which the frame has as its unit.
    """

    box: ControlBox
    evidence: Evidence
    near: float
    scale: float = 1.0

    @cached_property
    def _solution(self) -> Solution:
        return one_blas_thread(self.evidence.best)(self.near)

    @property
    def degrees(self) -> tuple[int, int, int]:
        """Of the finer box."""
        return self.box.degrees

    @property
    def shift(self) -> Array:
        """Its control points relative to those of the fitted box elevated to the same degrees, (3 k,)."""
        return self.scale * ((self.box.rest - self.box.control_points).ravel() + self._solution.displacement.ravel())

    @property
    def noise(self) -> float:
        """Standard deviation of the data, as the finer box finds it."""
        return self.scale * self._solution.independent_noise

    def deviation(self, box: ControlBox, origins: Array, normals: Array) -> Array:
        """One standard deviation (n,) along the normals (n, 3) at (n, 3) points of the undeformed surface."""
        # derivatives of the normal displacement by the control points of the enriched box
        rows = box.elevate(self.degrees).matrix(origins)[:, :, None] * normals[:, None, :]
        rows = rows.reshape(len(origins), -1)
        noise = self._solution.noise
        spread = self._solution.variance(rows) / noise**2
        # the bias that the smaller box shows, and the variance of the enriched one
        return np.sqrt((rows @ self.shift) ** 2 + self.noise**2 * spread)
