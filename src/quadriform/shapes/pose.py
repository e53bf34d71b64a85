"""Rotations by Euler angles (paper A.2)."""

import numpy as np
from scipy.spatial.transform import Rotation

from quadriform.points import Array

EULER = "XYZ"
"""Intrinsic rotations about x, then the new y, then the new z."""
LOCKED = 1e-9
"""Cosine of the second angle below which the first and the third rotate about the same axis (gimbal lock)."""


def rotation_from_euler(angles: Array) -> Array:
    """Rotation matrix (3, 3) of three Euler angles in radians (phi, theta, psi of the paper)."""
    return Rotation.from_euler(EULER, angles).as_matrix()


def euler_from_rotation(rotation: Array) -> Array:
    """Euler angles (3,) in radians of a rotation matrix; at gimbal lock the third is taken as zero."""
    across = np.hypot(rotation[0, 0], rotation[0, 1])
    second = np.arctan2(rotation[0, 2], across)
    if across < LOCKED:
        return np.array([np.arctan2(rotation[2, 1], rotation[1, 1]), second, 0.0])
    first, third = np.arctan2(-rotation[1, 2], rotation[2, 2]), np.arctan2(-rotation[0, 1], rotation[0, 0])
    return np.array([first, second, third])


def euler_axes(rotation: Array) -> Array:
    """World axes (3 angles, 3) of the rotations by the three Euler angles: dR / d angle = axis x R."""
    first, _, _ = euler_from_rotation(rotation)
    return np.array([[1, 0, 0], [0, np.cos(first), np.sin(first)], rotation[:, 2]])
