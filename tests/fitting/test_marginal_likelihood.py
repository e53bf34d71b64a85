"""The search for the strength on criteria that are known in closed form, and each formula of a solution by itself."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from quadriform.fitting.least_squares import marginal_likelihood as likelihood
from quadriform.fitting.least_squares.factorisation import cholesky_factor, spectrum
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem, Minimum, Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.selection import SELECTION


def searched(derivative):
    """What `LinearProblem._by_secants` finds for a derivative of the criterion, and where that was evaluated."""
    at = []

    def recorded(x):
        at.append(x)
        return derivative(x)

    def root(*arguments):
        at.clear()
        return LinearProblem._by_secants(SimpleNamespace(_derivative=recorded), *arguments)

    return root, at


WIDE = (-100.0, 100.0)


def test_secant_steps_find_the_root_of_a_line_at_once():
    root, at = searched(lambda x: 3 * (x - 2))
    assert root(0.0, 0.1, WIDE, 1e-6) == pytest.approx((2, 3, False))
    assert at == pytest.approx([0, 0.1, 2])
    assert root(0.0, 0.1, WIDE, 1e-6, -6.0) == pytest.approx((2, 3, False))
    assert at == pytest.approx([0.1, 2])


def test_secant_steps_follow_the_last_two_points_until_a_step_is_short():
    def derivative(x):
        return np.exp(x) - 2

    root, at = searched(derivative)
    one, other = 0.0, 0.1
    for tolerance in (1e-1, 1e-3, 1e-9):
        found = root(one, other, WIDE, tolerance)
        points = [one, other]
        while True:
            curvature = (derivative(points[-1]) - derivative(points[-2])) / (points[-1] - points[-2])
            points.append(points[-1] - derivative(points[-1]) / curvature)
            if abs(points[-1] - points[-2]) < tolerance:
                break
        assert found == pytest.approx((points[-1], curvature, False), rel=1e-12)
        assert at == pytest.approx(points[:-1], rel=1e-12)


def test_no_root_is_given_where_the_search_cannot_go_on():
    line = searched(lambda x: 3 * (x - 2))[0]
    assert line(0.0, 0.1, (-1.0, 1.99), 1e-6) is None  # beyond the bounds
    assert line(4.0, 4.1, (2.01, 9.0), 1e-6) is None
    assert searched(lambda x: -3 * (x - 2))[0](0.0, 0.1, WIDE, 1e-6) is None  # a maximum
    assert searched(lambda x: 1.0)[0](0.0, 0.1, WIDE, 1e-6) is None  # neither
    assert searched(lambda x: None)[0](0.0, 0.1, WIDE, 1e-6) is None
    assert searched(lambda x: None if x < 0.05 else 1.0)[0](0.0, 0.1, WIDE, 1e-6) is None
    assert searched(lambda x: None if x > 0.05 else 1.0)[0](0.0, 0.1, WIDE, 1e-6) is None
    jumps = iter(2.0 ** np.arange(20) * (-1.0) ** np.arange(20))
    assert searched(lambda x: next(jumps))[0](0.0, 1.0, (-1e9, 1e9), 1e-6) is None


def test_at_most_eight_steps_are_made():
    """Towards a root of high order each step gains but a little."""
    root, at = searched(lambda x: (x - 1) ** 9 + 0.0)
    assert root(-9.0, -8.0, WIDE, 1e-6) is None
    assert len(at) == 2 + SELECTION.most_steps


def test_where_both_derivatives_are_small_the_criterion_is_flat():
    for size, flat in ((0.019, True), (0.021, False)):
        root, _ = searched(lambda x, size=size: size if x else -0.01)
        assert (root(0.0, 0.1, WIDE, 1e-6) == (0.0, 0.0, True)) == flat
        other, _ = searched(lambda x, size=size: -size if not x else 0.01)
        assert (other(0.0, 0.1, WIDE, 1e-6) == (0.0, 0.0, True)) == flat


@pytest.mark.parametrize(("strength", "low", "high"), [(1.0, 1 / 30, 30), (1e-12, 1e-13, 3e-11), (1e5, 1e5 / 30, 3e4)])
def test_a_later_search_stays_within_a_factor_of_30_and_the_range(strength, low, high):
    assert np.exp(likelihood._search_range(strength)) == pytest.approx([low, high])


def stand_in(criterion, derivative=lambda x: None, **methods):
    """A stand-in with a criterion and a derivative by the logarithm of the strength, solved everywhere."""
    made = SimpleNamespace(
        _criterion=lambda strength: criterion(np.log(strength)),
        _derivative=derivative,
        _at_minimum=lambda minimum: minimum[:2],
        **methods,
    )
    for name in ("_by_secants", "_best_decade", "_without_derivatives", "best", "best_after"):
        if not hasattr(made, name):
            setattr(made, name, getattr(LinearProblem, name).__get__(made))
    return made


def test_the_first_search_begins_at_the_least_of_the_best_decades():
    decades = np.arange(-13, 4)
    for best in (-13, -4, 3):
        found = stand_in(lambda x, best=best: abs(x - np.log(10.0) * best))._best_decade()
        assert found == pytest.approx(10.0**best)
    values = np.where(decades >= -2, 5.0, 9.0)
    values[decades == -5] = 5.0099
    flat = stand_in(lambda x: values[np.abs(decades - x / np.log(10)).argmin()])
    assert flat._best_decade() == pytest.approx(1e-5)
    values[decades == -5] = 5.0101
    assert flat._best_decade() == pytest.approx(1e-2)


def test_without_derivatives_the_minimum_is_found_to_a_tenth():
    made = stand_in(lambda x: (x + 3) ** 2 if x > -4 else np.inf)
    assert made._without_derivatives(-9.0, 5.0) == pytest.approx(-3, abs=0.1)
    assert made._without_derivatives(-2.0, 5.0) == pytest.approx(-2, abs=0.2)


def test_the_best_strength_is_the_root_of_the_derivative():
    made = stand_in(lambda x: (x + 3) ** 2, lambda x: 2 * (x + 3))
    assert made.best() == pytest.approx((-3, 2))
    assert made.best(np.exp(-2.0)) == pytest.approx((-3, 2))
    # farther than thirty times: the end of the range near the strength, by values
    x, curvature = made.best(np.exp(3.0))
    assert x == pytest.approx(3 - np.log(30), abs=0.2) and curvature == 0


def test_where_the_derivative_is_flat_the_whole_range_is_searched_and_then_it_is_taken():
    made = stand_in(lambda x: 0.0 if x > 0 else x**2, lambda x: 0.0 if x > 0 else 2 * x)
    assert made.best(np.exp(2.0))[0] == pytest.approx(np.log(made._best_decade()), abs=0.5)
    everywhere = stand_in(lambda x: 0.0, lambda x: 0.0)
    assert everywhere.best() == pytest.approx((np.log(1e-13), 0))


def test_where_steps_fail_values_lead_near_and_steps_are_tried_again_from_there():
    """The derivative rises only close to the minimum, of which a local search knows nothing."""
    calls = []

    def root(x, other, bounds, tolerance):
        calls.append((x, other, bounds, tolerance))
        return None if len(calls) == 1 else Minimum(-2.9, 1.5)

    made = stand_in(lambda x: (x + 3) ** 2, _by_secants=root)
    assert made.best(np.exp(-2.0)) == (-2.9, 1.5)
    (_, _, _, _), (x, other, bounds, tolerance) = calls
    assert x == pytest.approx(-3, abs=0.1) and other == pytest.approx(x + 0.1)
    assert bounds == pytest.approx((x - 0.3, x + 0.3)) and tolerance == SELECTION.tolerance
    calls.clear()
    made._by_secants = lambda *of: calls.append(of)
    x, curvature = made.best(np.exp(-2.0))
    assert x == pytest.approx(-3, abs=0.1) and curvature == 0 and len(calls) == 2


def test_the_second_point_of_a_search_stays_in_the_range():
    calls = []
    made = stand_in(lambda x: 0.0, _by_secants=lambda *of: calls.append(of) or Minimum(0.0, 1.0))
    made.best(3e4)
    assert calls[0][:2] == pytest.approx([np.log(3e4)] * 2)
    assert calls[0][2] == pytest.approx((np.log(1e3), np.log(3e4)))
    made.best(2.0)
    assert calls[1][:2] == pytest.approx([np.log(2), np.log(2) + 0.1])


def before(strength, curvature):
    return Solution(np.zeros((1, 3)), strength, 1.0, 0.0, np.eye(3), np.eye(1), criterion_curvature=curvature)


def test_a_later_round_takes_one_newton_step_with_the_curvature_before():
    line = stand_in(lambda x: 0.0, lambda x: 2 * (x - 1))
    assert line.best_after(before(np.exp(1.01), 2.0)) == pytest.approx((1, 2))  # a short step: taken
    assert line.best_after(before(np.exp(1.029), 2.0)) == pytest.approx((1, 2))
    assert line.best_after(before(np.exp(1.01), 1.0)) == pytest.approx((0.99, 1))
    # a step of more than 0.03 is followed by those of a search, from the derivative that is known
    calls = []
    line._by_secants = lambda *of: calls.append(of) or Minimum(0.5, 3.0)
    assert line.best_after(before(np.exp(1.031), 2.0)) == (0.5, 3)
    x, step, bounds, tolerance, derivative = calls[0]
    assert (x, step, derivative) == pytest.approx((1.031, 1, 0.062))
    assert bounds == pytest.approx((1.031 - np.log(30), 1.031 + np.log(30))) and tolerance == 0.03
    assert line.best_after(before(np.exp(0.969), 2.0)) == (0.5, 3)
    # neither without a curvature, nor without a derivative, nor where the steps fail
    line.best = lambda strength: ("best", strength)
    assert line.best_after(before(np.exp(1.01), 0.0)) == ("best", pytest.approx(np.exp(1.01)))
    line._by_secants = lambda *of: None
    assert line.best_after(before(np.exp(2.0), 2.0)) == ("best", pytest.approx(np.exp(2.0)))
    line._derivative = lambda x: None
    assert line.best_after(before(np.exp(1.01), 2.0)) == ("best", pytest.approx(np.exp(1.01)))


def test_an_undetermined_strength_is_raised_until_it_determines_the_control_points():
    asked = []

    def solve(strength):
        asked.append(strength)
        return before(strength, 0.0) if len(asked) > tries else None

    for tries, factor in ((0, 1.0), (1, 10.0), (16, 1e16)):
        asked.clear()
        found = LinearProblem._at_minimum(SimpleNamespace(solve=solve), Minimum(np.log(2.0), 7.0))
        assert found.strength == pytest.approx(2 * factor)
        assert found.criterion_curvature == (0 if tries else 7)
    np.testing.assert_allclose(np.diff(np.log10(asked[1:])), 1)


def test_the_derivative_of_the_criterion_is_that_of_its_values(rng):
    problem = stacked_problem(rng)
    for x in (-6.0, -2.0, 1.0):
        ahead, behind = (problem._criterion(float(np.exp(x + h))) for h in (1e-4, -1e-4))
        assert problem._derivative(x) == pytest.approx((ahead - behind) / 2e-4, rel=1e-4, abs=1e-4)


def test_degrees_of_freedom_are_counts_less_the_null_space_and_at_least_one(rng):
    problem = stacked_problem(rng, effective_fraction=0.5)
    assert problem._freedom == (40 - 3, 20 - 3)
    few = stacked_problem(rng, effective_fraction=0.09)
    assert few._freedom == (37, 1)
    assert replace(problem, total_weight=3.9)._freedom == (1, 1)
    assert problem._variance(74.0) == 2
    assert problem._variance(0.0) == 1e-18
    known = stacked_problem(rng, least_sigma=0.3)
    assert known._variance(0.0) == pytest.approx(0.09)


def test_the_condition_number_is_that_of_the_matrix_with_unit_diagonal(rng):
    matrix = rng.normal(size=(6, 6))
    matrix = matrix @ matrix.T + np.diag([1e-3, 1, 1, 1, 1, 1e6])
    scaled = matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    solution = Solution(np.zeros((2, 3)), 1.0, 1.0, 0.0, np.linalg.cholesky(matrix), np.eye(2), 0.25)
    assert solution.condition == pytest.approx(np.linalg.cond(scaled, 1), rel=0.5)
    assert solution.independent_sigma == 2


def test_a_pivot_that_is_lost_in_rounding_is_no_factor():
    assert cholesky_factor(np.array([[4.0, 2.0], [2.0, 5.0]])).tolist() == [[2, 0], [1, 2]]
    assert cholesky_factor(np.array([[1.0, 2.0], [2.0, 1.0]])) is None
    eps = np.finfo(float).eps
    for left, is_found in ((8 * eps, True), (1.0 * eps, False)):
        matrix = 9 * np.array([[1.0, 1.0], [1.0, 1.0 + left]])
        assert (cholesky_factor(matrix) is not None) == is_found


def test_eigenvalues_below_rounding_cost_nothing():
    values, vectors = spectrum(np.diag([0.9e-10, 1.1e-10, 1.0]).tobytes())
    np.testing.assert_allclose(values, [0, 1.1e-10, 1])
    np.testing.assert_allclose(np.abs(vectors), np.eye(3))
    assert spectrum(np.diag([-0.9e-10, 0.5, 1.0]).tobytes())[0].tolist() == [0, 0.5, 1]


def stacked_problem(rng, **known):
    """Rows of random data over three control points, of which one combination costs nothing."""
    rows, heights = rng.normal(size=(40, 9)), rng.normal(size=40)
    chain = np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    return LinearProblem(NormalEquations.of_rows(rows, heights, 1.0), chain, 40, **known)
