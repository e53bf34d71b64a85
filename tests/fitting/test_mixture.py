"""Inliers and outliers: densities, one step of EM and its limits, against plain sums."""

import numpy as np
import pytest

from quadriform.fitting import mixture as mixtures
from quadriform.fitting.mixture import Mixture

TWO = Mixture(np.array([0.3, 0.9]), np.array([0.2, 0.05]))


def test_densities_are_those_of_a_normal_and_a_uniform_distribution(rng):
    distances, odds = rng.normal(0, 0.2, (2, 9)), rng.normal(size=9)
    inliers, density = TWO.densities(distances, odds)
    for i in range(2):
        for j in range(9):
            sigma, ratio = TWO.sigma[i], TWO.inlier_ratio[i]
            normal = np.exp(-((distances[i, j] / sigma) ** 2) / 2) / (np.sqrt(2 * np.pi) * sigma)
            near, far = ratio * normal * np.exp(odds[j]), (1 - ratio) / 2
            np.testing.assert_allclose(inliers[i, j], near / (near + far), rtol=1e-12)
            np.testing.assert_allclose(density[i, j], np.log(near + far), rtol=1e-12)
    far, _ = TWO.densities(np.full((2, 1), 1e5))
    np.testing.assert_array_equal(far, 0)


def test_coordinates_lead_back_to_the_mixture_within_its_limits():
    one = TWO.take(np.array([0]))
    np.testing.assert_allclose(one.coordinates(), [np.log(0.3 / 0.7), np.log(0.2)])
    again = Mixture.at(one.coordinates())
    np.testing.assert_allclose([again.inlier_ratio, again.sigma], [one.inlier_ratio, one.sigma])
    for ratio, kept in ((-20.0, 0.02), (20.0, 0.999)):
        assert Mixture.at(np.array([ratio, -30.0])).inlier_ratio.tolist() == [kept]
    assert Mixture.at(np.array([0.0, -30.0])).sigma.tolist() == [1e-9]
    both = TWO.joined(one)
    assert both.inlier_ratio.tolist() == [0.3, 0.9, 0.3] and both.sigma.tolist() == [0.2, 0.05, 0.2]


@pytest.mark.parametrize("parameters", [0, 5, 11, 14, 50])
def test_one_step_of_em_counts_the_parameters_and_a_weak_prior(parameters, rng):
    distances, inliers, weights = rng.normal(size=(2, 30)), rng.uniform(0, 1, (2, 30)), rng.uniform(0.5, 2, 30)
    found = mixtures.estimated(distances, inliers, weights, parameters)
    for i in range(2):
        count = sum(w * p for w, p in zip(weights, inliers[i]))
        squares = sum(w * p * d * d for w, p, d in zip(weights, inliers[i], distances[i]))
        np.testing.assert_allclose(found.sigma[i] ** 2, squares / max(count - parameters, 0.2 * count), rtol=1e-12)
        np.testing.assert_allclose(found.inlier_ratio[i], (count + 1) / (weights.sum() + 1.5), rtol=1e-12)


def test_ratios_and_sigmas_have_limits():
    none, every = (
        mixtures.estimated(np.zeros((1, 5000)), np.full((1, 5000), p), np.ones(5000), 11) for p in (0.0, 1.0)
    )
    assert none.inlier_ratio.tolist() == [0.02] and every.inlier_ratio.tolist() == [0.999]
    assert every.sigma.tolist() == [1e-9] == none.sigma.tolist()
    assert mixtures.all_inliers(np.zeros((1, 3)), np.ones(3)).sigma.tolist() == [1e-9]


def test_with_all_points_as_inliers_sigma_is_their_weighted_rms(rng):
    distances, weights = rng.normal(size=(2, 9)), rng.uniform(0.5, 2, 9)
    found = mixtures.all_inliers(distances, weights)
    expected = [np.sqrt(sum(w * d * d for w, d in zip(weights, row)) / weights.sum()) for row in distances]
    np.testing.assert_allclose(found.sigma, expected, rtol=1e-12)
    assert found.inlier_ratio.tolist() == [0.999, 0.999]


def test_annealing_takes_three_quarters_of_sigma_down_to_a_fiftieth_of_the_size():
    found = mixtures.annealed(TWO, np.array([2.0, 3.0]))
    np.testing.assert_allclose(found.sigma, [0.15, 0.06])
    assert found.inlier_ratio.tolist() == [0.6, 0.6]


def test_odds_by_density_are_those_of_two_normal_distributions_of_one_variance(rng):
    reach, inliers = np.exp(np.append(rng.normal(-2, 0.3, 40), rng.normal(0, 0.3, 15))), rng.uniform(0, 1, 55)
    inliers[:40] = 1 - 0.2 * inliers[:40]
    inliers[40:] *= 0.2
    distance = np.log(reach)
    near = sum(p * d for p, d in zip(inliers, distance)) / inliers.sum()
    far = sum((1 - p) * d for p, d in zip(inliers, distance)) / (55 - inliers.sum())
    variance = sum(p * (d - near) ** 2 + (1 - p) * (d - far) ** 2 for p, d in zip(inliers, distance)) / 55
    expected = [min(0.0, ((d - far) ** 2 * -1 + (d - near) ** 2) / (-2 * variance)) for d in distance]
    np.testing.assert_allclose(mixtures.density_log_odds(reach, inliers), expected, rtol=1e-9, atol=1e-12)
    assert (mixtures.density_log_odds(reach, inliers)[40:] < -1).all()
    np.testing.assert_array_equal(mixtures.density_log_odds(1 / reach, inliers), 0)


@pytest.mark.parametrize(("near", "far", "even"), [(20, 9, True), (20, 10, False), (9, 20, True), (10, 20, False)])
def test_means_are_taken_of_ten_points_at_least(near, far, even):
    reach = np.append(np.linspace(1, 2, near), np.linspace(5, 9, far))
    odds = mixtures.density_log_odds(reach, np.append(np.ones(near), np.zeros(far)))
    assert (odds == 0).all() == even
