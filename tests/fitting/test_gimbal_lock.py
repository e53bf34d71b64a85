"""An ellipsoid along the axes once met gimbal lock: a stray warning and a false ILL_CONDITIONED."""

import numpy as np
import pytest

import quadriform as qf
from quadriform.shapes import pose


@pytest.mark.parametrize("semi_axes", [(30, 20, 12), (12, 20, 30), (20, 30, 12)])
def test_axis_aligned_ellipsoid_is_determined(semi_axes):
    fit = qf.fit_superquadric(qf.Superquadric(semi_axes=semi_axes).grid(12)[0], method="paper")
    assert fit.status == "ok"
    assert fit.rank == 11
    assert fit.condition < 100


@pytest.mark.parametrize("second", [np.pi / 2, -np.pi / 2])
def test_locked_angles_give_the_rotation_back(second):
    rotation = pose.rotation_from_euler(np.array([0.3, second, 0.2]))
    again = pose.rotation_from_euler(pose.euler_from_rotation(rotation))
    np.testing.assert_allclose(again, rotation, atol=1e-12)
