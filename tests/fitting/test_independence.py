"""How many independent points a cloud is worth: white noise keeps all, copies count once, the surface decides."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.fitting.cloud import effective_fraction_of_points
from quadriform.fitting.refinement.base_prior import base_priors
from quadriform.fitting.refinement.point_to_plane import effective_fraction_of_data
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.control_box import common_box

FEET = 30 * even_directions(2000)


def test_white_noise_leaves_all_points():
    noise = np.random.default_rng(0).normal(size=len(FEET))
    assert effective_fraction_of_points(FEET, noise, np.ones(len(FEET))) == 1


@pytest.mark.parametrize("together", [3, 5, 9])
def test_points_that_err_together_count_once(together):
    """Groups of k points close to each other with one error each: a k-th of the points is independent."""
    rng = np.random.default_rng(1)
    feet = np.repeat(FEET, together, axis=0) + rng.normal(0, 1e-3, (together * len(FEET), 3))
    noise = np.repeat(rng.normal(size=len(FEET)), together)
    assert effective_fraction_of_points(feet, noise, np.ones(len(feet))) == pytest.approx(1 / together, rel=0.1)


@pytest.mark.parametrize("together", [200, 1000])
def test_errors_are_alike_as_far_as_they_reach(together):
    """Thirty strokes of many points, each with one error: none of the numbers of neighbours asked for ends them."""
    rng = np.random.default_rng(5)
    feet = np.repeat(30 * even_directions(30), together, axis=0) + rng.normal(0, 1e-3, (together * 30, 3))
    noise = np.repeat(np.where(np.arange(30) % 2, -1.0, 1.0), together) + rng.normal(0, 0.1, together * 30)
    assert effective_fraction_of_points(feet, noise, np.ones(len(feet))) == pytest.approx(1 / together, rel=0.1)


def test_neighbours_are_those_of_the_feet():
    """Old bug: among noisy points in space the nearest ones are those with the same error, so noise seemed alike."""
    rng = np.random.default_rng(2)
    feet, noise = FEET[:1000], 3 * rng.normal(size=1000)
    in_space = feet * (1 + noise / 30)[:, None]
    assert effective_fraction_of_points(in_space, noise, np.ones(1000)) < 0.95
    assert effective_fraction_of_points(feet, noise, np.ones(1000)) == 1


def test_points_of_no_weight_say_nothing():
    rng = np.random.default_rng(3)
    noise, weights = rng.normal(size=len(FEET)), np.ones(len(FEET))
    outliers = FEET[:, 2] > 15
    noise[outliers], weights[outliers] = 40, 0
    assert effective_fraction_of_points(FEET, noise, weights) == 1


def test_a_surface_of_outliers_alone_says_nothing():
    """Old bug: the mean over no inliers, which is not a number, or a division by zero where there is a base."""
    outer, inner = made(semi_axes=(1.0, 1.2, 1.5)), made(semi_axes=(0.5, 0.6, 0.8))
    box, base = common_box({"outer": outer, "inner": inner}, (3, 3, 3)), (np.zeros(3), np.array([0.0, 0, 1]))
    points = outer.surface(even_directions(300)) * (1 + 0.01 * np.random.default_rng(4).normal(size=(300, 1)))
    seen = SurfaceData.of(outer, points, np.ones(300), base)
    lost = replace(SurfaceData.of(inner, 5 * points, np.ones(300), base), inliers=np.zeros(300))
    assert effective_fraction_of_data([seen, lost], box) == effective_fraction_of_data([seen], box)
    assert [prior.surface for prior in base_priors([seen, lost], box)] == [outer]
