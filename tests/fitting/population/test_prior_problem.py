"""The linear problem with a prior against dense algebra: precision, criterion and minimum."""

from dataclasses import replace

import numpy as np
import pytest
from priors_made import bent, meshes
from scipy.stats import multivariate_normal

from quadriform import learn_prior
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.population.coordinates import PriorCoordinates, rigid_motions
from quadriform.fitting.population.linear_problem import PriorProblem


@pytest.fixture(scope="module")
def prior():
    return learn_prior(bent(1 / 30), box=(3, 3, 3))


@pytest.fixture(scope="module")
def coordinates(prior):
    return PriorCoordinates.of(prior)


def rows(n=200):
    rng = np.random.default_rng(4)
    return rng.normal(size=(n, 81)), rng.normal(size=n)


def problem(coordinates, **changes):
    given = dict(total_weight=200.0, effective_fraction=1.0, least_sigma=0.0, ratio=1e4) | changes
    return PriorProblem(NormalEquations.of_rows(*rows(), 1.0), coordinates, **given)


def dense_precision(prior, coordinates, ratio):
    """Of displacements, with a freedom of one: the inverse of the covariance across rigid motions."""
    modes = (coordinates.root.T @ prior.modes).reshape(len(prior.modes), -1).T * np.sqrt(prior.variances)
    covariance = np.eye(81) + ratio * modes @ modes.T
    rigid = (coordinates.root.T @ rigid_motions(prior)).reshape(6, -1).T
    across = np.linalg.svd(rigid)[0][:, 6:]
    precision = across @ np.linalg.solve(across.T @ covariance @ across, across.T)
    root = np.kron(coordinates.root, np.eye(3))
    return root @ precision @ root.T


def test_the_prior_is_the_gaussian_of_the_population_across_rigid_motions(prior, coordinates):
    given = problem(coordinates)
    displacement = np.random.default_rng(0).normal(size=(27, 3))
    p = (displacement - prior.mean).ravel()
    expected = p @ dense_precision(prior, coordinates, 1e4) @ p
    found = given.cost(displacement, 0.5) - given.data.squares(displacement)
    assert found == pytest.approx(0.5 * 200 * expected, rel=1e-8)


def test_rigid_motions_of_the_mean_shape_cost_nothing(prior, coordinates):
    given = problem(coordinates)
    for motion in rigid_motions(prior):
        moved = prior.mean + 0.1 * motion
        assert given.cost(moved, 1.0) - given.data.squares(moved) == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("fraction", (1.0, 0.5))
def test_the_criterion_is_minus_twice_the_log_marginal_likelihood(prior, coordinates, fraction):
    """Of all data less the null space, profiled over the noise; checked by differences, for constants are left out."""
    design, target = rows()
    root_inverse = np.kron(coordinates.basis, np.eye(3))
    given = problem(coordinates, effective_fraction=fraction)
    found, expected = [], []
    for strength, ratio in ((1e-3, 1e2), (1e-2, 1e5), (1.0, 1e3)):
        found.append(given.criterion(np.log(strength), np.log(ratio)))
        q = strength * 200 * dense_precision(prior, coordinates, ratio)
        a = design.T @ design + q
        right = design.T @ (target - design @ prior.mean.ravel())
        least = np.sum((target - design @ prior.mean.ravel()) ** 2) - right @ np.linalg.solve(a, right)
        values = np.linalg.eigvalsh(root_inverse.T @ q @ root_inverse)
        log_prior = np.log(values[6:]).sum()
        expected.append((fraction * 200 - 6) * np.log(least / 194) + np.linalg.slogdet(a)[1] - log_prior)
    assert np.diff(found) == pytest.approx(np.diff(expected), rel=1e-6)


def test_the_marginal_likelihood_of_a_proper_prior_agrees_with_the_density_of_the_data(prior, coordinates):
    """With the noise known and a shift as the only free motion it is that of a multivariate normal."""
    rigid_free = PriorCoordinates(
        coordinates.mean,
        coordinates.root,
        coordinates.basis,
        coordinates.directions[:, 6:],
        0,
        coordinates.squares,
    )
    design, target = rows()
    given = problem(rigid_free, least_sigma=50.0)  # far above the residuals, so that the noise stays at it
    root_inverse = np.kron(coordinates.basis, np.eye(3))
    found, expected = [], []
    for strength, ratio in ((1e-2, 1e2), (1e-1, 1e4)):
        found.append(given.criterion(np.log(strength), np.log(ratio)))
        u, w = rigid_free.directions, rigid_free.weights(ratio)
        precision = strength * 200 / 50.0**2 * (np.eye(81) - u @ np.diag(w) @ u.T)
        spread = design @ root_inverse
        covariance = 50.0**2 * np.eye(200) + spread @ np.linalg.solve(precision, spread.T)
        residual = target - design @ prior.mean.ravel()
        expected.append(-2 * multivariate_normal(cov=covariance, allow_singular=False).logpdf(residual))
    assert np.diff(found) == pytest.approx(np.diff(expected), rel=1e-6)


def test_the_solution_is_the_least_cost(coordinates):
    given = problem(coordinates)
    found = given.solve(0.01)
    least = given.cost(found.displacement, 0.01)
    for seed in range(5):
        step = 1e-3 * np.random.default_rng(seed).normal(size=(27, 3))
        one, other = (given.cost(found.displacement + sign * step, 0.01) for sign in (1, -1))
        assert one > least and other > least
        assert (one - other) == pytest.approx(0, abs=1e-6 * (one + other - 2 * least))


def of_members(coordinates, prior):
    """Data of a member of the population with a little freedom, and noise."""
    rng, (design, _) = np.random.default_rng(7), rows()
    along = np.tensordot([2.0, -1.0], prior.deviations[:2, None, None] * prior.modes[:2], 1)
    member = coordinates.displacement(0.03 * rng.normal(size=81)) + along
    target = design @ member.ravel() + rng.normal(0, 0.1, len(design))
    return replace(problem(coordinates, ratio=None), data=NormalEquations.of_rows(design, target, 1.0))


def test_the_best_weights_are_better_than_others(prior, coordinates):
    given = of_members(coordinates, prior)
    found = given.best()
    for strength in (0.1, 10.0):
        for ratio in (0.1, 10.0):
            other = given.criterion(np.log(found.strength * strength), np.log(found.ratio * ratio))
            assert found.criterion <= other + 1e-3


def test_later_rounds_find_the_same_weights(prior, coordinates):
    given = of_members(coordinates, prior)
    found = given.best()
    assert given.solve_or_best(None, found).criterion == pytest.approx(found.criterion, abs=1e-2)


def test_the_covariance_is_the_inverse_of_the_matrix(prior, coordinates):
    given = problem(coordinates)
    found = given.solve(0.01)
    design, _ = rows()
    matrix = design.T @ design + 0.01 * 200 * dense_precision(prior, coordinates, 1e4)
    assert found.covariance() @ matrix == pytest.approx(found.sigma**2 * np.eye(81), abs=1e-8 * found.sigma**2 * 1e3)


def test_a_prior_of_free_size_has_a_change_of_size_besides_rigid_motions():
    assert PriorCoordinates.of(learn_prior(meshes(), box=(3, 3, 3), scale=True)).n_rigid == 7
