"""Patches that are left out: together they are all of the data, and each is predicted by the others."""

from itertools import product

import numpy as np
import pytest
from shapes_made import lumpy

from quadriform.fitting.refinement.left_out import _equations, _patch_of, is_less, signed_rank_p_value
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

CLOUD = Frame.of(lumpy(400)).to_local(lumpy(400))


def test_squares_of_the_patches_are_the_distances_to_the_moved_surface(rng):
    """Each with the weights of its points; together those of all points."""
    ball = Superquadric()
    box = ControlBox.around(ball, (3, 4, 3))
    data = SurfaceData.of(ball, CLOUD, rng.uniform(0.5, 2, 400), None).with_nearest_foot_points(box)
    parts, rows, patch = _equations(data, box, 6), data_rows(data, box), _patch_of(CLOUD, 6)
    moves = rng.normal(0, 0.1, box.rest.shape)
    moved = box.with_control_points(box.rest + moves).deform(rows.origins)
    off = rows.targets - moved
    squares = np.einsum("ni,nij,nj->n", off, rows.metric, off)
    for number, (equations, weight) in enumerate(parts):
        assert equations.squares(moves.reshape(-1, 3)) == pytest.approx(squares[patch == number].sum(), rel=1e-9)
        assert weight == pytest.approx(data.effective_weights[patch == number].sum())


def test_errors_are_less_where_most_patches_agree(rng):
    """Old fault: a few patches at the ends of stacks of thick slices led to a strength ten times too small."""
    before = rng.uniform(1, 2, 20) * np.where(np.arange(20) < 3, 100, 1)
    few = before * np.where(np.arange(20) < 3, 0.5, rng.permutation(np.repeat([0.9, 1.1], 10)))
    assert few.sum() < 0.6 * before.sum() and not is_less(few, before)
    assert is_less(0.99 * before, before) and not is_less(before, 0.99 * before)
    assert not is_less(before, before)
    # in most patches less, in sum more
    assert not is_less(before * np.where(np.arange(20) == 0, 3, 0.9), before)


def test_errors_that_differ_by_chance_are_seldom_less(rng):
    found = [is_less(*rng.chisquare(5, (2, 20))) for _ in range(300)]
    assert np.mean(found) < 0.03


@pytest.mark.parametrize("values", [[1.5, -2, 3, 0.5, -0.1, 7], [1, 1, -1, 2, 2, -3, 0, 0], [-1, -2, -3], [0.0]])
def test_the_probability_of_ranks_counts_all_signs(values):
    """Against all signs of the ranks, one after the other."""
    values = np.array(values)[np.nonzero(values)]
    sizes = np.abs(values)
    ranks = np.array([np.mean(np.flatnonzero(np.sort(sizes) == size) + 1) for size in sizes])
    sums = [ranks @ np.array(positive) for positive in product((0, 1), repeat=len(ranks))]
    assert signed_rank_p_value(values) == np.mean(np.array(sums) >= ranks[values > 0].sum())
    assert signed_rank_p_value(np.append(values, 0)) == signed_rank_p_value(values)
