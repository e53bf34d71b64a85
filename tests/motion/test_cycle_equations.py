"""The linear problem of a cycle against dense sums over frames, knots and control points."""

import numpy as np
import pytest

from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.regularisers import Bending
from quadriform.fitting.least_squares.selection import SELECTION
from quadriform.motion.cycle_equations import LinearCycleProblem
from quadriform.motion.energies import SmoothEnergy
from quadriform.shapes.bernstein import gram
from quadriform.shapes.splines import TimeBasis

SHAPE, FRAMES, KNOTS = (2, 2, 2), 5, 4
POINTS = int(np.prod(SHAPE))
BASIS = TimeBasis(np.arange(4.0), 4.0)
VALUES = BASIS.values(np.linspace(0, 3.9, FRAMES))
PENALTY = Bending().matrix(SHAPE)
MASS = np.kron(np.kron(gram(1), gram(1)), gram(1))
PAIR = (1e-3, 1e-2)


def equations(seed=0, rows=60):
    """Random rows over the control points of one frame."""
    rng = np.random.default_rng(seed)
    return NormalEquations.of_rows(rng.normal(size=(rows, 3 * POINTS)), rng.normal(size=rows), 1.0)


EACH = [equations(seed) for seed in range(FRAMES)]


def problem(**more):
    count = more.pop("count", 360.0)
    return LinearCycleProblem(more.pop("each", EACH), VALUES, BASIS, SmoothEnergy.of(PENALTY, SHAPE), count, **more)


def dense(alpha, gamma, each=EACH, count=360.0):
    """Matrix, right side and constant over all knots (K, k, 3), in the plain basis."""
    size = 3 * POINTS
    matrix, right = np.zeros((KNOTS * size, KNOTS * size)), np.zeros(KNOTS * size)
    for values, equation in zip(VALUES, each):
        spread = np.kron(values, np.eye(size))
        matrix += spread.T @ equation.matrix @ spread
        right += spread.T @ equation.right
    matrix += count * alpha * np.kron(BASIS.mass(), np.kron(PENALTY, np.eye(3)))
    matrix += count * gamma * np.kron(BASIS.bending(), np.kron(MASS, np.eye(3)))
    return matrix, right, sum(equation.constant for equation in each)


def test_the_cost_is_the_sum_over_frames_and_both_penalties(rng):
    displacement = rng.normal(size=(KNOTS, POINTS, 3))
    expected = sum(
        equation.squares(np.einsum("a,aki->ki", values, displacement)) for values, equation in zip(VALUES, EACH)
    )
    for a in range(KNOTS):
        for b in range(KNOTS):
            energy = np.sum(displacement[a] * (PENALTY @ displacement[b]))
            acceleration = np.sum(displacement[a] * (MASS @ displacement[b]))
            expected += 360 * (0.3 * BASIS.mass()[a, b] * energy + 0.7 * BASIS.bending()[a, b] * acceleration)
    assert problem().cost(displacement, np.zeros(0), 0.3, 0.7) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("pair", [PAIR, (1.0, 1e3)])
def test_the_solution_is_that_of_the_dense_problem(pair):
    matrix, right, constant = dense(*pair)
    found = problem().solve(*pair)
    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(found.displacement.ravel(), expected, rtol=1e-7, atol=1e-10)
    null = 3 * 4 * 3  # affine maps of each coordinate, at the mean and the first harmonic in time
    least = constant - right @ expected
    assert found.sigma == pytest.approx(np.sqrt(least / (360 - null)), rel=1e-9)
    assert found.motions.shape == (0,)


def plain_criterion(alpha, gamma, fraction=1.0):
    """Minus twice the log marginal likelihood but for the determinant of the change of basis."""
    matrix, right, constant = dense(alpha, gamma)
    penalty = dense(alpha, gamma, [NormalEquations(0 * e.matrix, 0 * e.right, 0.0) for e in EACH])[0]
    in_time, in_space = np.linalg.inv(np.linalg.cholesky(BASIS.mass())), np.linalg.inv(np.linalg.cholesky(MASS))
    white = np.kron(in_time, np.kron(in_space, np.eye(3)))
    values = np.linalg.eigvalsh(white @ penalty @ white.T)
    values = values[values > 1e-9 * values.max()]
    null = len(right) - len(values)
    misfit = (constant - right @ np.linalg.solve(matrix, right)) / (360 - null)
    return max(fraction * 360 - null, 1) * (np.log(misfit) + 1) + np.linalg.slogdet(matrix)[1] - np.log(values).sum()


@pytest.mark.parametrize("fraction", [1.0, 0.4, 0.05])
def test_the_criterion_is_the_evidence_up_to_a_constant(fraction):
    of = problem(effective_fraction=fraction)
    pairs = [PAIR, (1e-2, 1e-2), (1e-3, 1.0)]
    found = np.array([of.solve(*pair).criterion for pair in pairs])
    expected = np.array([plain_criterion(*pair, fraction) for pair in pairs])
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-6, atol=1e-6)


def test_noise_that_is_known_is_the_least(rng):
    free = problem().solve(*PAIR)
    known = problem(least_sigma=5.0).solve(*PAIR)
    assert free.sigma < 5 == known.sigma
    np.testing.assert_array_equal(known.displacement, free.displacement)
    fewer = problem(least_sigma=free.sigma / 2).solve(*PAIR)
    assert fewer.sigma == free.sigma
    exact = [NormalEquations.of_rows(rng.normal(size=(60, 3 * POINTS)), np.zeros(60), 1.0) for _ in range(FRAMES)]
    assert problem(each=exact).solve(*PAIR).sigma == SELECTION.sigma_floor


def test_fewer_rows_than_what_costs_nothing_leave_one_degree_of_freedom():
    rows = [problem(count=count).solve(*PAIR) for count in (37.5, 36.5, 20.0)]
    least = []
    for count in (37.5, 36.5, 20.0):
        matrix, right, constant = dense(*PAIR, count=count)
        least.append(constant - right @ np.linalg.solve(matrix, right))
    expected = np.sqrt(np.array(least) / [1.5, 1, 1])
    np.testing.assert_allclose([row.sigma for row in rows], expected, rtol=1e-7)


def test_penalties_move_the_solution_and_are_no_part_of_the_noise():
    extra = [equations(50 + seed, 5) for seed in range(FRAMES)]
    both = [one + other for one, other in zip(EACH, extra)]
    of = problem().with_extra_terms(extra)
    found = of.solve(*PAIR)
    matrix, right, _ = dense(*PAIR, both)
    np.testing.assert_allclose(found.displacement.ravel(), np.linalg.solve(matrix, right), rtol=1e-7, atol=1e-10)
    cost = problem().cost(found.displacement, found.motions, *PAIR)
    assert found.sigma == pytest.approx(np.sqrt(cost / (360 - 36)))
    again = of.with_extra_terms(extra).solve(*PAIR)
    cost = problem().cost(again.displacement, again.motions, *PAIR)
    assert again.sigma == pytest.approx(np.sqrt(cost / (360 - 36)))
    assert problem().cost(found.displacement, found.motions, *PAIR) < of.cost(found.displacement, found.motions, *PAIR)


def test_further_unknowns_border_the_problem(rng):
    coupling, own, right_of = 0.3 * rng.normal(size=(2, FRAMES, 3 * POINTS)), 50 * np.eye(2), rng.normal(size=2)
    found = problem(bordered_block=(coupling, own, right_of)).solve(*PAIR)
    matrix, right, _ = dense(*PAIR)
    across = np.stack([sum(np.kron(v, c) for v, c in zip(VALUES, each)) for each in coupling], axis=1)
    whole = np.block([[matrix, across], [across.T, own]])
    expected = np.linalg.solve(whole, np.concatenate([right, right_of]))
    np.testing.assert_allclose(found.displacement.ravel(), expected[:-2], rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(found.motions, expected[-2:], rtol=1e-7)
    complement = own - across.T @ np.linalg.solve(matrix, across)
    np.testing.assert_allclose(found.motion_matrix, complement, rtol=1e-7, atol=1e-9)
    of = problem(bordered_block=(coupling, own, right_of))
    zero = of.cost(found.displacement, 0 * found.motions, *PAIR)
    step = found.motions @ own @ found.motions - 2 * right_of @ found.motions
    step += 2 * found.motions @ (across.T @ found.displacement.ravel())
    assert of.cost(found.displacement, found.motions, *PAIR) - zero == pytest.approx(step, rel=1e-7)


def test_the_strength_in_time_is_the_best_within_a_factor_of_a_thousand():
    of = problem()
    grid = np.exp(np.linspace(np.log(1e-9), np.log(1e9), 43))
    criteria = [of.solve(1e-3, gamma).criterion for gamma in grid]
    best = np.log(grid[int(np.argmin(criteria))])
    found = np.log(of.best_in_time(1e-3, float(np.exp(best + 2))))
    assert found == pytest.approx(best, abs=1.0)
    far = np.log(of.best_in_time(1e-3, float(np.exp(best + 20))))
    assert far == pytest.approx(best + 20 - np.log(1e3), abs=1.0)


def test_without_motion_that_is_penalised_the_strength_stays():
    """Of three splines of a period none is beyond the mean and the first harmonic. Old bug: rounding was penalised."""
    basis = TimeBasis(np.arange(3.0), 3.0)
    of = LinearCycleProblem(
        EACH, basis.values(np.linspace(0, 2.9, FRAMES)), basis, SmoothEnergy.of(PENALTY, SHAPE), 360.0
    )
    assert of.best_in_time(1e-3, 0.123) == 0.123


def test_the_posterior_is_that_of_the_dense_problem_with_extra_terms():
    extra = [equations(50 + seed, 5) for seed in range(FRAMES)]
    of = problem(effective_fraction=0.25).with_extra_terms(extra)
    # with unit vectors in the place of random numbers the samples are a root of the covariance
    found = of.posterior(*PAIR, 0.3, np.eye(len(of.right)))
    half = found.deviations.reshape(len(found.deviations), -1)
    matrix, _, _ = dense(*PAIR, [one + other for one, other in zip(EACH, extra)])
    expected = 0.3**2 / 0.25 * np.linalg.inv(matrix)
    np.testing.assert_allclose(half.T @ half, expected, rtol=1e-6, atol=1e-9 * expected.max())
    assert found.covariance.shape == (0, 0)


def test_further_unknowns_widen_the_posterior_and_have_one(rng):
    coupling, root = rng.normal(size=(2, FRAMES, 3 * POINTS)), rng.normal(size=(2, 2))
    own = root @ root.T + 100 * np.eye(2)
    of = problem(bordered_block=(coupling, own, np.zeros(2)))
    found = of.posterior(*PAIR, 0.3, np.eye(len(of.right)))
    across = np.einsum("fa,sfp->aps", VALUES, coupling).reshape(-1, 2)
    inverse = 0.09 * np.linalg.inv(np.block([[dense(*PAIR)[0], across], [across.T, own]]))
    half = found.deviations.reshape(len(found.deviations), -1)
    np.testing.assert_allclose(half.T @ half, inverse[:-2, :-2], rtol=1e-6, atol=1e-9 * inverse.max())
    np.testing.assert_allclose(found.covariance, inverse[-2:, -2:], rtol=1e-9)


def test_undetermined_control_points_have_no_posterior():
    empty = [NormalEquations(0 * e.matrix, 0 * e.right, 0.0) for e in EACH]
    of = problem(each=empty)
    assert of.posterior(*PAIR, 0.3, np.eye(len(of.right))) is None
