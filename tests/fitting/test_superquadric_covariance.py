"""The covariance of a superquadric against plain formulas: information, curvature, and both sources of bias."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import made

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import covariance as module
from quadriform.fitting.superquadric.candidates import AXES, POWERS, SHIFT, Candidates, distances
from quadriform.fitting.superquadric.empty_space import PenaltyTerms
from quadriform.fitting.superquadric.identifiability import _by_parameters, identifiability_of, surface_at
from quadriform.fitting.superquadric.levenberg_marquardt import EXPONENT_SPREAD, Descent
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.shapes.superquadric import Superquadric

NOISY = random_directions(60, 1) * [1.2, 0.8, 1.0] + np.random.default_rng(9).normal(0, 0.05, (60, 3))


class Push:
    """A penalty with numbers of its own for each candidate."""

    def __init__(self, factor=1.0):
        self.factor = factor

    def penalty(self, candidates, mixture):
        m, p = len(candidates), candidates.n_parameters
        rng = np.random.default_rng(8)
        root = 0.3 * rng.normal(size=(m, p, p))
        matrix = root @ np.swapaxes(root, 1, 2)
        return PenaltyTerms(np.zeros(m), self.factor * rng.normal(size=(m, p)), self.factor * matrix)

    def of_sample(self, fraction):
        return Push(fraction)


def descent(kind="ellipsoid", penalty=None, fixed=(), sigma=0.06, points=NOISY):
    rng = np.random.default_rng(2)
    body = Candidates.of([made(kind, (0.9, 1.1), (1.2, 0.8, 1.0))])
    body = replace(body, translations=np.array([[0.01, 0.02, 0.03]]))
    held = np.isin(np.arange(body.n_parameters), fixed)
    n = len(points)
    weights, odds, noise = rng.uniform(0.5, 2, n), rng.normal(0, 0.2, n), rng.uniform(0.8, 1.3, n)
    problem = SearchProblem(points, weights, kind, {}, odds, noise, empty=penalty, longest=9.0)
    found = Descent(problem, body, Mixture(np.array([0.9]), np.array([sigma])))
    found.fixed_mask = held
    return found


@pytest.mark.parametrize("penalty", [None, Push()], ids=["points", "with a penalty"])
def test_information_is_that_of_weighted_squares_and_of_the_prior(penalty):
    of = descent(penalty=penalty)
    expected = np.zeros((11, 11))
    for j in range(60):
        row = of.derivatives[0, :, j]
        expected += of.weights[j] * of.inliers[0, j] * np.outer(row, row) / 0.06**2
    expected[3, 3] += 1 / EXPONENT_SPREAD**2
    expected[4, 4] += 1 / EXPONENT_SPREAD**2
    if penalty:
        expected += penalty.penalty(of.candidates, of.mixture).matrix[0] / 0.06**2
    np.testing.assert_allclose(module._linear(of), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("penalty", [None, Push()], ids=["points", "with a penalty"])
def test_the_gradient_is_that_of_weighted_squares_prior_and_size(penalty):
    of = descent(penalty=penalty)
    expected = sum(
        w * p * d * row for w, p, d, row in zip(of.weights, of.inliers[0], of.distances[0], of.derivatives[0].T)
    )
    expected = expected / 0.06**2
    expected[POWERS] += (of.candidates.exponents[0] - 1) / EXPONENT_SPREAD**2
    expected[AXES] += of.extent().derivatives(of.candidates)[0]
    if penalty:
        expected += penalty.penalty(of.candidates, of.mixture).gradient[0] / 0.06**2
    np.testing.assert_allclose(module._gradient(of)[0], expected, rtol=1e-9)


def test_the_curvature_is_the_difference_of_gradients_at_steps_of_a_tenth_of_sigma():
    of = descent()
    found, expected = module._curvature(of), np.zeros((11, 11))
    for k in range(11):
        rms = np.sqrt(np.mean(of.derivatives[0, k] ** 2))
        step = min(0.1 * 0.06 / rms, 0.1)
        ends = []
        for sign in (1, -1):
            moved = of.candidates.moved(sign * step * np.eye(11)[k : k + 1], 9.0)
            ends.append(module._gradient(Descent(of.problem, moved, of.mixture))[0])
        expected[k] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(found, (expected + expected.T) / 2, rtol=1e-9, atol=1e-9)


def test_the_covariance_of_noise_is_the_one_whose_variances_along_normals_are_given(rng):
    normals = rng.normal(size=(3, 50))
    frame = made().rotation
    covariance = frame @ np.diag([1.0, 0.3, 0.1]) @ frame.T
    squares = np.array([n @ covariance @ n for n in normals.T])
    found = module._covariance_of_noise(normals, squares, rng.uniform(0.5, 2, 50))
    np.testing.assert_allclose(found, covariance, rtol=1e-7, atol=1e-9)
    # weights count: half of the points say another one
    both = np.concatenate([squares, 4 * squares])
    twice, first = np.tile(normals, 2), np.repeat([1.0, 0.0], 50)
    np.testing.assert_allclose(module._covariance_of_noise(twice, both, first), covariance, rtol=1e-7, atol=1e-9)
    mixed = module._covariance_of_noise(twice, both, np.repeat([1.0, 3.0], 50))
    np.testing.assert_allclose(mixed, covariance * (1 + 3 * 4) / 4, rtol=1e-7, atol=1e-9)


def test_no_variance_of_noise_is_below_a_thousandth_of_the_largest(rng):
    normals = rng.normal(size=(3, 50))
    found = module._covariance_of_noise(normals, normals[2] ** 2, np.ones(50))
    np.testing.assert_allclose(found, np.diag([1e-3, 1e-3, 1]), atol=1e-9)
    hundredfold = module._covariance_of_noise(normals, 100 * normals[2] ** 2, np.ones(50))
    np.testing.assert_allclose(hundredfold, 100 * found, atol=1e-7)


def test_noise_with_a_direction_moves_points_back_along_it():
    of = descent()
    weights = of.weights * of.inliers[0]
    normals = -of.derivatives[0, SHIFT] * of.problem.relative_noise
    covariance = module._covariance_of_noise(normals, (of.distances[0] * of.problem.relative_noise) ** 2, weights)
    expected = np.zeros(11)
    for j in range(60):
        normal, distance = normals[:, j], of.distances[0, j] * of.problem.relative_noise[j]
        towards = covariance @ normal
        across = towards / (normal @ towards) - normal
        across *= min(1, 3 / np.linalg.norm(across))
        back = of.points[j] - of.candidates.rotations[0] @ (distance * across)
        changed = (
            distances(of.candidates, back[None])[1][0, :, 0] / of.problem.relative_noise[j] - of.derivatives[0, :, j]
        )
        expected += weights[j] * of.distances[0, j] * changed / 0.06**2
    np.testing.assert_allclose(module._by_direction_of_noise(of), expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_natural_parameters_are_lengths_along_the_axes_of_the_world(kind, rng):
    body = Candidates.of([made(kind, (0.9, 1.1), (1.2, 0.8, 1.0))])
    p = body.n_parameters
    root = rng.normal(size=(p, p))
    change = np.eye(p)
    change[0, 0], change[1, 1], change[2, 2] = 1.2, 0.8, 1.0
    change[SHIFT, SHIFT] = body.rotations[0]
    if p == 12:
        change[11, 11] = 1.5
    np.testing.assert_allclose(module._of_parameters(body, root @ root.T), change @ root @ root.T @ change.T, rtol=1e-9)
    rows = rng.normal(size=(p, 7))
    np.testing.assert_allclose(_by_parameters(body, rows), np.linalg.inv(change).T @ rows, rtol=1e-9)


@pytest.mark.parametrize("fixed", [(), (3, 4)])
@pytest.mark.parametrize("sigma", [0.06, 0.4])
def test_the_covariance_is_that_of_the_flatter_likelihood_and_both_biases(fixed, sigma):
    of = descent(fixed=fixed, sigma=sigma)
    free = [k for k in range(11) if k not in fixed]
    linear, curved = module._linear(of)[np.ix_(free, free)], module._curvature(of)[np.ix_(free, free)]
    half = np.linalg.inv(np.linalg.cholesky(linear))
    ratios, axes = np.linalg.eigh(half @ curved @ half.T)
    inverse = half.T @ axes @ np.diag(1 / np.clip(ratios, 0.05, 1)) @ axes.T @ half
    expected = inverse.copy()
    for gradient in (module._by_size(of)[0], module._by_direction_of_noise(of)):
        moved = inverse @ gradient[free]
        expected += np.outer(moved, moved)
    whole = np.zeros((11, 11))
    whole[np.ix_(free, free)] = expected
    found = module.likelihood_covariance(of)
    np.testing.assert_allclose(found, module._of_parameters(of.candidates, whole), rtol=1e-6, atol=1e-12)
    assert (found[list(fixed)] == 0).all()


def test_a_large_cloud_is_sampled_and_its_information_and_penalty_scaled(monkeypatch):
    of = descent(penalty=Push())
    monkeypatch.setattr(module, "COVARIANCE", module.CovarianceSettings(points=30))
    monkeypatch.setattr(module, "evenly_chosen", lambda points, count: np.arange(30))
    factor = of.weights.sum() / of.weights[:30].sum()
    sample = Descent(of.problem.take(np.arange(30), 1 / factor), of.candidates, of.mixture)
    smaller = module._curvature(sample), module._linear(sample)
    half = np.linalg.inv(np.linalg.cholesky(factor * smaller[1]))
    ratios, axes = np.linalg.eigh(factor * half @ smaller[0] @ half.T)
    inverse = half.T @ axes @ np.diag(1 / np.clip(ratios, 0.05, 1)) @ axes.T @ half
    expected = inverse.copy()
    for gradient in (module._by_size(sample)[0], module._by_direction_of_noise(sample)):
        moved = inverse @ (factor * gradient)
        expected += np.outer(moved, moved)
    np.testing.assert_allclose(
        module.likelihood_covariance(of), module._of_parameters(of.candidates, expected), rtol=1e-6
    )


def test_directions_that_nothing_determines_have_a_huge_variance():
    """Points of a ball tell nothing of its rotations."""
    ball = Candidates.of([Superquadric()])
    n = len(NOISY)
    points = random_directions(n, 3)
    mixture = Mixture(np.array([0.9]), np.array([0.01]))
    of = Descent(SearchProblem(points, np.ones(n), "ellipsoid", {}, np.zeros(n), np.ones(n)), ball, mixture)
    variances = np.diag(module.likelihood_covariance(of))
    largest = np.linalg.eigvalsh(module._linear(of)).max()
    np.testing.assert_allclose(variances[5:8] * largest, 1e16, rtol=0.5)
    assert (variances[5:8] > 1).all() and (variances[[0, 1, 2, 8, 9, 10]] < 1e-3).all()


def test_rank_condition_and_covariance_of_what_is_determined(rng):
    body = Candidates.of([made(semi_axes=(1.2, 0.8, 1.0))])
    derivatives, weights = rng.normal(size=(11, 40)), rng.uniform(0.5, 2, 40)
    fixed = np.arange(11) == 8
    found = identifiability_of(body, derivatives, weights, 0.3, fixed)
    free = [k for k in range(11) if k != 8]
    rows = _by_parameters(body, derivatives)[free]
    information = sum(w * np.outer(row, row) for w, row in zip(weights, rows.T)) / 0.3**2
    prior = np.diag([1 / EXPONENT_SPREAD**2 if k in (3, 4) else 0.0 for k in free])
    expected = np.zeros((11, 11))
    expected[np.ix_(free, free)] = np.linalg.inv(information + prior)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.condition, np.sqrt(np.linalg.cond(information)), rtol=1e-6)
    assert found.rank == 10 and not found.symmetric


@pytest.mark.parametrize(("share", "symmetric"), [(0.89, False), (0.91, True)])
def test_a_weak_direction_that_only_rotates_is_a_symmetry(share, symmetric, rng):
    """With a fixed parameter before the rotations, so that places among the estimated ones differ."""
    body = Candidates.of([Superquadric()])
    direction = np.zeros(11)
    direction[6], direction[0] = np.sqrt(share), np.sqrt(1 - share)
    derivatives = rng.normal(size=(11, 60))
    derivatives -= np.outer(direction, direction @ derivatives) * (1 - 1e-6)
    fixed = np.arange(11) == 1
    # variances so small that none is above the limit of a rotation
    assert identifiability_of(body, derivatives, np.ones(60), 1e-9, fixed).symmetric == symmetric
    lost = derivatives - np.outer(direction, direction @ derivatives)
    found = identifiability_of(body, lost, np.ones(60), 1e-9, np.zeros(11, dtype=bool))
    assert found.rank == 10 and found.condition > 1e12


@pytest.mark.parametrize(("deviation", "symmetric"), [(0.19, False), (0.21, True)])
def test_a_rotation_that_is_known_to_a_fifth_only_is_a_symmetry(deviation, symmetric):
    body = Candidates.of([Superquadric()])
    derivatives = np.eye(11) / np.where(np.arange(11) == 7, deviation, 0.1)[:, None]
    assert identifiability_of(body, derivatives, np.ones(11), 1.0, np.zeros(11, dtype=bool)).symmetric == symmetric


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_variances_of_the_surface_are_those_of_its_parameters(kind, rng):
    """Points on the surface, moved by a parameter: the distance changes by its derivative."""
    body = made(kind, (0.9, 1.1))
    p = 12 if kind == "toroid" else 11
    root = rng.normal(size=(p, p))
    points = body.grid(4)[0][:20] + 0.01 * rng.normal(size=(20, 3))
    signed, variances = surface_at(body, root @ root.T, points)
    found, derivatives = distances(Candidates.of([body]), points)
    rows = _by_parameters(Candidates.of([body]), derivatives[0])
    np.testing.assert_allclose(variances, [row @ root @ root.T @ row for row in rows.T], rtol=1e-9)
    np.testing.assert_array_equal(signed, found[0])
    np.testing.assert_array_equal(surface_at(body, -root @ root.T, points)[1], 0)


@pytest.mark.parametrize("number", [0, 4, 5, 10])
@pytest.mark.parametrize("little", [0.5, 1e-6, 0.0])
def test_the_part_of_a_parameter_on_which_little_depends_is_determined_least(number, little):
    """In a unit ball, whose parameters are the internal ones; beside one that is fixed, on which nothing depends."""
    body, fixed = Candidates.of([Superquadric()]), np.arange(11) == 3
    derivatives = np.eye(11) * np.where(np.arange(11) == number, little, 1.0) * ~fixed
    part = {0: "semi-axes", 4: "exponents", 5: "rotation", 10: "translation"}[number]
    assert identifiability_of(body, derivatives, np.ones(11), 1.0, fixed).weakest == part
