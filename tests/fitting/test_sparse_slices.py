"""Points that lie in a few parallel slices are recognised whatever their pose, noise and outliers."""

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import turned

import quadriform as qf
from quadriform.fitting.support import sparse_slices

AXES = np.array([25.0, 30.0, 40.0])


def slices(count, points=60, first=0.0):
    """Contours (count points, 3) of an ellipsoid at even heights, each half a distance from the ends."""
    heights = np.linspace(-1, 1, 2 * count + 1)[1::2] + first
    angle = 2 * np.pi * (np.arange(points) + 0.5) / points
    return np.concatenate(
        [np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * np.sqrt(1 - z**2) + [0, 0, z] for z in heights]
    )


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 9])
def test_up_to_four_slices_are_counted(count):
    found = count if count <= 4 else 0
    points = slices(count) * AXES
    assert sparse_slices(points) == found
    assert sparse_slices(points @ turned(3).T) == found
    noisy = points + np.random.default_rng(1).normal(scale=0.02 * 30, size=points.shape)
    assert sparse_slices(noisy + 1e5) == found


def test_uneven_slices_are_counted():
    heights = np.array([-0.9, -0.2, 0.3, 0.8])
    points = slices(4)
    points[:, 2] = np.repeat(heights, 60)
    assert sparse_slices(points) == 4


def test_a_few_outliers_between_slices_change_nothing():
    rng = np.random.default_rng(2)
    assert sparse_slices(np.concatenate([slices(4), rng.uniform(-1, 1, (6, 3))])) == 4
    assert sparse_slices(np.concatenate([slices(4), rng.uniform(-1, 1, (60, 3))])) == 0


def test_what_lies_between_slices_makes_them_none():
    across = slices(1, 80)[:, [0, 2, 1]]
    assert sparse_slices(np.concatenate([slices(4), across])) == 0


@pytest.mark.parametrize("seed", range(5))
def test_even_points_and_parts_of_them_are_no_slices(seed):
    points = random_directions(300, seed) * AXES
    assert sparse_slices(points) == 0
    assert sparse_slices(points[points[:, 2] > 10]) == 0
    assert sparse_slices(points[np.abs(points[:, 2]) > 10]) == 0


def test_fewer_points_than_slices_are_none():
    assert sparse_slices(slices(4, 1)) == 0


def test_a_fit_of_four_slices_is_warned_and_one_of_five_is_not():
    four, five = (qf.fit(slices(count, 40) * AXES, box=(4, 4, 4)) for count in (4, 5))
    assert four.status == "warned" and "4 parallel slices" in four.warnings["PARTIAL_COVERAGE"]
    assert five.status == "ok"
