"""A moving model at any time, and the paths of its material points."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import made

from quadriform.errors import OptionError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.splines import TimeBasis


@pytest.fixture
def moving(rng):
    surface = made()
    box = ControlBox.around(surface, (3, 3, 3))
    control = box.control_points + rng.normal(scale=0.3, size=(4, *box.control_points.shape))
    return MovingModel({"surface": surface}, box.origin, box.edges, TimeBasis(np.arange(4.0), 4.0), control)


def test_at_a_knot_it_is_the_box_of_the_knot(moving):
    np.testing.assert_allclose(moving.at(2.0).box.control_points, moving.control_points[2], atol=1e-12)
    np.testing.assert_allclose(moving.at(6.0).box.control_points, moving.control_points[2], atol=1e-12)


def test_a_trajectory_is_where_the_model_of_each_time_carries_the_point(moving):
    points = moving.surfaces["surface"].grid(2)[0]
    times = np.array([0.0, 0.3, 3.9])
    paths = moving.trajectories(points, times)
    for time, path in zip(times, paths):
        np.testing.assert_allclose(path, moving.at(time).deform(points), atol=1e-12)
    np.testing.assert_allclose(moving.undeform(paths[1], 0.3), points, atol=1e-9)


def test_it_moves_with_its_frame(moving):
    placed = moving.transformed(2.0, np.array([1.0, -2, 3]))
    points = moving.at(0.7).mesh(resolution=4).vertices
    np.testing.assert_allclose(placed.at(0.7).mesh(resolution=4).vertices, 2 * points + [1, -2, 3], atol=1e-12)


def test_the_times_of_its_frames_are_those_of_the_knots_unless_given(moving):
    assert np.array_equal(moving.frame_times, [0, 1, 2, 3])
    given = replace(moving, frame_times=[0.5, 3.75])
    for same in (given.transformed(2.0, np.zeros(3)), replace(given, space="LPS").in_space("RAS")):
        assert np.array_equal(same.frame_times, [0.5, 3.75])


@pytest.mark.parametrize("times", [[1.0, 1.0], [0.0, np.nan], [[0.0, 1.0]], [2.0, 1.0]])
def test_times_of_frames_increase(moving, times):
    with pytest.raises(OptionError, match="frame_times"):
        replace(moving, frame_times=times)


def test_a_motion_without_period_covers_its_frames(moving):
    with pytest.raises(OptionError, match="no period"):
        replace(moving, basis=TimeBasis(np.arange(4.0)), frame_times=[0.0, 3.5])


def test_its_numbers_are_those_of_the_superquadric_and_of_all_knots(moving):
    assert moving.n_parameters == 11 + 4 * 81


def test_a_box_a_knot(moving):
    with pytest.raises(OptionError, match="one box a knot"):
        MovingModel(moving.surfaces, moving.origin, moving.edges, moving.basis, moving.control_points[:3])
