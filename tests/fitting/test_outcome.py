"""What is said of the end of a search: by its inliers alone, at the limits of each warning."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.errors import OptionError
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import fit as fits
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.covariance import likelihood_covariance
from quadriform.fitting.superquadric.identifiability import identifiability_of
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.multistart import SearchResult
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.points import Frame

SIGMA = 0.02


def ended(kind, points, sigma=SIGMA, converged=True, others=0, fixed=None):
    """The end of a search at the surface itself."""
    n = len(points)
    problem = SearchProblem(points, np.ones(n), kind, fixed or {}, np.zeros(n), np.ones(n))
    body = Candidates.of([replace(made(kind, (1.1, 0.9)), translation=np.zeros(3))])
    descent = Descent(problem, body, Mixture(np.array([0.9]), np.array([sigma])))
    descent.history = [0.3, 0.2, sigma]
    return SearchResult(descent, converged, others)


def points_of(kind, seed=1):
    body = replace(made(kind, (1.1, 0.9)), translation=np.zeros(3))
    points = body.grid(8)[0]
    return body, points + SIGMA * np.random.default_rng(seed).normal(size=points.shape)


def test_an_open_surface_is_cut_where_its_inliers_end():
    body, points = points_of("hyperboloid1")
    far = body.rotation[:, 2] * 20
    every = np.vstack([points, far])
    inliers = np.append(np.ones(len(points)), 0.2)
    inliers[:5] = 0.5
    found = fits._outcome(ended("hyperboloid1", points), every, inliers, 0.0)
    heights = np.abs(every @ body.rotation[:, 2])
    assert found.superquadric.height == pytest.approx(heights[inliers >= 0.5].max())
    assert found.iterations == 3 and found.history == (0.3, 0.2, SIGMA) and found.noise == SIGMA
    np.testing.assert_array_equal(found.inliers, inliers)


def test_directions_of_outliers_are_not_covered():
    _, points = points_of("ellipsoid")
    half = points[:, 2] > 0
    every = fits._outcome(ended("ellipsoid", points), points, np.ones(len(points)), 0.0)
    assert "PARTIAL_COVERAGE" not in every.warnings
    found = fits._outcome(ended("ellipsoid", points), points, np.where(half, 0.9, 0.4), 0.0)
    assert "PARTIAL_COVERAGE" in found.warnings and "MANY_OUTLIERS" in found.warnings


def test_warnings_are_those_of_the_search():
    _, points = points_of("ellipsoid")
    ones = np.ones(len(points))
    assert fits._outcome(ended("ellipsoid", points), points, ones, 0.0).warnings == {}
    more = fits._outcome(ended("ellipsoid", points, converged=False, others=2), points, ones, 0.0)
    assert (
        set(more.warnings) == {"MULTIPLE_MINIMA", "MAX_ITERATIONS"} and "in 3 steps" in more.warnings["MAX_ITERATIONS"]
    )
    for sigma, known, poor in ((0.099, 0.0, False), (0.101, 0.0, True), (0.2, 0.2, False)):
        found = fits._outcome(ended("ellipsoid", points, sigma), points, ones, known)
        assert ("POOR_FIT" in found.warnings) == poor


def test_the_covariance_of_exact_points_is_that_of_least_squares():
    """Of noisy ones that of the flatter likelihood."""
    _, points = points_of("ellipsoid")
    ones = np.ones(len(points))
    noisy = ended("ellipsoid", points)
    np.testing.assert_allclose(fits._outcome(noisy, points, ones, 0.0).covariance, likelihood_covariance(noisy.descent))
    body, _ = points_of("ellipsoid")
    exact = ended("ellipsoid", body.grid(8)[0], 0.9e-6).descent
    weights = exact.weights * exact.inliers[0]
    expected = identifiability_of(exact.candidates, exact.derivatives[0], weights, 0.9e-6, exact.fixed_mask).covariance
    found = fits._outcome(SearchResult(exact, True, 0), body.grid(8)[0], ones, 0.0)
    np.testing.assert_array_equal(found.covariance, expected)


def test_fixed_values_are_checked_and_brought_into_the_frame():
    frame = Frame(np.array([1.0, 2, 3]), 10.0)
    found = fits._fixed_to_local({"semi_axes": (10, 20, 30), "translation": (1, 2, 13), "exponents": (0.5, 2.0)}, frame)
    np.testing.assert_allclose(found["semi_axes"], [1, 2, 3])
    np.testing.assert_allclose(found["translation"], [0, 0, 1])
    np.testing.assert_allclose(found["exponents"], [0.5, 2])
    with pytest.raises(OptionError, match="keep them within"):
        fits._fixed_to_local({"exponents": (0.5, 2.1)}, frame)
    with pytest.raises(OptionError, match="option fixed: semi_axes"):
        fits._fixed_to_local({"semi_axes": (0, 1, 1)}, frame)
    with pytest.raises(OptionError):
        fits._fixed_to_local({"height": 1}, frame)


def test_plain_ellipsoids_have_exponents_of_one():
    points = made(exponents=(0.4, 0.6), semi_axes=(1.2, 0.9, 0.8)).surface(even_directions(200))
    found = fits.plain_ellipsoid(points - points.mean(axis=0), made())
    np.testing.assert_array_equal(found.exponents, 1)
    assert np.abs(found.first_order_distance(points - points.mean(axis=0))).max() < 0.2
