"""Points that fill a body are no surface: their fit is poor, and its map must not fold."""

import numpy as np
import pytest
from shapes_made import even_directions

import quadriform as qf
from quadriform.fitting.refinement import refine

LATTICE = np.argwhere(np.ones((9, 9, 9))) - 4.0
HALF_BALL = LATTICE[(np.linalg.norm(LATTICE, axis=1) <= 4.5) & (LATTICE[:, 2] >= 0)]


def filled_ball(count, seed):
    places = np.random.default_rng(seed).uniform(-1, 1, (4 * count, 3))
    return places[np.linalg.norm(places, axis=1) < 1][:count]


def assert_unfolded_and_poor(found, points):
    assert found.model.min_jacobian() > 0 and not found.model.crossings()
    assert "POOR_FIT" in found.warnings and "FOLDING" not in found.warnings
    assert np.linalg.norm(found.model.mesh().vertices, axis=1).max() < 2 * np.linalg.norm(points, axis=1).max()


def test_a_filled_volume_does_not_end_with_a_map_that_folds():
    """Old bug: of a thousand points in a ball, control points many radii away and determinants of minus 80."""
    points = filled_ball(1000, seed=2)
    assert_unfolded_and_poor(qf.fit(points, box=(4, 4, 4)), points)


@pytest.fixture
def no_fold_removal(monkeypatch):
    monkeypatch.setattr(refine, "without_folds", lambda problem, refined, surfaces, most: iter(()))


def test_where_no_fold_can_be_removed_a_poor_fit_is_regularised_until_nothing_folds(no_fold_removal):
    ball = filled_ball(460, seed=2)
    half = ball[ball[:, 2] > 0]
    found = qf.fit(half)
    assert_unfolded_and_poor(found, half)
    rest = found.model.box.with_control_points(found.model.box.rest)
    undeformed = qf.DeformableModel(found.model.surfaces, rest)
    assert found.rms < np.sqrt((undeformed.distance(half) ** 2).mean())


def test_half_a_ball_of_voxel_centres_is_unreliable():
    """Of few layers of voxels most points are near some surface, and the others are taken for outliers."""
    assert qf.fit(HALF_BALL, box=(4, 4, 4)).status == "unreliable"


def test_a_good_fit_that_folds_is_kept_with_its_warning(no_fold_removal):
    found = qf.fit(even_directions(300) * [3, 2, 2], box=(3, 3, 3))
    assert "FOLDING" in found.warnings and found.rms < 1e-3
