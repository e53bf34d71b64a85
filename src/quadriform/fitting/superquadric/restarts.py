"""Restarts of the search from boxes around the inliers of a surface, for bodies with points on one side only.

The surface that fits points on one side of a body may be too long, or have its axes exchanged: its other end lies where
there are no points, and the distances do not show the error. The starts here are smaller than the body instead. Points
lie outside of each of their sides that was observed, and so determine the size.

The body explains the points as well as that surface does, so a restart has no larger sigma in the comparison with it
(`multistart.restarted`).
"""

from dataclasses import dataclass

import numpy as np

from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.initial import START, START_ROTATIONS
from quadriform.points import Array


@dataclass(frozen=True)
class RestartSettings:
    """The constants of restarts."""

    outside: float = 0.1
    """Fraction of the inliers beyond either side of a box: a few of them may belong to a neighbouring body in line."""
    exponent: float = 0.5
    """Both exponents of a start, between a box and an ellipsoid."""
    larger_sigma: float = 10.0
    """Sigma of a restart over that of the result: points beyond the box must still be inliers."""
    rounds: int = 4
    """Most rounds of restarts: the first finds the axes, others the size along them, step by step. All of them are
    repeated at most as often, each time without inliers that are not connected to the others."""
    steps: int = 12
    """Steps of each round, until candidates can be compared."""


RESTART = RestartSettings()


def restarts(points: Array, inliers: Array, rotation: Array) -> Candidates:
    """Rounded boxes around most inliers (n,) of points (n, 3), in each of `START_ROTATIONS` from a rotation (3, 3)."""
    rotations = rotation @ START_ROTATIONS
    local = points[inliers >= INLIER] @ rotations if (inliers >= INLIER).any() else points @ rotations
    # the sides of each box (F, 3): all but a few inliers lie between them
    low, high = np.quantile(local, [RESTART.outside, 1 - RESTART.outside], axis=1)
    half = (high - low) / 2
    half = np.maximum(half, START.thinnest * half.max(axis=1, keepdims=True))
    return Candidates(
        "ellipsoid",
        np.log(half),
        np.full((len(rotations), 2), RESTART.exponent),
        rotations,
        np.einsum("fij,fj->fi", rotations, (low + high) / 2),
        np.zeros((len(rotations), 1)),
    )
