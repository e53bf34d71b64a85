"""Strength and noise by the marginal likelihood: on data drawn from the prior both are known, and so is the answer."""

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem
from quadriform.fitting.least_squares.normal_equations import NormalEquations, normal_equations
from quadriform.fitting.least_squares.regularisers import Bending, Springs
from quadriform.shapes.control_box import ControlBox

SHAPE = (4, 4, 4)
SURFACE = made(exponents=(0.8, 1.1), semi_axes=(1.0, 0.7, 1.4))
BOX = ControlBox.around(SURFACE, SHAPE)


def observed(n):
    """Rows n_i' B_i, (n, 192), of even surface points, with local coordinates and normals."""
    points = SURFACE.surface(even_directions(n))
    normals = SURFACE.gradient(points)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = (BOX.matrix(points)[:, :, None] * normals[:, None, :]).reshape(n, -1)
    return rows, BOX.local(points), normals


def drawn(penalty, strength, noise, n=800, seed=0):
    """A displacement of prior precision alpha n K / sigma^2, an affine part that costs nothing, noise along normals.

    By the square root and the projector, which are unique: numbers drawn for single eigenvectors would give other data
    on another processor, because the eigenvectors of a multiple eigenvalue are any of their plane.
    """
    rng = np.random.default_rng(seed)
    rows, local, normals = observed(n)
    values, vectors = np.linalg.eigh(penalty)
    bends = values > 1e-10 * values[-1]
    root = (vectors[:, bends] * (noise / np.sqrt(strength * n * values[bends]))) @ vectors[:, bends].T
    p = root @ rng.normal(size=(len(penalty), 3))
    p += 0.1 * vectors[:, ~bends] @ vectors[:, ~bends].T @ rng.normal(size=(len(penalty), 3))
    heights = rows @ p.ravel() + noise * rng.normal(size=n)
    metric = normals[:, :, None] * normals[:, None, :]
    equations = normal_equations(local, metric, heights[:, None] * normals, BOX.degrees)
    return LinearProblem(equations, penalty, n), rows, heights


BENDING, SPRINGS = Bending().matrix(SHAPE), Springs().matrix(SHAPE)


@pytest.mark.parametrize("penalty", [BENDING, SPRINGS], ids=["bending", "springs"])
@pytest.mark.parametrize(("strength", "noise"), [(1e-6, 0.01), (1e-4, 0.05), (1e-3, 1e-4)])
def test_noise_and_strength_of_the_prior_are_found(penalty, strength, noise):
    """The true strength is as likely as the one found, but for chi square of one degree of freedom (1 in 10,000)."""
    for seed in range(4):
        linear = drawn(penalty, strength, noise, seed=seed)[0]
        one = linear.best()
        assert one.sigma == pytest.approx(noise, rel=0.1)
        assert 0 <= linear.solve(strength).criterion - one.criterion + 1e-6 < 15.1
        if strength < 1e-3:  # data that hardly bend: an infinite strength may explain them as well
            assert abs(np.log(one.strength / strength)) < 3 * np.log(3)


def test_what_costs_nothing_is_counted():
    """Four affine displacements a coordinate for bending, one for springs."""
    assert (drawn(BENDING, 1e-4, 0.1)[0].null_dimension, drawn(SPRINGS, 1e-4, 0.1)[0].null_dimension) == (12, 3)


def test_the_curvature_of_the_criterion_is_known_at_the_best_strength():
    """By finite differences of its values."""
    linear = drawn(BENDING, 1e-5, 0.02)[0]
    best, step = linear.best(), 0.3
    low, middle, high = (linear.solve(best.strength * np.exp(x)).criterion for x in (-step, 0.0, step))
    assert best.criterion_curvature == pytest.approx((high - 2 * middle + low) / step**2, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_largest_evidence_is_found(seed):
    linear = drawn(BENDING, 1e-5, 0.02, seed=seed)[0]
    best = linear.best()
    dense = [linear.solve(strength) for strength in best.strength * np.geomspace(1e-6, 1e6, 241)]
    assert best.criterion <= min(one.criterion for one in dense) + 1e-2
    for near in (best.strength / 20, best.strength * 20):
        assert linear.best(near).criterion == pytest.approx(best.criterion, abs=1e-2)


def test_data_that_differs_by_rounding_has_the_same_strength():
    linear = drawn(BENDING, 1e-4, 0.05, seed=3)[0]
    found = linear.best().strength
    for sign in (-1, 1):
        near = drawn(BENDING, 1e-4, 0.05 * (1 + sign * 1e-10), seed=3)[0].best()
        assert near.strength == pytest.approx(found, rel=1e-7)
        assert linear.best(found * (1 + sign * 1e-4)).strength == pytest.approx(found, rel=1e-7)


def with_prior(linear, rows, heights):
    """The problem with a penalty that contradicts the data."""
    return linear.with_extra_terms(NormalEquations.of_rows(rows[::8], heights[::8] + 0.1, 3.0))


@pytest.mark.parametrize("prior", [False, True], ids=["data", "with a penalty"])
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_the_strength_is_found_to_a_thousandth(seed, prior):
    """A search that stopped sooner jumped by as much as it was allowed, on data that differed by rounding."""
    linear, rows, heights = drawn(BENDING, 1e-4, 0.05, seed=seed)
    linear = with_prior(linear, rows, heights) if prior else linear
    best = linear.best()
    for factor in (0.999, 1.001):
        assert linear.solve(factor * best.strength).criterion > best.criterion


def test_the_criterion_is_the_density_of_the_data():
    """Against the marginal density of the rows themselves, flat in what costs nothing (REML), at several strengths.

    Differences only: a constant is free. The noise is profiled: s2 = quadratic form / (n - d0).
    """
    linear, rows, heights = drawn(BENDING, 1e-5, 0.02, n=400)
    k3 = np.kron(BENDING, np.eye(3))
    values, vectors = np.linalg.eigh(k3)
    bends = values > 1e-10 * values[-1]
    fixed = rows @ vectors[:, ~bends]
    random = rows @ vectors[:, bends]
    n, free = fixed.shape

    def direct(strength):
        covariance = np.eye(n) + (random / (strength * n * values[bends])) @ random.T
        inverse = np.linalg.inv(covariance)
        inner = fixed.T @ inverse @ fixed
        left = heights - fixed @ np.linalg.solve(inner, fixed.T @ inverse @ heights)
        quadratic = left @ inverse @ left
        return (
            (n - free) * np.log(quadratic / (n - free)) + np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1]
        )

    strengths = [1e-7, 1e-5, 1e-3, 1e-1]
    ours = np.array([linear.solve(strength).criterion for strength in strengths])
    theirs = np.array([direct(strength) for strength in strengths])
    np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], atol=1e-4)


def test_a_penalty_is_evidence_but_no_noise():
    """Its rows count like those of data in the choice of the strength, and not in the residuals."""
    linear, rows, heights = drawn(BENDING, 1e-4, 0.05)
    both = with_prior(linear, rows, heights)
    as_data = LinearProblem(both.equations, BENDING, len(rows))
    assert both.best().strength == pytest.approx(as_data.best().strength, rel=1e-6)
    found = both.solve(1e-4)
    squares = ((rows @ found.displacement.ravel() - heights) ** 2).sum()
    bending = 1e-4 * len(rows) * np.einsum("ki,kl,li->", found.displacement, BENDING, found.displacement)
    assert found.sigma**2 == pytest.approx((squares + bending) / (len(rows) - 12), rel=1e-6)


def test_data_left_out_leaves_the_noise_of_the_rest():
    """Beside a penalty too."""
    whole, rows, heights = drawn(BENDING, 1e-4, 0.05)
    out, rest = (NormalEquations.of_rows(rows[part], heights[part], 1.0) for part in (slice(300), slice(300, None)))
    penalty = NormalEquations.of_rows(rows[::8], heights[::8] + 0.1, 3.0)
    found = whole.with_extra_terms(penalty).without_points(out, 300).solve(1e-4)
    assert found.sigma == pytest.approx(
        LinearProblem(rest, BENDING, 500).with_extra_terms(penalty).solve(1e-4).sigma, rel=1e-9
    )


@pytest.mark.parametrize("strength", [1e-6, 1e-3, 1.0])
def test_the_displacement_solves_the_stacked_rows(strength):
    linear, rows, heights = drawn(BENDING, 1e-4, 0.05)
    values, vectors = np.linalg.eigh(np.kron(BENDING, np.eye(3)))
    root = np.sqrt(np.maximum(values, 0) * strength * len(rows))[:, None] * vectors.T
    stacked, right = np.vstack([rows, root]), np.concatenate([heights, np.zeros(len(root))])
    expected = np.linalg.lstsq(stacked, right, rcond=None)[0]
    found = linear.solve(strength)
    np.testing.assert_allclose(found.displacement.ravel(), expected, atol=1e-7 * np.abs(expected).max())
    left = right - stacked @ expected
    assert found.sigma**2 == pytest.approx(left @ left / (len(rows) - 12), rel=1e-6)


def test_covariance_is_the_noise_on_the_inverse(rng):
    linear, rows, _ = drawn(BENDING, 1e-3, 0.05)
    found = linear.solve(1e-3)
    precision = rows.T @ rows + 1e-3 * len(rows) * np.kron(BENDING, np.eye(3))
    unit = found.covariance() @ precision / found.sigma**2
    np.testing.assert_allclose(unit, np.eye(len(unit)), atol=1e-6)
    some = rng.normal(size=(7, rows.shape[1]))
    np.testing.assert_allclose(
        found.variance(some), np.einsum("ni,ij,nj->n", some, found.covariance(), some), rtol=1e-8
    )


def test_variance_shrinks_with_the_number_of_points():
    """Four times the same rows, the strength per point as before: a quarter of the variance for the same noise."""
    linear, rows, _ = drawn(BENDING, 1e-4, 0.05)
    once = linear.solve(1e-4)
    fourfold = normal_equations(*repeated(4), BOX.degrees)
    four = LinearProblem(fourfold, BENDING, 4 * len(rows)).solve(1e-4)
    some = rows[::50]
    np.testing.assert_allclose(four.variance(some) / four.sigma**2, once.variance(some) / once.sigma**2 / 4, rtol=1e-9)


def repeated(times, n=800):
    _, local, normals = observed(n)
    metric = normals[:, :, None] * normals[:, None, :]
    return np.tile(local, (times, 1)), np.tile(metric, (times, 1, 1)), np.tile(0.1 * normals, (times, 1))


def test_where_control_points_are_undetermined_there_is_no_solution():
    """27 of the 125 polynomials vanish on an ellipsoid: without any strength the box is not determined."""
    ellipsoid = made(exponents=(1, 1))
    box = ControlBox.around(ellipsoid, (5, 5, 5))
    points = ellipsoid.surface(even_directions(600))
    metric = np.tile(np.eye(3), (600, 1, 1))
    equations = normal_equations(box.local(points), metric, 0.1 * points, box.degrees)
    linear = LinearProblem(equations, Bending().matrix((5, 5, 5)), 600)
    assert linear.solve(0.0) is None
    assert linear.best().sigma > 0


def test_a_search_that_steps_to_where_nothing_is_determined_goes_on_elsewhere(monkeypatch):
    linear = drawn(BENDING, 1e-4, 0.05, seed=3)[0]
    wall = 3 * linear.best().strength
    solve = LinearProblem.solve
    monkeypatch.setattr(LinearProblem, "solve", lambda self, s: None if s < wall else solve(self, s))
    assert wall <= linear.best(1.5 * wall).strength < 1.5 * wall
    monkeypatch.setattr(LinearProblem, "solve", lambda self, s: None if s < 1e9 * wall else solve(self, s))
    assert linear.best(wall).strength >= 1e9 * wall
    monkeypatch.setattr(LinearProblem, "solve", lambda self, s: None)
    with pytest.raises(DegenerateError, match="three dimensions"):
        linear.best()


@pytest.mark.parametrize("strength", [1e3, 1e9, 1e15])
def test_without_bending_the_best_affine_map_is_left_to_the_last_digits(strength):
    """Old bug: strengths above 1e3 drowned the data in the rounding of the penalty, and the factorisation failed."""
    linear, rows, heights = drawn(BENDING, 1e-4, 0.05)
    values, vectors = np.linalg.eigh(np.kron(BENDING, np.eye(3)))
    affine = vectors[:, values < 1e-10 * values[-1]]
    expected = affine @ np.linalg.lstsq(rows @ affine, heights, rcond=None)[0]
    found = linear.solve(strength)
    np.testing.assert_allclose(found.displacement.ravel(), expected, atol=max(1e-9, 1 / strength))
    assert found.condition < 1e4


@pytest.mark.parametrize("seed", range(4))
def test_data_without_bending_has_a_definite_strength(seed):
    """The criterion falls for ever then: old bug, a search down to its rounding, other on each processor."""
    rng = np.random.default_rng(seed)
    _, local, normals = observed(800)
    heights = normals @ rng.normal(size=3) + 0.01 * rng.normal(size=800)
    metric = normals[:, :, None] * normals[:, None, :]

    def found(values, near=None):
        equations = normal_equations(local, metric, values[:, None] * normals, BOX.degrees)
        return LinearProblem(equations, BENDING, 800).best(near).strength

    same = heights * (1 + 1e-14 * rng.normal(size=800))
    for other in (found(same), found(heights, 1.0), found(same, 100.0)):
        assert other == pytest.approx(found(heights), rel=1e-4)


def test_a_penalty_with_a_negative_eigenvalue_is_refused():
    linear = drawn(BENDING, 1e-4, 0.05)[0]
    with pytest.raises(OptionError, match="positive semi-definite"):
        LinearProblem(linear.equations, BENDING - np.eye(64), 800)
