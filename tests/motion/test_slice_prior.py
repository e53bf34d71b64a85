"""The prior of the motions of slices: its means, and its spread by the marginal likelihood."""

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from quadriform.motion.slice_motions import SlicePlanes
from quadriform.motion.slice_prior import KINDS, SPREAD, SlicePrior

SPREADS = np.array([0.06, 0.07, 0.04, 0.05])


def gauge(count=9, seed=0):
    """Gauge fields of slices in random planes."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return SlicePlanes(np.arange(count), axes, rng.normal(size=(count, 3))).gauge_fields()


def drawn(fields, spread, deviation, seed=1):
    """Precision of measurements of motions with a prior spread, and their right side."""
    rng = np.random.default_rng(seed)
    truth = np.tile(spread[KINDS], len(fields) // 6) * rng.normal(size=len(fields))
    measured = truth + deviation * rng.normal(size=len(truth))
    data = np.eye(len(truth)) / deviation**2
    # what the model can follow is not measured
    fixed = np.linalg.qr(fields)[0]
    data -= fixed @ fixed.T / deviation**2
    return data, data @ measured


def test_without_data_a_motion_has_the_spread_of_its_kind():
    prior = SlicePrior(SPREADS, gauge(), False)
    covariance = np.linalg.inv(prior.precision())
    deviations = np.tile(SPREADS[KINDS], 9)
    scaled = covariance / np.outer(deviations, deviations)
    values = np.linalg.eigvalsh(scaled)
    np.testing.assert_allclose(values[6:], 1, rtol=1e-9)
    assert values[:6].max() < 1.1e-6
    np.testing.assert_allclose(np.diag(covariance), prior.variances(), rtol=1e-4)


def test_means_are_those_of_the_posterior_without_a_penalty():
    """Data that says nothing of the gauge fields leaves them where the prior has its maximum."""
    fields = gauge()
    data, right = drawn(fields, SPREADS, 0.01)
    prior = SlicePrior(SPREADS, fields, False)
    plain = np.diag(np.tile(SPREADS[KINDS], 9) ** -2.0)
    expected = np.linalg.solve(data + plain, right)
    np.testing.assert_allclose(cho_solve(cho_factor(data + prior.precision()), right), expected, atol=1e-6)


def test_the_spread_is_that_of_the_motions():
    fields = gauge()
    found = [SlicePrior.first(fields, False).of_data(*drawn(fields, SPREADS, 0.005, seed)).spread for seed in range(8)]
    np.testing.assert_allclose(np.mean(found, axis=0), SPREADS, rtol=0.25)


def test_the_spread_has_the_largest_penalised_marginal_likelihood():
    fields = gauge(30)
    data, right = drawn(fields, SPREADS, 0.02)
    found = SlicePrior.first(fields, False).of_data(data, right)

    def logarithm(spread):
        """The log marginal likelihood plus the sum of log spreads, up to a constant, on the complement of the gauge."""
        prior = SlicePrior(spread, fields, False)
        precision = prior.precision()
        q = np.linalg.solve(data + precision, right)
        determinants = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(data + precision)[1]
        return 0.5 * (determinants + right @ q) + np.log(spread).sum()

    best = logarithm(found.spread)
    for kind in range(4):
        for factor in (0.85, 1.15):
            assert logarithm(found.spread * np.where(np.arange(4) == kind, factor, 1)) < best


def test_slices_that_did_not_move_have_a_spread_far_below_the_error_of_their_measurement():
    fields = gauge()
    found = SlicePrior.first(fields, False).of_data(*drawn(fields, 0 * SPREADS, 0.03))
    assert found.spread[[0, 2]].max() < 0.5 * 0.03


@pytest.mark.parametrize("is_planar", [False, True])
def test_without_data_the_spread_stays(is_planar):
    first = SlicePrior.first(gauge(), is_planar)
    nothing = np.zeros((54, 54)), np.zeros(54)
    np.testing.assert_array_equal(first.of_data(*nothing).spread, first.spread)
    assert first.spread[0] == SPREAD.first and first.spread[3] == (SPREAD.least if is_planar else SPREAD.first)


def test_slices_of_a_stack_stay_in_their_planes():
    fields = gauge()
    found = SlicePrior.first(fields, True).of_data(*drawn(fields, SPREADS, 0.01))
    assert found.spread[0] > 0.03 and (found.spread[1:] == SPREAD.least).all()
