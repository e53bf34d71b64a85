"""Very large clouds: the same surface as from all points at once, whatever their order and the number of threads."""

from dataclasses import replace

import numpy as np
import pytest
from notes import note_of
from shapes_made import lumpy

import quadriform as qf
from quadriform.fitting.refinement import large_clouds

NOISE = 0.5
TRUTH = lumpy(30_000)


def cloud(count, seed=0):
    rng = np.random.default_rng(seed)
    points = TRUTH[rng.integers(0, len(TRUTH), count)]
    return points + NOISE * rng.normal(size=points.shape)


@pytest.fixture(scope="module")
def start():
    """Near enough to all clouds, where the first stage is not what a test is about."""
    return qf.fit_superquadric(cloud(600)).superquadric


@pytest.fixture
def small(monkeypatch):
    """What is called very large_clouds, made small enough for a test."""
    small = replace(large_clouds.LARGE, many=1000, sample=600, part=500)
    monkeypatch.setattr(large_clouds, "LARGE", small)


def error(fit):
    return float(np.sqrt((fit.model.distance(TRUTH[::7]) ** 2).mean()))


def test_the_sample_does_not_see_the_order_and_keeps_its_size(rng):
    points = rng.normal(size=(300_000, 3))
    ones = np.ones(len(points))
    order = rng.permutation(len(points))
    first, second = large_clouds.sampled(points, ones), large_clouds.sampled(points[order], ones)
    assert {tuple(p) for p in points[first]} == {tuple(p) for p in points[order][second]}
    assert len(first) == pytest.approx(large_clouds.LARGE.sample, rel=0.05)
    halves = [np.mean(points[first][:, axis] > 0) for axis in range(3)]
    np.testing.assert_allclose(halves, 0.5, atol=0.02)


def test_a_lattice_and_a_scan_line_are_sampled_evenly():
    x, y = np.meshgrid(np.arange(600.0), np.arange(400.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    chosen = points[large_clouds.sampled(points, np.ones(len(points)))]
    for axis, size in ((0, 600), (1, 400)):
        counts = np.histogram(chosen[:, axis], bins=20, range=(0, size))[0]
        assert counts.std() < 3 * np.sqrt(counts.mean())


def test_points_without_weight_are_not_sampled(rng):
    points, weights = rng.normal(size=(200_000, 3)), np.zeros(200_000)
    weights[::4] = 1
    chosen = large_clouds.sampled(points, weights)
    assert (weights[chosen] == 1).all()
    assert len(chosen) == pytest.approx(large_clouds.LARGE.sample, rel=0.05)


def test_all_points_determine_more_than_a_sample_and_no_less_than_at_once(small, start, monkeypatch):
    points = cloud(4000)
    few = points[large_clouds.sampled(points, np.ones(len(points)))]
    alone, every = (qf.refine(start, some, box=(4, 4, 4)) for some in (few, points))
    monkeypatch.setattr(large_clouds, "LARGE", replace(large_clouds.LARGE, many=10**9))
    at_once = qf.refine(start, points, box=(4, 4, 4))
    assert error(every) < 0.8 * error(alone)
    assert error(every) < 1.15 * error(at_once)
    spread = [fit.uncertainty(TRUTH[::500]) for fit in (every, at_once)]
    assert 0.7 < np.median(spread[0] / spread[1]) < 1.4
    assert 0.5 < np.trace(every.covariance) / np.trace(at_once.covariance) < 2
    assert every.noise == pytest.approx(NOISE, rel=0.1)
    assert every.model.min_jacobian() > 0
    assert every.residuals.shape == every.inliers.shape == every.superquadric_residuals.shape == (4000,)
    np.testing.assert_allclose(every.residuals, every.model.distance(points), atol=1e-9)
    assert every.status == "ok"


def test_the_number_of_threads_changes_nothing(small, start, monkeypatch):
    points = cloud(1500, seed=2)
    found = []
    for threads in ("1", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        monkeypatch.setattr(large_clouds, "threads_for", lambda count, n=int(threads): n)
        found.append(qf.refine(start, points, box=(3, 3, 3)).model.box.control_points)
    np.testing.assert_array_equal(*found)


def test_outliers_are_reported_at_their_indices(small, rng):
    points = np.concatenate([cloud(2000, seed=3), rng.uniform(-2, 2, (100, 3)) * np.abs(TRUTH).max()])
    fit = qf.fit(points, box=(4, 4, 4))
    far = np.abs(fit.model.distance(points)) > 6 * NOISE
    assert (fit.inliers[far] < 0.5).all() and far[-100:].sum() > 67
    assert (fit.inliers[~far] > 0.5).mean() > 0.98
    assert str(int((fit.inliers < 0.5).sum())) in note_of(fit, "OUTLIERS")


def test_copies_among_all_points_are_counted(small, start):
    """Old bug: those of the sample were called all."""
    points = cloud(1500, seed=8)
    points[1000:] = points[:500]
    assert note_of(qf.refine(start, points, box=(3, 3, 3)), "DUPLICATES").startswith("500 of 1500 points")


def test_what_is_expected_beyond_a_base_is_weighed_against_the_inliers(small, start, monkeypatch):
    """Old bug: against all points, so that outliers made a base heavier in the last rounds than before."""
    asked, prior = [], large_clouds.base_prior

    def watched(data, box, count):
        asked.append((count, data.total_weight / data.weights.sum()))
        return prior(data, box, count)

    monkeypatch.setattr(large_clouds, "base_prior", watched)
    points = cloud(1500, seed=9)
    points[:150] *= 1.25  # outliers, but near enough to be joined to the body
    below = points[points[:, 2] < np.quantile(points[:, 2], 0.9)]
    qf.refine(start, below, box=(3, 3, 3), base=([0, 0, below[:, 2].max()], [0, 0, 1.0]))
    assert asked
    for count, share in asked:
        assert share < 0.95 and count == pytest.approx(share * len(below))


def test_two_clouds_of_which_one_is_very_large(small):
    points = {"outer": cloud(1500, seed=4), "inner": 0.5 * cloud(400, seed=5)}
    fit = qf.fit(points, box=(3, 3, 3))
    assert {name: len(values) for name, values in fit.residuals.items()} == {"outer": 1500, "inner": 400}
    assert fit.rms < 1.2 * NOISE
    assert fit.model.min_jacobian() > 0


def test_weights_count_as_before(small, start):
    points, weights = cloud(2500, seed=6), np.ones(2500)
    weights[::2] = 0
    fit = qf.refine(start, points, weights=weights, box=(3, 3, 3))
    assert (fit.inliers[::2] == 0).all() and (fit.inliers[1::2] > 0.01).all()
    twice = qf.refine(start, points, weights=2 * weights, box=(3, 3, 3))
    np.testing.assert_allclose(twice.model.box.control_points, fit.model.box.control_points, atol=1e-6)


def test_refine_takes_the_same_way(small, start):
    points = cloud(1500, seed=7)
    fit = qf.refine(start, points, strength=1e-6)
    assert fit.strength == 1e-6
    assert fit.noise == pytest.approx(NOISE, rel=0.1)


def test_weights_of_one_surface_against_another_are_kept(small, start, monkeypatch):
    points = {"outer": cloud(1100, seed=4), "inner": 0.5 * cloud(200, seed=5)}
    weights, seen, made = {"outer": np.ones(1100), "inner": np.full(200, 50.0)}, {}, large_clouds._Surface

    def watched(name, cloud, weights, *rest):
        seen[name] = weights
        return made(name, cloud, weights, *rest)

    monkeypatch.setattr(large_clouds, "_Surface", watched)
    starts = {"outer": start, "inner": start.transformed(0.5, np.zeros(3))}
    qf.refine(starts, points, weights=weights, box=(3, 3, 3), strength=1e-4)
    assert seen["inner"].mean() / seen["outer"].mean() == pytest.approx(50)
