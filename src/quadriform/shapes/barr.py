"""Barr's global deformations: tapering, twisting, bending (Barr 1984; the synthetic data of the paper's Fig. 3).

All act along the z axis of the given points and are meant for making data.
"""

import numpy as np
from numpy.typing import ArrayLike

from quadriform.points import Array, check_points


def taper(points: ArrayLike, rates: tuple[float, float], half_length: float) -> Array:
    """The points (n, 3) with x and y scaled linearly with z, by 1 + rate z / half_length.

    Args:
        points: (n, 3).
        rates: change of the scale of x and of y between the middle and the end.
        half_length: |z| at the ends, in the unit of the points.
    """
    p = check_points(points)
    scale = 1 + np.multiply.outer(p[:, 2] / half_length, rates)
    return np.column_stack([p[:, :2] * scale, p[:, 2]])


def twist(points: ArrayLike, rate: float) -> Array:
    """The points (n, 3) after a twist about z by `rate` radians for each unit of z; it keeps volume."""
    p = check_points(points)
    c, s = np.cos(rate * p[:, 2]), np.sin(rate * p[:, 2])
    return np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]])


def bend(points: ArrayLike, curvature: float) -> Array:
    """The points (n, 3) after the z axis is bent into a circle of `curvature` (1 / unit) in the xz plane.

    The axis keeps its length. Points must lie on the outer side of the circle's centre: curvature * x < 1.
    """
    p = check_points(points)
    if curvature == 0:
        return p.copy()
    angle, radius = curvature * p[:, 2], 1 / curvature - p[:, 0]
    return np.column_stack([1 / curvature - radius * np.cos(angle), p[:, 1], radius * np.sin(angle)])
