"""Steps of the descent against plain ones: each candidate by itself, each term of its matrix by a loop."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import made

from quadriform.fitting.mixture import Mixture, estimated
from quadriform.fitting.superquadric import levenberg_marquardt
from quadriform.fitting.superquadric.candidates import Candidates, Extent
from quadriform.fitting.superquadric.empty_space import PenaltyTerms
from quadriform.fitting.superquadric.levenberg_marquardt import EXPONENT_SPREAD, Descent, accelerated
from quadriform.fitting.superquadric.problem import SearchProblem

POINTS = random_directions(40, 1) * [1.2, 0.8, 1.0] + np.random.default_rng(9).normal(0, 0.05, (40, 3))


class Pull:
    """A penalty with numbers of its own for each candidate."""

    def penalty(self, candidates, mixture):
        n, p = len(candidates), candidates.n_parameters
        rng = np.random.default_rng(8)
        root = 0.3 * rng.normal(size=(n, p, p))
        cost = (candidates.log_axes**2).sum(axis=1) * mixture.sigma
        return PenaltyTerms(cost, 0.1 * rng.normal(size=(n, p)), root @ np.swapaxes(root, 1, 2))

    def of_sample(self, fraction):
        return self


def bodies(kind="ellipsoid"):
    return Candidates.of([made(kind, e, a) for e, a in (((1, 1), (1.3, 0.9, 0.8)), ((0.5, 1.6), (0.7, 1.1, 1.2)))])


def centred(candidates):
    return replace(candidates, translations=0.05 * candidates.translations)


def descent(kind="ellipsoid", penalty=None, fixed=None, longest=5.0, candidates=None):
    rng = np.random.default_rng(2)
    candidates = centred(bodies(kind)) if candidates is None else candidates
    mixture = Mixture(np.array([0.7, 0.9])[: len(candidates)], np.array([0.1, 0.3])[: len(candidates)])
    weights, odds, noise = rng.uniform(0.5, 2, 40), rng.normal(0, 0.2, 40), rng.uniform(0.8, 1.3, 40)
    problem = SearchProblem(POINTS, weights, kind, {}, odds, noise, empty=penalty, longest=longest)
    found = Descent(problem, candidates, mixture)
    found.fixed_mask = found.fixed_mask if fixed is None else fixed
    return found


def plain_step(of, i):
    """The step of one candidate, with its matrix summed point by point."""
    p, sigma = of.candidates.n_parameters, of.mixture.sigma[i]
    matrix, gradient = np.zeros((p, p)), np.zeros(p)
    for j in range(40):
        weight, row = of.weights[j] * of.inliers[i, j], of.derivatives[i, :, j]
        matrix += weight * np.outer(row, row)
        gradient += weight * row * of.distances[i, j]
    exponents = of.candidates.exponents[i]
    by_size = of.extent().derivatives(of.candidates)[i]
    for k in range(2):
        matrix[3 + k, 3 + k] += sigma**2 / EXPONENT_SPREAD**2
        gradient[3 + k] += sigma**2 / EXPONENT_SPREAD**2 * (exponents[k] - 1)
    for k in range(3):
        matrix[k, k] += sigma**2 * by_size[k]
        gradient[k] += sigma**2 * by_size[k]
    if of.problem.empty is not None:
        terms = of.problem.empty.penalty(of.candidates, of.mixture)
        matrix, gradient = matrix + terms.matrix[i], gradient + terms.gradient[i]
    free = [k for k in range(p) if not of.fixed_mask[k]]
    free = [k for k in free if k not in (5, 6, 7) or matrix[k, k] > 1e-20 * matrix.diagonal().max()]
    for k in range(3):
        if of.candidates.log_axes[i, k] >= np.log(of.problem.longest) and gradient[k] < 0 and k in free:
            free.remove(k)
    for k in range(2):
        outward = (exponents[k] <= 0.01 and gradient[3 + k] > 0) or (exponents[k] >= 2 and gradient[3 + k] < 0)
        if outward and 3 + k in free:
            free.remove(3 + k)
    part = matrix[np.ix_(free, free)]
    part += of.damping[i] * np.diag(part.diagonal()) + 1e-13 * part.diagonal().max() * np.eye(len(free))
    step = np.zeros(p)
    step[free] = -np.linalg.solve(part, gradient[free])
    return step * min(1, 0.5 / np.abs(step).max())


@pytest.mark.parametrize("penalty", [None, Pull()], ids=["points", "with a penalty"])
@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_a_step_is_that_of_damped_weighted_squares_and_the_priors(kind, penalty):
    of = descent(kind, penalty)
    of.damping = np.array([0.01, 3.0])
    np.testing.assert_allclose(of._step(), [plain_step(of, i) for i in range(2)], rtol=1e-7, atol=1e-12)


def test_fixed_parameters_and_those_at_a_bound_stay():
    candidates = centred(bodies())
    at_bounds = replace(candidates, exponents=np.array([[0.01, 2.0], [2.0, 0.01]]))
    for longest in (5.0, float(np.exp(candidates.log_axes[0, 0])), float(np.exp(candidates.log_axes.min()))):
        fixed = np.arange(11) % 4 == 1
        of = descent(fixed=fixed, longest=longest, candidates=at_bounds)
        step = of._step()
        np.testing.assert_allclose(step, [plain_step(of, i) for i in range(2)], rtol=1e-7, atol=1e-12)
        assert (step[:, fixed] == 0).all() and (step != 0).any(axis=1).all()


def test_a_ball_does_not_turn_and_its_distances_are_exact():
    ball = Candidates.of([made(exponents=(1, 1), semi_axes=(1.1, 1.1, 1.1))])
    ball = replace(ball, translations=np.array([[0.1, 0.2, 0.3]]))
    of = descent(candidates=ball)
    assert (of._step()[:, 5:8] == 0).all()
    radii = np.linalg.norm(POINTS - [0.1, 0.2, 0.3], axis=1) - 1.1
    np.testing.assert_allclose(of.distances[0], radii / of.problem.relative_noise, rtol=1e-9, atol=1e-12)


def test_scores_are_the_weighted_densities_less_parameters_and_size():
    of = descent(penalty=Pull())
    extent = Extent.of("ellipsoid", POINTS, of.weights * of.inliers)
    for i in range(2):
        density = sum(w * d for w, d in zip(of.weights, of.log_density[i]))
        penalty = extent.cost(of.candidates)[i] + Pull().penalty(of.candidates, of.mixture).cost[i]
        np.testing.assert_allclose(of.scores()[i], density + 11 * np.log(of.mixture.sigma[i]) - penalty, rtol=1e-12)


def test_the_penalty_on_size_grows_with_the_area_of_the_box_over_that_of_the_data(rng):
    inliers, candidates = rng.uniform(0, 1, (2, 40)), bodies()
    found = Extent.of("ellipsoid", POINTS, inliers)
    for i in range(2):
        total = inliers[i].sum()
        middle = sum(w * p for w, p in zip(inliers[i], POINTS)) / total
        variance = sum(w * ((p - middle) ** 2).sum() for w, p in zip(inliers[i], POINTS)) / total
        a, b, c = np.exp(candidates.log_axes[i])
        np.testing.assert_allclose(found.weights[i], 0.03 * total, rtol=1e-12)
        np.testing.assert_allclose(found.areas[i], 3 * variance, rtol=1e-9)
        expected = 0.03 * total * np.log(1 + (a * b + b * c + c * a) / (3 * variance))
        np.testing.assert_allclose(found.cost(candidates)[i], expected, rtol=1e-9)


@pytest.mark.parametrize("scale", [0.1, 3.0])
def test_steps_are_taken_where_the_penalised_likelihood_does_not_fall(scale):
    """Accepted steps divide the damping by 5, rejected ones multiply it by 4; the rest stays as it was."""
    of = descent(penalty=Pull())
    step = of._step() * np.array([[scale], [-scale]])
    old, old_derivatives, inliers = of.distances.copy(), of.derivatives.copy(), of.inliers.copy()
    candidates, moved, expected = of.candidates, of.candidates.moved(step, of.problem.longest), []
    for each in (candidates, moved):
        found = levenberg_marquardt.distances(each, POINTS)[0] / of.problem.relative_noise
        density = of.mixture.densities(found, of.problem.log_odds)[1] @ of.weights
        prior = ((each.exponents - 1) ** 2).sum(axis=1) / (2 * EXPONENT_SPREAD**2)
        expected.append(density - prior - of.extent().cost(each) - Pull().penalty(each, of.mixture).cost)
    accepted = of._try(step)
    np.testing.assert_array_equal(accepted, expected[1] >= expected[0])
    np.testing.assert_allclose(of.damping, np.where(accepted, 0.002, 0.04))
    assert accepted.any() and not accepted.all()
    there = levenberg_marquardt.distances(moved, POINTS)
    for i in range(2):
        np.testing.assert_array_equal(
            of.distances[i], there[0][i] / of.problem.relative_noise if accepted[i] else old[i]
        )
        np.testing.assert_array_equal(
            of.derivatives[i], there[1][i] / of.problem.relative_noise if accepted[i] else old_derivatives[i]
        )
        from_ = moved if accepted[i] else candidates
        np.testing.assert_array_equal(of.candidates.log_axes[i], from_.log_axes[i])
        again = of.mixture.densities(there[0] / of.problem.relative_noise, of.problem.log_odds)[0][i]
        np.testing.assert_array_equal(of.inliers[i], again if accepted[i] else inliers[i])


def test_damping_has_limits():
    of = descent()
    of.damping = np.array([1e-12, 1e8])
    of._try(of._step() * np.array([[1.0], [-1.0]]))
    np.testing.assert_allclose(of.damping, [1e-12, 1e8])


def test_the_change_is_the_least_of_that_of_parameters_and_of_distances():
    of = descent()
    of.mixture = Mixture(of.mixture.inlier_ratio, np.array([0.5, 1e-5]))
    step = np.random.default_rng(4).normal(size=(2, 11)) * np.array([[1.0], [1e-3]])
    expected = []
    for i, sigma in enumerate((0.5, 1e-3)):
        predicted = max(abs(step[i] @ of.derivatives[i, :, j]) for j in range(40))
        expected.append(min(np.abs(step[i]).max(), predicted / sigma))
    np.testing.assert_allclose(of._change(step), expected, rtol=1e-12)


def reestimated(of):
    return estimated(of.distances, of.inliers, of.weights, of.candidates.n_parameters)


def test_a_run_ends_where_all_candidates_change_little():
    of = descent()
    assert not of.run(2, reestimated, 1e-2) and len(of.history) == 2
    assert of.run(300, reestimated, 1e-2)
    assert of.history[-1] == of.mixture.sigma.min()
    assert (of._change(of._step()) < 0.1).all()


@pytest.mark.parametrize(
    ("damping", "accepted", "converged"), [(0.9, False, True), (1.0, False, False), (9.0, True, True)]
)
def test_a_short_step_that_is_rejected_and_damped_is_no_convergence(monkeypatch, damping, accepted, converged):
    of = descent()
    of.damping = np.array([damping, 0.1])
    monkeypatch.setattr(of, "_change", lambda step: np.array([0.5e-3, 0.9e-3]))
    monkeypatch.setattr(of, "_try", lambda step: np.array([accepted, True]))
    assert of.run(5, lambda of: of.mixture, 1e-3) == converged
    assert len(of.history) == 1
    assert not of.run(5, lambda of: of.mixture, 0.7e-3)
    assert len(of.history) == 6


def test_accelerated_steps_reach_the_fixed_point_or_all_stays():
    one = descent().candidates.take(np.array([0]))
    of = descent(candidates=one)
    assert of.run(30, reestimated, 1e-2)
    before, mixture = of.candidates, of.mixture
    assert not of.converge(2, reestimated, 1e-12)
    np.testing.assert_array_equal(of.candidates.log_axes, before.log_axes)
    np.testing.assert_allclose(of.mixture.sigma, mixture.sigma, rtol=1e-12)
    np.testing.assert_array_equal(
        of.distances, levenberg_marquardt.distances(before, POINTS)[0] / of.problem.relative_noise
    )
    assert of.converge(60, reestimated, 1e-9)
    np.testing.assert_array_equal(of.damping, [0])
    assert np.abs(of._step()).max() < 1e-7
    again = reestimated(of)
    np.testing.assert_allclose(
        [again.sigma, again.inlier_ratio], [of.mixture.sigma, of.mixture.inlier_ratio], rtol=1e-6
    )


def test_accelerated_steps_are_at_most_half_and_start_anew_after_one_twice_as_large(monkeypatch):
    """The state of the iteration as the acceleration is given it, with steps that are known."""
    one = descent().candidates.take(np.array([0]))
    of, given = descent(candidates=one), []
    steps = iter([0.1, 0.19, 0.39, 0.2, 1e-9])

    def recorded(positions, proposals):
        given.append((len(positions), len(proposals), np.abs(proposals[-1]).max()))
        motion = np.zeros(13)
        motion[8] = 2 * proposals[-1][0]
        return motion

    monkeypatch.setattr(of, "_step", lambda: np.append(next(steps), np.zeros(10))[None])
    monkeypatch.setattr(levenberg_marquardt, "accelerated", recorded)
    at = of.candidates.translations
    assert of.converge(5, lambda of: of.mixture, 1e-6)
    assert given == [(1, 1, 0.1), (2, 2, 0.19), (1, 1, 0.39), (2, 2, 0.2), (3, 3, 1e-9)]
    moved = one.rotations[0] @ [0.2 + 0.38 + 0.5 + 0.4 + 2e-9, 0, 0]
    np.testing.assert_allclose((of.candidates.translations - at)[0], moved, rtol=1e-12)


def test_acceleration_finds_the_fixed_point_of_a_linear_map(rng):
    """From as many steps as there are numbers, and one more."""
    matrix = 0.5 * rng.normal(size=(3, 3))
    fixed, at = rng.normal(size=3), [rng.normal(size=3) for _ in range(4)]
    proposals = [matrix @ (x - fixed) for x in at]
    np.testing.assert_allclose(at[-1] + accelerated(at, proposals), fixed, rtol=1e-9)
    np.testing.assert_array_equal(accelerated(at[:1], proposals[:1]), proposals[0])
    np.testing.assert_allclose(accelerated([at[0], at[0] + 1], [at[1], at[1]]), at[1])


def test_inlier_weights_of_the_size_are_those_of_the_points():
    of = descent()
    of.problem = replace(of.problem, size=0.5)
    expected = Extent.of("ellipsoid", POINTS, 0.5 * of.weights * of.inliers)
    np.testing.assert_allclose(of.extent().weights, expected.weights, rtol=1e-12)
    candidates, mixture = of.picked(np.array([1]))
    np.testing.assert_array_equal(candidates.log_axes[0], of.candidates.log_axes[1])
    assert mixture.sigma.tolist() == [0.3]


def test_the_prior_on_exponents_is_normal_around_one():
    """Its deviation is that of numbers anywhere between 0.01 and 2."""
    bodies_of = Candidates.of([made(exponents=(1.0, 1.0)), made(exponents=(0.3, 1.8))])
    spread = 1.99 / np.sqrt(12)
    np.testing.assert_allclose(levenberg_marquardt._log_prior(bodies_of), [0, -(0.7**2 + 0.8**2) / (2 * spread**2)])


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_scores_count_the_parameters_that_are_estimated(kind):
    """-(n - p) log sigma with p of these alone: with k parameters fixed the score is lower by k log sigma."""
    of = descent(kind)
    fixed = {"exponents": np.ones(2), "rotation": np.eye(3)}
    some = Descent(replace(of.problem, fixed=fixed), of.candidates, of.mixture)
    np.testing.assert_allclose(of.scores() - some.scores(), 5 * np.log(of.mixture.sigma), rtol=1e-9)
