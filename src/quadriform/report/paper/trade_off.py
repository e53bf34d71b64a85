"""What each regularity costs, on one cloud (paper 4; its Figs. 10 to 12)."""

from dataclasses import dataclass

import numpy as np

from quadriform.fitting.fit import fit
from quadriform.fitting.outcome import Fit
from quadriform.points import Array
from quadriform.report.paper import clouds

COUNTS = (90.0, 64.0, 40.0, 20.0)
STRENGTHS = (1e-8, 1e-6, 1e-4, 1e-2)


@dataclass(frozen=True)
class TradeOff:
    """Fits from weak to strong regularity.

    Attributes:
        counts: singular values kept.
        strengths: of springs and of bending.
        svd: by the paper's method, with so many singular values.
        springs: by the paper's method, with springs.
        bending: by the default method, with its bending energy at the same strengths.
        auto: the default, whose strength is found.
    """

    counts: tuple[float, ...]
    strengths: tuple[float, ...]
    svd: tuple[Fit, ...]
    springs: tuple[Fit, ...]
    bending: tuple[Fit, ...]
    auto: Fit


def measure_trade_off(
    resolution: int = 16, counts: tuple[float, ...] = COUNTS, strengths: tuple[float, ...] = STRENGTHS
) -> TradeOff:
    """All fits of a synthetic ventricle with 6 n^2 + 2 noisy points."""
    points = clouds.noisy(clouds.ventricle(resolution))
    return TradeOff(
        counts,
        strengths,
        tuple(fit(points, method="paper", regularity="svd", strength=count) for count in counts),
        tuple(fit(points, method="paper", regularity="springs", strength=strength) for strength in strengths),
        tuple(fit(points, strength=strength) for strength in strengths),
        fit(points),
    )


def errors_and_motions(fits: tuple[Fit, ...]) -> tuple[Array, Array]:
    """Error RMS and RMS displacement of the box from rest, in mm, of each fit."""
    moved = [np.linalg.norm(f.model.box.control_points - f.model.box.rest, axis=-1).ravel() for f in fits]
    return np.array([f.rms for f in fits]), np.sqrt([np.mean(m**2) for m in moved])
