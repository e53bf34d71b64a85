"""Pose: P11, the Euler angles and their derivatives."""

import numpy as np
import pytest
from shapes_made import KINDS, SKEW, made

from quadriform.shapes import pose
from quadriform.shapes.superquadric import Superquadric

ANGLES = np.array([0.4, -0.7, 1.1])


def about(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def test_euler_angles_turn_about_x_then_the_new_y_then_the_new_z():
    wanted = about("x", 0.4) @ about("y", -0.7) @ about("z", 1.1)
    np.testing.assert_allclose(pose.rotation_from_euler(ANGLES), wanted, atol=1e-15)
    np.testing.assert_allclose(pose.euler_from_rotation(wanted), ANGLES, atol=1e-15)


@pytest.mark.parametrize("angles", [ANGLES, np.zeros(3), np.array([-2.5, 1.3, 3.0])])
def test_each_euler_angle_turns_about_its_axis(angles):
    h, rotation = 1e-5, pose.rotation_from_euler(angles)
    for k, axis in enumerate(pose.euler_axes(rotation)):
        step = h * np.eye(3)[k]
        wanted = (pose.rotation_from_euler(angles + step) - pose.rotation_from_euler(angles - step)) / (2 * h)
        np.testing.assert_allclose(np.cross(axis, rotation.T).T, wanted, atol=1e-9)


@pytest.mark.parametrize("second", [np.pi / 2, -np.pi / 2])
def test_at_gimbal_lock_the_first_angle_has_all_of_the_rotation(second):
    for first in (0.0, 0.4, -2.5):
        rotation = about("x", first) @ about("y", second) @ about("z", 0.3)
        found = pose.euler_from_rotation(rotation)
        assert found[2] == 0
        np.testing.assert_allclose(pose.rotation_from_euler(found), rotation, atol=1e-12)


def test_to_local_undoes_to_world(rng):
    points, shift = rng.normal(size=(20, 3)), np.array([5.0, -3, 1])
    posed = Superquadric(rotation=SKEW, translation=shift)
    world = posed.to_world(points)
    np.testing.assert_allclose(world, [SKEW @ p + shift for p in points], rtol=1e-13)
    np.testing.assert_allclose(posed.to_local(world), points, atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_f_in_the_world_is_f_in_the_own_frame(kind, rng):
    """P11: F_world(x) = F(R^T (x - t)), and the gradient turns with it."""
    s = made(kind)
    own = Superquadric(kind, s.semi_axes, s.exponents, hole_radius=s.hole_radius, height=s.height)
    x = rng.normal(size=(50, 3)) * 4
    local = (x - s.translation) @ s.rotation
    np.testing.assert_allclose(s.implicit(x), own.implicit(local), rtol=1e-12)
    np.testing.assert_allclose(s.gradient(x), own.gradient(local) @ s.rotation.T, rtol=1e-10, atol=1e-12)
