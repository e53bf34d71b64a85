"""Superquadrics of which one side was seen: the search is not misled, and where there is no data the body is small."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import cup, seen
from shapes_made import even_directions, made

from quadriform import fit_superquadric
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import candidates
from quadriform.fitting.superquadric.candidates import Candidates, Extent
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.multistart import restarted
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.restarts import RESTART, restarts
from quadriform.shapes.superquadric import Superquadric


@pytest.mark.parametrize("exponents", [(0.1, 0.4), (0.1, 1.0), (0.3, 0.1)])
@pytest.mark.parametrize("semi_axes", [(0.7, 1.2, 1.0), (1.2, 1.3, 0.6), (0.8, 1.0, 1.5)])
def test_the_axes_of_a_scan_are_those_of_the_body(exponents, semi_axes, rng):
    truth = Superquadric("ellipsoid", semi_axes, exponents)
    beside = rng.uniform([1.6, -2, -1.5], [2.2, 2, -1.4], (600, 3))  # a strip of a table
    found = fit_superquadric(np.concatenate([seen(truth, rng), beside])).superquadric
    assert np.abs(np.sort(found.semi_axes) / np.sort(semi_axes) - 1).max() < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_a_tube_without_ends_is_as_long_as_its_points(seed):
    """Nothing but the preference for the smaller body says where it ends."""
    rng = np.random.default_rng(seed)
    tube = Superquadric("ellipsoid", (1.0, 1.2, 2.0), (0.05, 1.0)).surface(
        np.column_stack([*rng.normal(size=(2, 3000)), rng.uniform(-0.1, 0.1, 3000)])
    )
    tube[:, 2] = rng.uniform(-2, 2, 3000)
    found = fit_superquadric(tube + 0.02 * rng.normal(size=tube.shape)).superquadric
    assert 1.9 < found.semi_axes[np.argmax(np.abs(found.rotation[2]))] < 2.3


def test_of_a_covered_body_the_preference_is_far_below_the_noise(rng, monkeypatch):
    truth = made(exponents=(0.6, 0.8))
    points = truth.surface(rng.normal(size=(2000, 3))) + 0.05 * rng.normal(size=(2000, 3))
    found = fit_superquadric(points)
    monkeypatch.setattr(candidates, "SIZE_PENALTY", 0.0)
    without = fit_superquadric(points).superquadric
    sigma = np.sqrt(np.diag(found.covariance)[:3])
    assert (np.abs(found.superquadric.semi_axes - without.semi_axes) < sigma / 5).all()


def test_the_loss_by_size_has_its_derivatives_and_a_lower_bound(rng):
    points, inliers = rng.normal(size=(200, 3)), rng.uniform(0, 1, (2, 200))
    bodies = [Superquadric("ellipsoid", axes) for axes in ((1.0, 2.0, 0.5), (3.0, 0.2, 1.0))]
    candidates, extent = Candidates.of(bodies), Extent.of("ellipsoid", points, inliers)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        more, less = (extent.cost(replace(candidates, log_axes=candidates.log_axes + s)) for s in (step, -step))
        np.testing.assert_allclose((more - less) / 2e-6, extent.derivatives(candidates)[:, axis], rtol=1e-6)
    shrunk = replace(candidates, log_axes=candidates.log_axes - 30)
    np.testing.assert_allclose(extent.cost(shrunk), 0, atol=1e-9)
    assert (extent.cost(candidates) > 0).all()
    assert (Extent.of("toroid", points, inliers).cost(candidates) == 0).all()


def test_restarts_are_boxes_around_most_inliers_in_every_order_of_the_axes(rng):
    truth = made(exponents=(0.2, 0.2))
    points = truth.surface(even_directions(4000) * truth.semi_axes)
    far = rng.uniform(-40, 40, (400, 3))
    found = restarts(np.concatenate([points, far]), np.r_[np.ones(4000), np.zeros(400)], truth.rotation)
    boxes = np.exp(found.log_axes)
    straight = boxes[:3]  # the other three are turned by 45 degrees
    np.testing.assert_allclose(np.sort(straight, axis=1), np.tile(np.sort(truth.semi_axes), (3, 1)), rtol=0.25)
    assert (np.sort(straight, axis=1) < np.sort(truth.semi_axes)).all()
    assert len(np.unique(straight.argsort(axis=1), axis=0)) == 3
    np.testing.assert_allclose(found.translations, np.tile(truth.translation, (6, 1)), atol=0.1)
    assert (found.exponents == RESTART.exponent).all()


@pytest.mark.parametrize(("noise", "wall"), [(1.0, 8.0), (1.5, 10.0)])
def test_restarts_keep_to_the_outer_side_of_a_wall(noise, wall):
    """Both sides together are likelier as one surface between them, with a noise of half the wall, which is wrong."""
    points = cup(1000, wall)[0] + noise * np.random.default_rng(1).normal(size=(1000, 3))
    outer = Candidates.of([Superquadric("ellipsoid", (30.0, 30.0, 60.0))])
    ones = np.ones(1000)
    problem = SearchProblem(points / 30, ones, "ellipsoid", {}, 0 * ones, ones, longest=10.0)
    start = replace(outer, log_axes=outer.log_axes - np.log(30))
    found = restarted(problem, Descent(problem, start, Mixture(np.array([0.6]), np.array([noise / 30]))))
    best = found.scores().argmax()
    assert 30 * found.mixture.sigma[best] < 1.2 * noise
    np.testing.assert_allclose(np.sort(30 * found.candidates.superquadric(best).semi_axes)[:2], 30, rtol=0.05)


def test_the_axes_of_scans_are_within_two_standard_deviations():
    """Noise along the ray moves points across the normal too, and so shortens bodies with edges."""
    ratios, bodies = [], [((1.2, 1.3, 0.6), (0.1, 1.0)), ((0.7, 1.2, 1.0), (0.3, 0.1)), ((1.2, 1.3, 0.6), (0.1, 0.1))]
    for seed, (semi_axes, exponents) in enumerate(4 * bodies):
        rng = np.random.default_rng(seed)
        found = fit_superquadric(seen(Superquadric("ellipsoid", semi_axes, exponents), rng, 1500))
        order, sigma = found.superquadric.semi_axes.argsort(), np.sqrt(np.diag(found.covariance)[:3])
        ratios.append((found.superquadric.semi_axes[order] - np.sort(semi_axes)) / sigma[order])
    assert (np.abs(ratios) < 2).mean() > 0.9
    assert np.std(ratios) > 0.4  # nor are they much too large


def test_the_standard_deviations_of_a_complete_body_fall_with_the_root_of_the_number_of_points(rng):
    truth = made(exponents=(0.6, 0.8))
    few, many = (
        fit_superquadric(truth.surface(rng.normal(size=(n, 3))) + 0.05 * rng.normal(size=(n, 3))) for n in (1500, 24000)
    )
    # sixteen times as many points halve the standard deviations twice
    ratio = np.sqrt(np.diag(few.covariance)[:3] / np.diag(many.covariance)[:3])
    assert (ratio > 2.5).all() and (ratio < 6.4).all()
