"""Splines over time: what they are one and zero at, what they sum to, and their integrals."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from quadriform.errors import OptionError
from quadriform.shapes.splines import TimeBasis

KNOTS = np.array([0.0, 1, 2.5, 3, 4.2])
BASES = [TimeBasis(KNOTS), TimeBasis(KNOTS, 6.0)]


@pytest.mark.parametrize("basis", BASES, ids=["natural", "periodic"])
def test_each_is_one_at_its_own_knot_and_they_sum_to_one(basis):
    np.testing.assert_allclose(basis.values(KNOTS), np.eye(5), atol=1e-12)
    np.testing.assert_allclose(basis.values(np.linspace(0, 4.2, 50)).sum(axis=1), 1, atol=1e-12)


def test_a_period_later_all_is_the_same():
    times = np.linspace(-3, 9, 40)
    np.testing.assert_allclose(BASES[1].values(times), BASES[1].values(times + 6.0), atol=1e-12)


@pytest.mark.parametrize(
    ("basis", "order"), [(BASES[0], 0), (BASES[0], 2), (BASES[1], 0)], ids=["natural", "natural bending", "periodic"]
)
def test_the_mean_products_are_the_integrals(basis, order):
    matrix = (basis.mass(), None, basis.bending())[order]
    one, other, breaks = 1, 3, basis._spline.x

    def product(time):
        values = basis._spline(time, nu=order)
        return values[one] * values[other]

    parts = [quad(product, low, high)[0] for low, high in pairwise(breaks)]
    scale = basis.span**4 if order else 1.0
    assert matrix[one, other] == pytest.approx(scale * sum(parts) / basis.span, rel=1e-9)


def test_straight_motion_does_not_bend():
    basis = BASES[0]
    assert abs(KNOTS @ basis.bending() @ KNOTS) < 1e-9
    assert np.ones(5) @ basis.mass() @ np.ones(5) == pytest.approx(1)


def test_the_first_harmonic_is_not_penalised_and_other_motion_is():
    basis, rng = BASES[1], np.random.default_rng(0)
    phase = 2 * np.pi * (basis.knots - basis.knots[0]) / basis.period
    harmonic = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)
    assert np.abs(basis.bending() @ harmonic).max() < 1e-9 * np.abs(basis.bending()).max()
    left = rng.normal(size=len(phase))
    left -= harmonic @ np.linalg.lstsq(harmonic, left, rcond=None)[0]
    breaks = basis._spline.x
    parts = [quad(lambda t: (basis._spline(t, nu=2) @ left) ** 2, low, high)[0] for low, high in pairwise(breaks)]
    cost = left @ basis.bending() @ left
    assert cost == pytest.approx(basis.span**4 * sum(parts) / basis.span, rel=1e-9)
    moved = left + harmonic @ [2.0, -1.0, 0.5]
    assert moved @ basis.bending() @ moved == pytest.approx(cost, rel=1e-9)


def test_a_time_that_is_not_covered_is_refused():
    with pytest.raises(OptionError, match="no period"):
        BASES[0].values(np.array([4.3]))


@pytest.mark.parametrize("knots", [[0.0], [0, 1, 1], [0, np.nan], [2, 1]])
def test_knots_must_increase(knots):
    with pytest.raises(OptionError, match="increasing"):
        TimeBasis(np.array(knots, dtype=float))


def test_a_period_must_be_longer_than_the_knots():
    with pytest.raises(OptionError, match="period=4"):
        TimeBasis(KNOTS, 4.0)
