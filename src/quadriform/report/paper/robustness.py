"""The robustness against outliers and the directions of matching that the paper claims and does not measure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from quadriform import examples
from quadriform.fitting.fit import fit, refine
from quadriform.fitting.result import rms
from quadriform.fitting.superquadric.fit import fit_superquadric
from quadriform.point_sets import ALONE
from quadriform.points import Array
from quadriform.report.paper.subjects import Box

RATIOS = (0.0, 0.05, 0.1, 0.2, 0.3)
DIRECTIONS = ("data-to-model", "model-to-data")
"""The paper's, and the usual one."""


@dataclass(frozen=True)
class Robustness:
    """Errors of the true surface with outliers among the points.

    Attributes:
        ratios: of the points that were moved anywhere.
        paper: RMS distance of the true points to the model by the paper's method, in mm, for each ratio.
        default: the same by default.
        count: how many points each cloud has.
    """

    ratios: tuple[float, ...]
    paper: tuple[float, ...]
    default: tuple[float, ...]
    count: int


def measure_robustness(box: Box, resolution: int = 16, ratios: tuple[float, ...] = RATIOS) -> Robustness:
    """Both methods on a synthetic ventricle of 6 n^2 + 2 noisy points, some of them moved anywhere."""
    truth = examples.ventricle(resolution)
    dirty = [examples.with_outliers(examples.noisy(truth), ratio) for ratio in ratios]
    paper = tuple(rms(fit(p, method="paper", box=box).model.distance(truth)) for p in dirty)
    default = tuple(rms(fit(points, box=box).model.distance(truth)) for points in dirty)
    return Robustness(ratios, paper, default, len(truth))


@dataclass(frozen=True)
class Matching:
    """Errors of the true surface after matching in each direction (3.2.2), in mm.

    Attributes:
        count: points of the data.
        directions: by direction.
        default: of the default method, which matches neither way.
    """

    count: int
    directions: Mapping[str, float]
    default: float


def measure_matchings(box: Box, resolution: int = 32) -> dict[str, Matching]:
    """Dense and sparse clouds by both directions; those of the ventricle against its true surface."""
    truth = examples.ventricle(resolution)
    noisy, crossing = examples.noisy(truth), examples.crossing_superquadrics(3 * resolution // 4)
    fine = examples.ventricle(2 * resolution)
    # sorted, so that the order of the points is not random too
    uneven = fine[np.sort(np.random.default_rng(2).choice(len(fine), len(truth), replace=False))]
    return {
        "dense: three crossing superquadrics": _matching(crossing, crossing, box),
        "dense: ventricle without noise": _matching(truth, truth, box),
        "dense: ventricle without noise, points in random places": _matching(uneven, fine, box),
        "dense: ventricle, noise 0.5 mm": _matching(noisy, truth, box),
        "sparse: ventricle, noise 0.5 mm, three planes": _matching(examples.three_planes(noisy), truth, box),
    }


def _matching(points: Array, truth: Array, box: Box) -> Matching:
    start = {ALONE: fit_superquadric(points, method="paper").superquadric}
    errors = {}
    for name in DIRECTIONS:
        found = refine(start, {ALONE: points}, method="paper", matching=name, box=box)
        errors[name] = rms(found.model.distance(truth))
    return Matching(len(points), errors, rms(fit(points, box=box).model.distance(truth)))
