"""Each part of the bound of the determinant against plain computations: leaves, ranges, samples, the search itself."""

from itertools import product

import numpy as np
import pytest
from kernel_oracle import combined
from shapes_made import SKEW, made, turned

from quadriform.shapes import bernstein, fold_bound
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.fold_bound import SLACK, _Leaves
from quadriform.shapes.superquadric import Superquadric


def shaken(surface, size=0.3, seed=0, shape=(3, 4, 3)):
    box = ControlBox.around(surface, shape)
    moves = np.random.default_rng(seed).normal(0, size, box.control_points.shape)
    return box.with_control_points(box.control_points + moves)


def value(leaves, index, at):
    """The polynomial of a leaf at box coordinates (n, 3)."""
    within = (at - leaves.low[index]) / leaves.side[index]
    factors = [bernstein.basis(within[:, k], count - 1) for k, count in enumerate(leaves.coefficients[index].shape)]
    return combined(factors, leaves.coefficients[index][..., None])[:, 0]


def test_the_root_is_the_determinant_all_over_the_range(rng):
    surface = made()
    box = shaken(surface)
    root, rounding = fold_bound._root(box, (surface,))
    at = rng.uniform(0, 1, (50, 3))
    expected = np.linalg.det(box.jacobian(box.origin + at @ box.edges))
    np.testing.assert_allclose(value(root, 0, at), expected, rtol=1e-10, atol=1e-10)
    assert 0 < rounding < 1e-10
    large, _ = fold_bound._root(box, (surface.transformed(1.5, -0.5 * surface.translation),))
    np.testing.assert_allclose(value(large, 0, at), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(large.low[0], -0.25, atol=1e-2)


def test_rounding_of_a_coefficient_is_that_of_sums_of_so_many_terms():
    """Of a unit box of two points along each axis: each sum has one term of size 1; counted are 2 x 24 + 10 x 9."""
    box = ControlBox.around(Superquadric(semi_axes=(0.5, 0.5, 0.5)), (2, 2, 2))
    _, rounding = fold_bound._root(box, ())
    np.testing.assert_allclose(rounding, 138 * np.finfo(float).eps, rtol=1e-12)
    flat = ControlBox.around(Superquadric(semi_axes=(0.5, 2.0, 3.0)), (2, 2, 2))
    stretched = flat.with_control_points(flat.control_points * [2, 1, 1])
    np.testing.assert_allclose(fold_bound._root(stretched, ())[1], 2 * rounding, rtol=1e-12)


def test_children_of_leaves_are_their_halves_along_every_axis(rng):
    leaves = _Leaves(rng.normal(size=(2, 3, 2, 4)), rng.normal(size=(2, 3)), rng.uniform(0.5, 2, (2, 3)))
    found = leaves.halved()
    assert found.low.shape == found.side.shape == (16, 3)
    corners = {tuple(np.round(low, 9)) for low in found.low}
    expected = [leaves.low[i] + leaves.side[i] / 2 * ends for i in range(2) for ends in product((0, 1), repeat=3)]
    assert corners == {tuple(np.round(low, 9)) for low in expected}
    for child in range(16):
        at = found.low[child] + rng.uniform(0, 1, (5, 3)) * found.side[child]
        parent = child % 2
        np.testing.assert_allclose(found.side[child], leaves.side[parent] / 2)
        np.testing.assert_allclose(value(found, child, at), value(leaves, parent, at), rtol=1e-9, atol=1e-12)


def test_corners_of_a_leaf_and_its_values_there(rng):
    leaves = _Leaves(rng.normal(size=(3, 3, 2, 4)), rng.normal(size=(3, 3)), rng.uniform(0.5, 2, (3, 3)))
    at, values = leaves.corners()
    for index, ends in product(range(3), range(8)):
        which = np.array(list(product((0, 1), repeat=3)))[ends]
        np.testing.assert_allclose(at[index, ends], leaves.low[index] + which * leaves.side[index])
        np.testing.assert_allclose(values[index, ends], value(leaves, index, at[index, ends][None])[0], atol=1e-12)
    np.testing.assert_array_equal(leaves.lowest(), [each.min() for each in leaves.coefficients])


def plain_search(box, surfaces, tolerance, budget):
    """The search with leaves one by one in a list: lower bound without its rounding, rounds, sample and where."""
    root, _ = fold_bound._root(box, surfaces)
    sampled, where = fold_bound._first_sample(box, surfaces)
    leaves, closed, rounds, made_leaves = [root], [], 0, 1
    while True:
        leaves = [leaf for leaf in leaves if not fold_bound._outside_all(box, surfaces, leaf)[0]]
        for leaf in leaves:
            for corner, found in zip(*(each[0] for each in leaf.corners())):
                point = box.origin + corner @ box.edges
                inside = not surfaces or any(s.implicit(point[None])[0] <= 1 + SLACK for s in surfaces)
                if inside and found < sampled:
                    sampled, where = found, point
        closed += [leaf.lowest()[0] for leaf in leaves if leaf.lowest()[0] >= sampled - tolerance * abs(sampled)]
        leaves = [leaf for leaf in leaves if leaf.lowest()[0] < sampled - tolerance * abs(sampled)]
        if not leaves or made_leaves >= budget:
            break
        leaves.sort(key=lambda leaf: leaf.lowest()[0])
        count = min(max(32, len(leaves) // 4), len(leaves))
        children = [leaf.halved() for leaf in leaves[:count]]
        split = [each.at(np.array([k])) for each in children for k in range(8)]
        leaves, rounds, made_leaves = leaves[count:] + split, rounds + 1, made_leaves + 8 * count
    return min([*closed, *(leaf.lowest()[0] for leaf in leaves), sampled]), rounds, sampled, where


@pytest.mark.parametrize(("tolerance", "budget"), [(0.5, 8000), (0.02, 0), (0.02, 9), (0.02, 300), (0.2, 8000)])
@pytest.mark.parametrize("inside", [True, False])
def test_the_search_splits_the_lowest_leaves_until_all_are_close(inside, tolerance, budget):
    surface = made(exponents=(0.6, 1.2))
    box = shaken(surface, 0.35)
    surfaces = (surface,) if inside else ()
    lower, rounds, sampled, where = plain_search(box, surfaces, tolerance, budget)
    found = fold_bound.jacobian_bound(box, surfaces, tolerance, budget)
    rounding = fold_bound._root(box, surfaces)[1]
    np.testing.assert_allclose(found.sampled, sampled, rtol=1e-12)
    np.testing.assert_allclose(found.where, where, rtol=1e-9)
    np.testing.assert_allclose(found.lower, lower, rtol=1e-10)
    np.testing.assert_allclose((found.lower - lower) / rounding, -(1 + rounds), rtol=0.2)


def test_rounding_is_counted_once_more_in_each_round(monkeypatch):
    surface = made(exponents=(0.6, 1.2))
    box, root = shaken(surface, 0.35), fold_bound._root
    lower, rounds, *_ = plain_search(box, (surface,), 0.1, 8000)
    monkeypatch.setattr(fold_bound, "_root", lambda *of: (root(*of)[0], 0.5))
    assert rounds > 1
    np.testing.assert_allclose(fold_bound.jacobian_bound(box, [surface], 0.1).lower, lower - 0.5 * (1 + rounds))


def test_a_range_holds_the_box_of_each_surface_in_its_own_frame():
    outer, inner = made(), Superquadric(semi_axes=(1.0, 0.5, 2.0), rotation=turned(3), translation=(4.0, 1.0, 2.0))
    box = ControlBox.around(outer)
    assert [side.tolist() for side in fold_bound._range(box, ())] == [[0, 0, 0], [1, 1, 1]]
    assert [side.tolist() for side in fold_bound._range(box, (outer,))] == [[0, 0, 0], [1, 1, 1]]
    corners = []
    for surface in (outer, inner):
        for signs in product((-1, 1), repeat=3):
            world = surface.rotation @ (surface.semi_axes * signs) + surface.translation
            corners.append(np.linalg.solve(box.edges.T, world - box.origin))
    low, high = fold_bound._range(box, (outer, inner))
    np.testing.assert_allclose(low, np.min(corners, axis=0), atol=1e-9)
    np.testing.assert_allclose(high, np.max(corners, axis=0), atol=1e-9)


def test_lattice_points_inside_are_those_of_a_plain_loop():
    surface = Superquadric(semi_axes=(1.0, 0.5, 2.0), rotation=SKEW, translation=(0.2, 0.1, 0.0))
    box = ControlBox.around(Superquadric(semi_axes=(3.0, 3.0, 3.0)))
    low, high = fold_bound._range(box, (surface,))
    expected = []
    for steps in product(range(9), repeat=3):
        point = box.origin + (low + np.array(steps) / 8 * (high - low)) @ box.edges
        if surface.implicit(point[None])[0] <= 1 + SLACK:
            expected.append(point)
    found = fold_bound.grid_inside(box, [surface], 9)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert 20 < len(found) < 200


def test_the_first_sample_is_the_least_on_the_surfaces_or_that_in_the_middle():
    surfaces = (made(), made(semi_axes=(1.0, 1.0, 1.0)))
    box = shaken(surfaces[0])
    points = np.concatenate([each.grid(8)[0] for each in surfaces])
    least, where = fold_bound._first_sample(box, surfaces)
    values = np.linalg.det(box.jacobian(points))
    np.testing.assert_allclose(least, values.min(), rtol=1e-9)
    np.testing.assert_array_equal(where, points[values.argmin()])
    least, where = fold_bound._first_sample(box, ())
    np.testing.assert_allclose(where, box.origin + box.edges.sum(axis=0) / 2)
    np.testing.assert_allclose(least, np.linalg.det(box.jacobian(where[None])[0]), rtol=1e-9)


def test_points_on_a_surface_are_inside_and_all_are_without_one():
    surface = Superquadric()
    points = np.array([[1.0, 0, 0], [1 + 0.9e-9, 0, 0], [1 + 1.2e-9, 0, 0], [0.2, 0, 0]])
    assert fold_bound._inside_any((surface,), points).tolist() == [True, True, False, True]
    assert fold_bound._inside_any((), points).all()
    shifted = Superquadric(translation=(0.5, 0, 0))
    assert fold_bound._inside_any((surface, shifted), points).all()


def parallelepipeds(n, seed, size, edges):
    rng = np.random.default_rng(seed)
    return rng.uniform(-size, size, (n, 3)), rng.uniform(0.1, 0.5, (n, 1, 1)) * edges


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_in_the_axes_of_a_surface_what_lies_outside_is_known_exactly(kind):
    surface = Superquadric(kind, (1.0, 0.7, 1.5), (0.6, 1.4), hole_radius=2.5 if kind == "toroid" else None)
    centres, halves = parallelepipeds(300, 1, 1.6 if kind == "ellipsoid" else 3.5, np.eye(3))
    found = fold_bound._outside(surface, centres, halves)
    steps = np.array(list(product(np.linspace(-1, 1, 9), repeat=3)))
    for centre, half, outside in zip(centres, halves, found):
        touched = surface.implicit(centre + steps @ half).min() <= 1
        assert not (touched and outside)
    # sampled cells miss little: nearly all that no sample touches are known to be outside
    untouched = [surface.implicit(c + steps @ h).min() > 1.05 for c, h in zip(centres, halves)]
    assert found[untouched].mean() > (0.98 if kind == "ellipsoid" else 0.9)
    assert 0.1 < found.mean() < 0.9


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_cell_outside_has_no_point_inside(seed):
    surface = made(semi_axes=(1.0, 0.7, 1.5))
    centres, halves = parallelepipeds(100, seed, 3.0, turned(seed))
    steps = np.array(list(product(np.linspace(-1, 1, 9), repeat=3)))
    found = fold_bound._outside(surface, centres + surface.translation, halves)
    for centre, half, outside in zip(centres + surface.translation, halves, found):
        assert not (outside and surface.implicit(centre + steps @ half).min() <= 1)
    assert found.mean() > 0.3
    local = np.abs((centres @ surface.rotation) / surface.semi_axes)
    reach = np.abs(np.einsum("nij,jk->nik", halves, surface.rotation)).sum(axis=1) / surface.semi_axes
    nearest = surface.to_world(np.maximum(local - reach, 0) * surface.semi_axes)
    np.testing.assert_array_equal(found, surface.implicit(nearest) > 1 + SLACK)


def test_a_leaf_is_outside_where_it_is_outside_of_every_surface():
    near, far = Superquadric(semi_axes=(0.3, 0.3, 0.3)), Superquadric(translation=(5.0, 0, 0))
    box = ControlBox(np.array([-2.0, -2, -2]), 8 * np.eye(3), ControlBox.around(near).control_points)
    low, side = np.array([[0.0, 0, 0], [0.2, 0.2, 0.2], [0.8, 0.2, 0.2]]), np.full((3, 3), 0.1)
    leaves = _Leaves(np.zeros((3, 2, 2, 2)), low, side)
    assert fold_bound._outside_all(box, (near,), leaves).tolist() == [True, False, True]
    assert fold_bound._outside_all(box, (near, far), leaves).tolist() == [True, False, False]
    assert fold_bound._outside_all(box, (), leaves).tolist() == [False] * 3
    assert not fold_bound._outside(made("hyperboloid1"), 99 * np.ones((2, 3)), np.zeros((2, 3, 3))).any()


def test_folds_are_the_lowest_sample_and_the_folded_points_of_a_lattice():
    surface = Superquadric()
    box = ControlBox.around(surface)
    points = box.control_points.copy()
    points[2, ..., 0] += 3
    box = box.with_control_points(points)
    found = fold_bound.possible_folds(box, [surface])
    bound = fold_bound.jacobian_bound(box, [surface], fold_bound.SIGN_ONLY)
    np.testing.assert_array_equal(found[0], bound.where)
    lattice = fold_bound.grid_inside(box, [surface], 25)
    determinants = np.linalg.det(box.jacobian(lattice))
    np.testing.assert_array_equal(found[1:], lattice[determinants <= 0])


def test_rows_are_the_derivatives_of_the_determinant_by_the_control_points(rng):
    box = shaken(made(), shape=(2, 3, 2))
    points = box.origin + rng.uniform(0, 1, (4, 3)) @ box.edges
    rows = fold_bound.determinant_rows(box, points)
    assert rows.shape == (4, 36)
    for k in range(36):
        step = np.zeros(36)
        step[k] = 1e-6
        ahead, behind = (
            np.linalg.det(box.with_control_points(box.control_points + s * step.reshape(2, 3, 2, 3)).jacobian(points))
            for s in (1, -1)
        )
        np.testing.assert_allclose(rows[:, k], (ahead - behind) / 2e-6, atol=1e-8)


@pytest.mark.parametrize(("gap", "is_outside"), [(0.0, False), (5e-10, False), (2e-9, True)])
def test_a_cell_that_touches_a_surface_to_rounding_is_not_outside(gap, is_outside):
    cell = np.array([[1.5 + gap, 0.0, 0.0]]), 0.5 * np.eye(3)[None]
    assert fold_bound._outside(Superquadric(), *cell).tolist() == [is_outside]
    point = np.array([[1 + gap, 0.0, 0.0]])
    assert fold_bound._inside_any((Superquadric(),), point).tolist() == [not is_outside]
