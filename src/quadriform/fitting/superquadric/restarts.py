"""Where the search starts again from a surface that was seen from one side: boxes around its inliers.

A surface that is too long, or whose axes have each other's place, meets most points of a body with flat faces, for its
end hides where there are none. From inside the body all points beyond are evidence of its size.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.superquadric.initial import FRAMES, START
from quadriform.fitting.superquadric.levenberg_marquardt import Candidates
from quadriform.points import Array


@dataclass(frozen=True)
class Settings:
    """The constants of restarts."""

    outside: float = 0.1
    """Fraction of the inliers beyond either side of a box: a few of them belong to a neighbour that lies in line."""
    exponent: float = 0.5
    """Between a box and an ellipsoid."""
    warmer: float = 10.0
    """Sigma of a restart over that of the result: what lies beyond the box must still be seen."""
    rounds: int = 4
    """At most: the first finds the axes, others the size along them, as far as each sees."""
    steps: int = 12
    """Of each round, until candidates can be compared."""


RESTART = Settings()


def restarts(points: Array, inliers: Array, rotation: Array) -> Candidates:
    """Rounded boxes around most inliers (n,) of points (n, 3), one in each frame that `FRAMES` makes of one (3, 3)."""
    frames = rotation @ FRAMES
    local = points[inliers >= INLIER] @ frames if (inliers >= INLIER).any() else points @ frames
    low, high = np.quantile(local, [RESTART.outside, 1 - RESTART.outside], axis=1)
    half = (high - low) / 2
    half = np.maximum(half, START.thinnest * half.max(axis=1, keepdims=True))
    return Candidates(
        "ellipsoid",
        np.log(half),
        np.full((len(frames), 2), RESTART.exponent),
        frames,
        np.einsum("fij,fj->fi", frames, (low + high) / 2),
        np.zeros((len(frames), 1)),
    )
