"""Rigid motions by least squares."""

import numpy as np
from scipy.spatial.transform import Rotation

from quadriform.points import rigid_motion


def clouds(count, seed=0):
    return np.random.default_rng(seed).normal(size=(count, 30, 3)) * (3, 2, 1)


def test_a_motion_is_found():
    rotations, points = Rotation.random(4, random_state=1).as_matrix(), clouds(4)
    shifts = clouds(1)[0, :4]
    found, offsets = rigid_motion(points, points @ rotations.transpose(0, 2, 1) + shifts[:, None])
    assert np.abs(found - rotations).max() < 1e-12 and np.abs(offsets - shifts).max() < 1e-12


def test_of_a_mirror_image_it_is_a_rotation():
    points = clouds(1)[0]
    found, _ = rigid_motion(points, points * (1, 1, -1))
    assert np.abs(found - np.eye(3)).max() < 0.2 and np.linalg.det(found) > 0.999


def test_points_without_weight_do_not_count():
    rotation, points = Rotation.random(random_state=2).as_matrix(), clouds(1)[0]
    targets = points @ rotation.T + (5, 6, 7)
    targets[:10] += 100
    found, offset = rigid_motion(points, targets, np.arange(30) >= 10.0)
    assert np.abs(found - rotation).max() < 1e-12 and np.abs(offset - (5, 6, 7)).max() < 1e-11


def test_it_is_the_least_of_all_motions_nearby():
    points, targets = clouds(2)
    weights = np.random.default_rng(3).uniform(0.1, 2, 30)

    def squares(rotation, shift):
        return float(weights @ ((points @ rotation.T + shift - targets) ** 2).sum(axis=1))

    rotation, shift = rigid_motion(points, targets, weights)
    for step in 0.01 * np.vstack([np.eye(3), -np.eye(3)]):
        assert squares(rotation, shift) < squares(Rotation.from_rotvec(step).as_matrix() @ rotation, shift)
        assert squares(rotation, shift) < squares(rotation, shift + step)
