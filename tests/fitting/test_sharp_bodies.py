"""Closed bodies with sharp edges: no face is taken for outliers, and removing folds keeps the surface at its points."""

import numpy as np
import pytest
from notes import note_of
from shapes_made import even_directions, turned

import quadriform as qf
from quadriform.fitting.refinement import refine
from quadriform.fitting.refinement.unfolding import without_folds


def cone(count, radius, height, noise=0.0, seed=0):
    """Points spread evenly over the area of a closed cone, turned; noise as a share of the radius."""
    rng = np.random.default_rng(seed)
    slant = np.hypot(radius, height)
    side = rng.random(count) < slant / (slant + radius)
    share, angle = np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    heights = np.where(side, height * (1 - share), 0.0)
    points = np.stack([radius * share * np.cos(angle), radius * share * np.sin(angle), heights], axis=1)
    return (points + noise * radius * rng.normal(size=points.shape)) @ turned(3).T


def test_no_point_of_a_clean_cone_is_an_outlier():
    """Old bug: foot points stayed behind on the wrong face where folds had been removed; their points were dropped."""
    found = qf.fit(cone(1000, 10, 40))
    assert not note_of(found, "OUTLIERS") and "FOLDING" not in found.warnings
    assert found.model.min_jacobian() > 0
    assert found.model.volume() == pytest.approx(np.pi * 100 * 40 / 3, rel=1e-3)
    assert found.rms < 1e-2


def test_where_robust_weights_end_in_folds_the_fit_without_them_is_tried(monkeypatch):
    tried = []

    def look(problem, refined, surfaces, most):
        tried.append(problem.robust)
        return iter(()) if problem.robust else without_folds(problem, refined, surfaces, most)

    monkeypatch.setattr(refine, "without_folds", look)
    points = even_directions(300) * [3, 2, 2]
    found = qf.fit(points, box=(3, 3, 3))
    assert True in tried and tried[-1] is False
    assert "FOLDING" not in found.warnings and found.rms < 1e-3


def test_outliers_are_no_reason_to_give_up_robust_weights(monkeypatch):
    """A fit without weights that the outliers have spoiled is worse than a fold that is reported."""
    monkeypatch.setattr(
        refine,
        "without_folds",
        lambda problem, *others: iter(()) if problem.robust else without_folds(problem, *others),
    )
    body = even_directions(300) * [3, 2, 2]
    found = qf.fit(np.concatenate([body, np.random.default_rng(0).uniform(-6, 6, (30, 3))]), box=(3, 3, 3))
    assert "FOLDING" in found.warnings and np.sqrt((found.residuals[:300] ** 2).mean()) < 1e-2
