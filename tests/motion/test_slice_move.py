"""The motion of a slice as a result: in other coordinates and units, and the slices that have none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes_made import turned

from quadriform.motion.slice_motions import SlicePlanes
from quadriform.motion.slice_move import SliceMove, slice_moves, unmoved_slices
from quadriform.motion.slice_prior import SPREAD, SlicePrior, SliceState
from quadriform.points import Frame


def made_planes(rng):
    points = rng.normal(size=(40, 3))
    numbers = np.repeat([3, 8, 9, 12], [14, 12, 5, 9])
    numbers[-9:] = -1
    return points, numbers, SlicePlanes.of([{"a": points}], [{"a": numbers}])


def state_of(planes, motions, is_planar):
    prior = SlicePrior.first(planes.gauge_fields(), is_planar)
    return SliceState(motions, prior, 0.1, prior)


def test_points_rotate_about_the_centre_and_shift():
    rotation, centre, shift = np.array([[0, 0, np.pi / 2], [1, 0, 0], [0, 0, 5]])
    quarter = SliceMove(rotation, centre, shift, np.eye(3), np.ones(6))
    np.testing.assert_allclose(quarter.apply(np.array([[2.0, 0, 0], [1.0, 0, 0]])), [[1, 1, 5], [1, 0, 5]], atol=1e-12)


def test_a_motion_commutes_with_a_change_of_coordinates(rng):
    vectors = rng.normal(size=(3, 3))
    move, rotation, points = SliceMove(*vectors, np.eye(3), np.ones(6)), turned(2), rng.normal(size=(5, 3))
    found = move.rotated(rotation)
    np.testing.assert_allclose(found.apply(points @ rotation.T), move.apply(points) @ rotation.T, atol=1e-12)
    np.testing.assert_allclose(found.axes @ found.rotation, move.axes @ move.rotation, atol=1e-12)


def test_motions_have_the_unit_and_coordinates_of_the_points(rng):
    local, numbers, planes = made_planes(rng)
    normalisation = Frame.of(np.array([[10.0, 20, 30], [14, 26, 30], [11, 21, 39]]))
    motions, covariance = 0.2 * rng.normal(size=(2, 6)), np.diag(np.arange(1.0, 13))
    state = state_of(planes, motions, False)
    found = slice_moves(planes, state, covariance, normalisation)
    assert list(found) == [3, 8]
    moved = normalisation.to_world(planes.moved(motions, numbers, local))
    for index, (number, move) in enumerate(found.items()):
        inside = numbers == number
        np.testing.assert_allclose(move.apply(normalisation.to_world(local))[inside], moved[inside], rtol=1e-9)
        np.testing.assert_allclose(move.sd[3:], normalisation.scale * np.sqrt(6 * index + np.arange(1, 4)))
        np.testing.assert_allclose(move.sd[:3], np.sqrt(6 * index + np.arange(4, 7)))
        np.testing.assert_allclose(Rotation.from_rotvec(move.rotation).magnitude(), np.linalg.norm(motions[index, 3:]))


def test_what_is_not_sought_in_a_stack_has_the_spread_that_is_assumed(rng):
    _, _, planes = made_planes(rng)
    state = state_of(planes, np.zeros((2, 6)), True)
    found = slice_moves(planes, state, 1e-6 * np.eye(12), Frame.of(rng.normal(size=(9, 3))))
    assert found[3].sd[:3] == pytest.approx(SPREAD.first) and (found[3].sd[3:5] < 0.1 * found[3].sd[5]).all()


def test_slices_of_few_points_are_named(rng):
    _, numbers, planes = made_planes(rng)
    assert unmoved_slices(planes, [{"a": numbers}]) == ("slices of fewer than 6 points were not moved: 9",)
    assert unmoved_slices(planes, [{"a": np.where(numbers == 9, -1, numbers)}]) == ()
