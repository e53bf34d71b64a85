"""Cubic splines over time, periodic or natural: how control points move between their knots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from quadriform.errors import OptionError
from quadriform.points import Array
from quadriform.words import short_repr

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True, repr=False)
class TimeBasis:
    """Splines that are one at their own knot and zero at the others; they sum to one.

    Attributes:
        knots: (K,) increasing times.
        period: after which the motion repeats; None for a motion that does not.
    """

    __repr__ = short_repr

    knots: Array
    period: float | None = None

    def __post_init__(self) -> None:
        knots = np.asarray(self.knots, dtype=np.float64)
        if knots.ndim != 1 or len(knots) < 2 or not np.isfinite(knots).all() or (np.diff(knots) <= 0).any():
            raise OptionError(f"knots: expected two or more increasing times, found {knots}")
        if self.period is not None and not self.period > knots[-1] - knots[0]:
            raise OptionError(f"period={self.period}: expected more than the {knots[-1] - knots[0]:g} that knots span")
        object.__setattr__(self, "knots", knots)

    @property
    def span(self) -> float:
        """The time that the splines cover."""
        return float(self.knots[-1] - self.knots[0]) if self.period is None else self.period

    @property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline  # loaded for motions alone

        identity = np.eye(len(self.knots))
        if self.period is None:
            return CubicSpline(self.knots, identity, bc_type="natural")
        around = np.append(self.knots, self.knots[0] + self.period)
        return CubicSpline(around, np.concatenate([identity, identity[:1]]), bc_type="periodic")

    def values(self, times: Array) -> Array:
        """The splines at (T,) times, (T, K).

        Raises:
            OptionError: a time before the first or after the last knot of a motion without period.
        """
        times = np.atleast_1d(np.asarray(times, dtype=np.float64))
        first, last = self.knots[0], self.knots[0] + self.span
        slack = 1e-9 * self.span
        if self.period is None and ((times < first - slack) | (times > last + slack)).any():
            raise OptionError(f"time {times}: expected between {first:g} and {last:g}; the motion has no period")
        return self._spline(times)

    def pieces(self) -> tuple[Array, Array]:
        """The splines as polynomials: breaks (I + 1,) and coefficients (4, I, K), the cube's first.

        Each is in the time since its piece's break.
        """
        spline = self._spline
        return spline.x, spline.c

    def mass(self) -> Array:
        """Mean of the products of two splines over time, (K, K)."""
        return self._mean_product(0)

    def bending(self) -> Array:
        """Mean over time of the products of second derivatives of two splines, (K, K), time measured in spans.

        With a period the matrix acts on coefficients without their mean and first harmonic: the constant and the sine
        of one period, of any phase, that are the least squares fit to the coefficients at the knots. So neither is
        penalised, as straight lines are not without a period.
        """
        second = self.span**4 * self._mean_product(2)
        if self.period is None:
            return second
        phase = 2 * np.pi * (self.knots - self.knots[0]) / self.period
        harmonic = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)
        # the projection onto coefficients that are orthogonal to the mean and the first harmonic
        others = np.eye(len(phase)) - harmonic @ np.linalg.pinv(harmonic)
        return others.T @ second @ others

    def _mean_product(self, order: int) -> Array:
        """Exact: four Gauss points integrate the square of a cubic between two knots."""
        # The integrand is a polynomial of degree 6 between breaks.
        nodes, weights = np.polynomial.legendre.leggauss(4)
        breaks = self._spline.x
        half = np.diff(breaks)[:, None] / 2
        times = (breaks[:-1, None] + half * (1 + nodes)).ravel()
        values = self._spline(times, nu=order)
        return values.T @ ((half * weights).ravel()[:, None] * values) / self.span
