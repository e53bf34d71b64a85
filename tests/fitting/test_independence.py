"""How many independent points a cloud is worth: white noise keeps all, copies count once, the surface decides."""

import numpy as np
import pytest
from shapes_made import even_directions

from quadriform.fitting.cloud import effective_fraction

FEET = 30 * even_directions(2000)


def test_white_noise_leaves_all_points():
    noise = np.random.default_rng(0).normal(size=len(FEET))
    assert effective_fraction(FEET, noise, np.ones(len(FEET))) == 1


@pytest.mark.parametrize("together", [3, 5, 9])
def test_points_that_err_together_count_once(together):
    """Groups of k points close to each other with one error each: a k-th of the points is independent."""
    rng = np.random.default_rng(1)
    feet = np.repeat(FEET, together, axis=0) + rng.normal(0, 1e-3, (together * len(FEET), 3))
    noise = np.repeat(rng.normal(size=len(FEET)), together)
    assert effective_fraction(feet, noise, np.ones(len(feet))) == pytest.approx(1 / together, rel=0.1)


def test_neighbours_are_those_of_the_feet():
    """Old bug: among noisy points in space the nearest ones are those with the same error, so noise seemed alike."""
    rng = np.random.default_rng(2)
    feet, noise = FEET[:1000], 3 * rng.normal(size=1000)
    in_space = feet * (1 + noise / 30)[:, None]
    assert effective_fraction(in_space, noise, np.ones(1000)) < 0.95
    assert effective_fraction(feet, noise, np.ones(1000)) == 1


def test_points_of_no_weight_say_nothing():
    rng = np.random.default_rng(3)
    noise, weights = rng.normal(size=len(FEET)), np.ones(len(FEET))
    strangers = FEET[:, 2] > 15
    noise[strangers], weights[strangers] = 40, 0
    assert effective_fraction(FEET, noise, weights) == 1
