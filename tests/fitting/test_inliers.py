"""Noise and share of inliers from distances: the formulas of one step, with the freedom that the parameters leave."""

import numpy as np
import pytest

from quadriform.fitting.mixture import estimated


@pytest.mark.parametrize(("n_parameters", "freedom"), [(0, 10), (4, 6), (9, 2), (30, 2)])
def test_few_points_met_closely_do_not_look_free_of_noise(n_parameters, freedom, rng):
    """At least a fifth of the points counts, however many parameters there are."""
    distances = rng.normal(size=(1, 10))
    found = estimated(distances, np.ones((1, 10)), np.ones(10), n_parameters)
    np.testing.assert_allclose(found.sigma, np.sqrt((distances**2).sum() / freedom), rtol=1e-12)
    np.testing.assert_allclose(found.inlier_ratio, 11 / 11.5, rtol=1e-12)


def test_weights_count_points(rng):
    """Twice the weight is twice the point; a point that is an inlier to one half counts half."""
    distances, weights = rng.normal(size=(1, 12)), np.array([2.0] * 4 + [1.0] * 8)
    twice = np.concatenate([distances[:, :4], distances], axis=1)
    plain = estimated(twice, np.ones((1, 16)), np.ones(16), 3)
    weighted = estimated(distances, np.ones((1, 12)), weights, 3)
    np.testing.assert_allclose([weighted.sigma, weighted.inlier_ratio], [plain.sigma, plain.inlier_ratio], rtol=1e-12)
    half = estimated(distances, np.full((1, 12), 0.5), np.ones(12), 0)
    np.testing.assert_allclose(half.sigma, np.sqrt((distances**2).mean()), rtol=1e-12)
    np.testing.assert_allclose(half.inlier_ratio, 7 / 13.5, rtol=1e-12)
