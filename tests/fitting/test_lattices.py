"""Points of images lie on lattices, where equal distances abound: neither rounding nor order may choose among them."""

import numpy as np
import pytest
from shapes_made import turned

from quadriform.fitting.cloud import Neighbourhood, canonical_order
from quadriform.fitting.superquadric.initial import dense_parts


def lattice_shell(centre):
    """Whole numbers near an ellipsoid with semi-axes 9, 8 and 11, in radii of about one."""
    lattice = np.stack(np.meshgrid(*[np.arange(-14, 15.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    off = np.abs(np.linalg.norm((lattice - centre) / [9, 8, 11], axis=1) - 1) < 0.05
    return (lattice[off] - lattice[off].mean(axis=0)) / 9


LOPSIDED, EVEN = lattice_shell([0.2, -0.3, 0.1]), lattice_shell(np.zeros(3))


@pytest.fixture(params=range(3))
def change(request):
    """A turn (3, 3) and an order of the lop-sided shell."""
    return turned(request.param), np.random.default_rng(request.param).permutation(len(LOPSIDED))


def test_a_lattice_has_equal_distances():
    """Otherwise the rest would say nothing."""
    assert np.diff(np.sort(np.linalg.norm(LOPSIDED, axis=1))).min() < 1e-14


def test_neighbours_are_the_same(change):
    turn, order = change
    one, two = Neighbourhood.of(LOPSIDED), Neighbourhood.of((LOPSIDED @ turn.T)[order])
    np.testing.assert_allclose(two.flatness, one.flatness[order], atol=1e-9)
    clear = one.flatness[order] > 0.1
    along = np.abs(np.einsum("ni,ni->n", two.normals, (one.normals @ turn.T)[order]))
    np.testing.assert_allclose(along[clear], 1, atol=1e-9)


def test_the_same_points_come_first(change):
    turn, order = change
    np.testing.assert_array_equal(order[canonical_order((LOPSIDED @ turn.T)[order])], canonical_order(LOPSIDED))


def test_the_same_points_come_first_where_nothing_is_heavier(rng):
    order = rng.permutation(len(EVEN))
    noisy = EVEN + 1e-15 * rng.normal(size=EVEN.shape)
    np.testing.assert_array_equal(order[canonical_order(noisy[order])], canonical_order(EVEN))


def test_the_same_parts_are_dense(change):
    turn, order = change
    np.testing.assert_array_equal(dense_parts((LOPSIDED @ turn.T)[order]), dense_parts(LOPSIDED)[:, order])
