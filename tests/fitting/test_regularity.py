"""Step 2: truncated SVD, springs to the letter and on the displacement, a regulariser of one's own."""

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.errors import OptionError
from quadriform.fitting.least_squares.regularisers import Springs
from quadriform.fitting.paper.solvers import (
    penalised_step,
    step_for,
    svd_position_step,
    svd_step,
    truncated_svd,
)
from quadriform.shapes.control_box import ControlBox

SHAPE = (3, 4, 3)


def system(exponents=(1, 1), shape=SHAPE):
    """Deformation matrix of a superellipsoid, its control points at rest, and a field of displacements."""
    s = made(exponents=exponents)
    box = ControlBox.around(s, shape)
    b = box.matrix(s.surface(even_directions(400)))
    return b, box.control_points.reshape(-1, 3), 0.2 * np.random.default_rng(1).normal(size=(400, 3))


def double_sum(control):
    """P9's penalty, written out: over each control point, over its 6 neighbours."""
    total = 0.0
    for j in np.ndindex(SHAPE):
        for axis in range(3):
            for side in (-1, 1):
                other = list(j)
                other[axis] += side
                if 0 <= other[axis] < SHAPE[axis]:
                    total += ((control[j] - control[tuple(other)]) ** 2).sum()
    return total


def test_springs_are_the_double_sum_of_p9(rng):
    control = rng.normal(size=(*SHAPE, 3))
    flat = control.reshape(-1, 3)
    assert np.einsum("kd,kl,ld->", flat, Springs().matrix(SHAPE), flat) == pytest.approx(double_sum(control), rel=1e-12)


def test_springs_do_not_feel_a_shift_and_nothing_else():
    values, vectors = np.linalg.eigh(Springs().matrix(SHAPE))
    assert abs(values[0]) < 1e-12 < 1e-3 < values[1]
    assert np.ptp(vectors[:, 0]) < 1e-12


def test_svd_in_full_is_the_minimum_norm_least_squares():
    b, rest, wanted = system()
    step, kept = svd_step(b, None)
    np.testing.assert_allclose(step(wanted, rest, rest), np.linalg.lstsq(b, wanted, rcond=None)[0], atol=1e-7)
    assert kept == np.linalg.matrix_rank(b) < b.shape[1]


def test_all_singular_values_above_rounding_are_used():
    """Near an ellipsoid the smallest is far below 1e-10 of the largest, and still no rounding."""
    b, _, _ = system(exponents=(1 + 1e-7, 1), shape=(5, 5, 5))
    w = np.linalg.svd(b, compute_uv=False)
    small = (w > 400 * np.finfo(float).eps * w[0]) & (w < 1e-10 * w[0])
    assert small.any()
    assert truncated_svd(b, None)[1] == truncated_svd(b, 125)[1] == (w > 400 * np.finfo(float).eps * w[0]).sum() < 125


def test_singular_values_are_counted_in_whole_numbers():
    with pytest.raises(OptionError, match=r"strength=2.5 .*whole number of singular values"):
        truncated_svd(system()[0], 2.5)


@pytest.mark.parametrize(("strength", "kept"), [(1, 1), (7, 7), (20, 20), (7.0, 7)])
def test_svd_keeps_a_count(strength, kept):
    b, _, wanted = system()
    u, w, vt = np.linalg.svd(b, full_matrices=False)
    step, used = svd_step(b, strength)
    assert used == kept
    expected = sum(np.outer(vt[k], u[:, k] @ wanted) / w[k] for k in range(kept))
    np.testing.assert_allclose(step(wanted, None, None), expected, atol=1e-12)


@pytest.mark.parametrize("threshold", [0.5, 1e-1, 1e-2, 1e-3])
def test_svd_keeps_those_above_a_threshold(threshold):
    b, _, _ = system()
    w = np.linalg.svd(b, compute_uv=False)
    assert truncated_svd(b, threshold)[1] == (w > threshold * w[0]).sum()


@pytest.mark.parametrize("strength", [-1, np.nan, 37, "many"])
def test_svd_strength_out_of_range_is_refused(strength):
    b, _, _ = system()
    with pytest.raises(OptionError, match="strength"):
        step_for(b, SHAPE, "svd", strength)


def test_the_variant_on_position_moves_without_displacement_and_the_paper_reading_does_not():
    b, rest, wanted = system()
    still = np.zeros_like(wanted)
    np.testing.assert_array_equal(svd_step(b, 12)[0](still, rest, rest), 0 * rest)
    moved = rest + svd_position_step(b, 12)[0](wanted, rest, rest)
    np.testing.assert_allclose(moved, truncated_svd(b, 12)[0] @ (b @ rest + wanted), atol=1e-12)
    assert np.abs(svd_position_step(b, 12)[0](still, rest, rest)).max() > 0.1


@pytest.mark.parametrize("strength", [1e-6, 1e-2])
@pytest.mark.parametrize("on_displacement", [True, False])
def test_springs_minimise_p9(strength, on_displacement, rng):
    """The step solves the stacked rows of P9, computed apart: alpha N sum of squares on P, or on P - P0."""
    b, rest, wanted = system()
    control = rest + 0.1 * rng.normal(size=rest.shape)
    penalty = Springs().matrix(SHAPE)
    step, _ = penalised_step(b, penalty, strength, on_displacement)
    found = control + step(wanted, control, rest)
    weight = strength * len(b)
    anchor = rest if on_displacement else 0 * rest
    normal = b.T @ b + weight * penalty
    expected = np.linalg.solve(normal, b.T @ (b @ control + wanted) + weight * penalty @ anchor)
    np.testing.assert_allclose(found, expected, atol=1e-6)

    def p9(points):
        springs = points - anchor
        return ((b @ (points - control) - wanted) ** 2).sum() + weight * double_sum(springs.reshape(*SHAPE, 3))

    for _ in range(5):
        assert p9(found) < p9(found + 1e-3 * rng.normal(size=found.shape))


def test_springs_to_the_letter_shrink_the_box_and_those_on_the_displacement_do_not():
    b, rest, wanted = system()
    still = np.zeros_like(wanted)
    solve, _ = step_for(b, SHAPE, "springs", 1e-2)
    np.testing.assert_allclose(solve(still, rest, rest), 0, atol=1e-12)
    letter, _ = step_for(b, SHAPE, "springs-paper", 1e-2)
    shrunk = rest + letter(still, rest, rest)
    assert (np.ptp(shrunk, axis=0) < 0.999 * np.ptp(rest, axis=0)).all()


def test_strength_is_per_data_point():
    """Every point twice, the same box."""
    b, rest, wanted = system()
    once, _ = step_for(b, SHAPE, "springs", 1e-3)
    twice, _ = step_for(np.tile(b, (2, 1)), SHAPE, "springs", 1e-3)
    np.testing.assert_allclose(twice(np.tile(wanted, (2, 1)), rest, rest), once(wanted, rest, rest), atol=1e-10)


class Anchors:
    """A user's own: each control point held on its own."""

    def matrix(self, shape):
        return np.eye(int(np.prod(shape)))


class Wrong:
    def __init__(self, matrix):
        self.given = matrix

    def matrix(self, shape):
        return self.given


def test_a_regulariser_of_ones_own():
    b, rest, wanted = system()
    step, strength = step_for(b, SHAPE, Anchors(), 1e-3)
    expected = np.linalg.solve(b.T @ b + 1e-3 * len(b) * np.eye(36), b.T @ wanted)
    np.testing.assert_allclose(step(wanted, rest, rest), expected, atol=1e-9)
    assert strength == 1e-3


@pytest.mark.parametrize(
    "regulariser",
    [Wrong(np.eye(3)), Wrong(np.triu(np.ones((36, 36)))), Wrong(np.full((36, 36), np.nan)), object(), None],
)
def test_a_regulariser_that_is_none_is_refused(regulariser):
    b, _, _ = system()
    with pytest.raises(OptionError, match="regularity"):
        step_for(b, SHAPE, regulariser, 1e-3)


def test_no_springs_on_a_rank_deficient_matrix_is_refused():
    b, _, _ = system()
    with pytest.raises(OptionError, match=r"strength=0 .*larger"):
        step_for(b, SHAPE, "springs", 0)
