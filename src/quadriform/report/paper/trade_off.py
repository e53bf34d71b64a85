"""What each regularity costs, on one cloud (paper 4; its Figs. 10 to 12)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadriform import examples
from quadriform.fitting.fit import fit, refine
from quadriform.fitting.result import Fit
from quadriform.fitting.superquadric.fit import fit_superquadric
from quadriform.point_sets import ALONE
from quadriform.points import Array
from quadriform.report.paper.subjects import Box

FRACTIONS = (1.0, 0.88, 0.784, 0.72, 0.64, 0.512, 0.4, 0.32, 0.24, 0.16, 0.112, 0.08)
"""Singular values kept, as shares of the number of control points; 1 is all above rounding."""
FOUR = (0, 3, 5, 9)
"""The settings of Figs. 10 and 11 among them: all, 90, 64 and 20 of 125."""
STRENGTHS = tuple(10.0**power for power in range(-13, 1))
BENDING = (1e-8, 1e-6, 1e-4, 1e-2)


@dataclass(frozen=True)
class Curve:
    """Fits from weak to strong regularity.

    Attributes:
        settings: singular values kept, or strengths.
        error: RMS distance of the points to the model, in mm, of each setting.
        moved: RMS displacement |P - P0| of the control points, in mm.
    """

    settings: Sequence[float]
    error: Array
    moved: Array

    def take(self, index: Sequence[int]) -> "Curve":
        """Some of the settings."""
        chosen = list(index)
        return Curve([self.settings[k] for k in chosen], self.error[chosen], self.moved[chosen])


@dataclass(frozen=True)
class TradeOff:
    """Regularities against each other, on the points of a synthetic ventricle.

    Attributes:
        svd: truncation of singular values (P8).
        springs_paper: zero-length springs between control points, P9 as printed.
        springs: the same springs on the displacement of the control points, our variation.
        bending: the default method with its bending energy at fixed strengths.
        four: the fits of the four settings of Fig. 10.
        auto: the default, which estimates its strength.
    """

    svd: Curve
    springs_paper: Curve
    springs: Curve
    bending: Curve
    four: Sequence[Fit]
    auto: Fit


def measure_trade_off(box: Box, resolution: int = 16) -> TradeOff:
    """All fits of 6 n^2 + 2 noisy points; those by the paper's method start from one superquadric."""
    points = examples.noisy(examples.ventricle(resolution))
    start = {ALONE: fit_superquadric(points, method="paper").superquadric}

    def by_paper(regularity: str, strength: float | str) -> Fit:
        """The paper's fit at a strength."""
        return refine(start, {ALONE: points}, method="paper", box=box, regularity=regularity, strength=strength)

    # the same shares for other boxes than 5 x 5 x 5
    counts = [round(fraction * int(np.prod(box))) for fraction in FRACTIONS]
    svd = [by_paper("svd", "auto" if fraction == 1 else count) for fraction, count in zip(FRACTIONS, counts)]
    bending = [fit(points, box=box, strength=strength) for strength in BENDING]
    printed, ours = ([by_paper(name, s) for s in STRENGTHS] for name in ("springs-paper", "springs"))
    return TradeOff(
        curve(counts, svd),
        curve(STRENGTHS, printed),
        curve(STRENGTHS, ours),
        curve(BENDING, bending),
        [svd[k] for k in FOUR],
        fit(points, box=box),
    )


def curve(settings: Sequence[float], fits: Sequence[Fit]) -> Curve:
    """Errors and motions of fits."""
    return Curve(settings, np.array([f.rms for f in fits]), np.array([moved(f) for f in fits]))


def moved(fit: Fit) -> float:
    """RMS displacement |P - P0| of the control points, in mm."""
    box = fit.model.box
    return float(np.sqrt(((box.control_points - box.rest) ** 2).sum(axis=-1).mean()))


def turning(curve: Curve) -> int:
    """The setting with the least motion; beyond it stronger regularity moves the box more again."""
    return int(np.argmin(curve.moved))


def ratios(one: Curve, other: Curve, count: int = 50) -> Array:
    """Motion of the other curve over that of the one at equal errors, up to where each turns back; empty if none."""
    fronts = [_front(each) for each in (one, other)]
    low, high = max(front[0][0] for front in fronts), min(front[0][-1] for front in fronts)
    if low >= high:
        return np.empty(0)
    # interpolated between logarithms, where both curves are nearly straight
    errors = np.linspace(low, high, count)
    first, second = (np.interp(errors, *front) for front in fronts)
    return np.exp(second - first)


def _front(curve: Curve) -> tuple[Array, Array]:
    """Logarithms of error and motion of the Pareto-optimal settings, errors ascending."""
    # sorted by error, then by motion; a setting stays where all with less error move the box more
    order = np.lexsort((curve.moved, curve.error))
    moved = curve.moved[order]
    best = moved < np.r_[np.inf, np.minimum.accumulate(moved)[:-1]]
    return np.log(curve.error[order][best]), np.log(moved[best])
