"""Patches that are left out: together they are all of the data, and each is predicted by the others."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import lumpy

from quadriform.fitting.refinement.left_out import (
    LEFT_OUT,
    _equations,
    _Patch,
    _patch_of,
    _patches,
    _squares,
    is_less,
    signed_rank_p_value,
)
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


def test_patches_are_left_out_of_the_equations_of_all_points(rng):
    """As many of each surface, but two at least; those without inliers say nothing."""
    ball = Superquadric()
    box = ControlBox.around(ball, (3, 4, 3))
    data = SurfaceData.of(ball, CLOUD, rng.uniform(0.5, 2, 400), None).with_nearest_foot_points(box)
    patch = _patch_of(CLOUD, LEFT_OUT.patches // 2)
    other, asked = replace(data, inliers=np.where(patch == 1, 0.0, 1.0)), []
    whole = SimpleNamespace(without_points=lambda own, count: (own, count))
    problem = SimpleNamespace(linear_problem=lambda *given: asked.append(given) or whole)
    found = _patches(problem, SimpleNamespace(datasets=(data, other), box=box))
    assert asked == [((data, other), (None, None), box, 1.0)]
    weights = [of.effective_weights[patch == n].sum() for of in (data, other) for n in range(LEFT_OUT.patches // 2)]
    assert [each.others[1] for each in found] == pytest.approx([weight for weight in weights if weight > 0])
    assert len(found) == LEFT_OUT.patches // 2 * 2 - 1 and all(each.others[0] is each.own for each in found)
    many = SimpleNamespace(datasets=(data,) * (LEFT_OUT.patches + 1), box=box)
    assert len(_patches(problem, many)) == 2 * (LEFT_OUT.patches + 1)


def test_the_square_of_a_patch_is_that_at_the_solution_without_it():
    def patch(displacement, square):
        solution = displacement and SimpleNamespace(displacement=displacement)
        others = SimpleNamespace(solve=lambda strength: solution if strength == 0.5 else None)
        return _Patch(others, SimpleNamespace(squares=lambda given: square if given == displacement else None))

    found = _squares([patch("a", 0.3), patch("b", -1e-17), patch(None, 1.0), patch("c", 2.0)], 0.5)
    assert found.tolist() == [0.3, 0, np.inf, 2]  # a sum below zero is rounding


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
