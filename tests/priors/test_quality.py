"""How well modes represent rows of features, compared with the definitions."""

import numpy as np
import pytest

from quadriform.priors.principal import Components
from quadriform.priors.quality import leave_one_out_error, modes_for, specificity

ROWS = np.random.default_rng(7).normal(size=(12, 20)) * np.linspace(3, 0.1, 20)


@pytest.mark.parametrize("rows", [ROWS, ROWS[:, :6], np.vstack([ROWS[:5], ROWS[:5]]), ROWS[:3]])
@pytest.mark.parametrize("modes", [1, 4, 11])
def test_each_shape_is_projected_on_the_modes_of_the_others(rows, modes):
    squares = []
    for number, row in enumerate(rows):
        others = np.delete(rows, number, axis=0)
        mean = others.mean(axis=0)
        count = min(modes, np.linalg.matrix_rank(others - mean))
        axes = np.linalg.svd(others - mean)[2][:count]
        squares.append((((row - mean) - axes.T @ (axes @ (row - mean))) ** 2).sum())
    found = leave_one_out_error(rows, Components.of(rows), modes)
    assert found == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-6, abs=1e-12)


def test_what_lies_outside_of_nearly_all_of_the_variance_counts():
    rows = np.random.default_rng(8).normal(size=(400, 5)) * [1, 1e-6, 1e-6, 1e-6, 1e-6]
    assert leave_one_out_error(rows, Components.of(rows), 1) == pytest.approx(2e-6, rel=0.05)


def test_specificity_is_the_distance_to_the_nearest_shape():
    found = Components.of(ROWS)
    scores = np.random.default_rng(0).normal(size=(1000, 5)) * np.sqrt(found.variances[:5])
    members = found.mean + scores @ found.directions[:5]
    nearest = np.linalg.norm(members[:, None] - ROWS, axis=2).min(axis=1)
    assert specificity(ROWS, found, 5) == pytest.approx(nearest.mean(), rel=1e-9)


def test_variances_are_counted_up_to_a_fraction():
    variances = np.array([6.0, 3.0, 1.0])
    assert [modes_for(variances, fraction) for fraction in (0.5, 0.6, 0.61, 0.9, 0.95, 1.0)] == [1, 1, 2, 2, 3, 3]
