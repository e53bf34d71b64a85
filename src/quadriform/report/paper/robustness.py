"""The robustness against outliers that the paper claims and never measured."""

from dataclasses import dataclass

import numpy as np

from quadriform.fitting.fit import fit
from quadriform.fitting.outcome import rms
from quadriform.points import Array
from quadriform.report.paper import clouds

SHARES = (0.0, 0.05, 0.1, 0.2, 0.3)


@dataclass(frozen=True)
class Robustness:
    """Errors of the true surface with strangers among the points.

    Attributes:
        shares: of the points that were put anywhere.
        paper: RMS distance of the true points to the model by the paper's method, in mm, for each share.
        default: the same by default.
        points: the last cloud, with most strangers.
    """

    shares: tuple[float, ...]
    paper: tuple[float, ...]
    default: tuple[float, ...]
    points: Array


def measure_robustness(resolution: int = 16, shares: tuple[float, ...] = SHARES) -> Robustness:
    """Both methods on a synthetic ventricle of 6 n^2 + 2 noisy points, some of them moved anywhere."""
    truth = clouds.ventricle(resolution)
    dirty = [clouds.with_strangers(clouds.noisy(truth), share) for share in shares]
    paper = tuple(rms(fit(points, method="paper").model.distance(truth)) for points in dirty)
    default = tuple(rms(fit(points).model.distance(truth)) for points in dirty)
    return Robustness(shares, paper, default, np.asarray(dirty[-1]))
