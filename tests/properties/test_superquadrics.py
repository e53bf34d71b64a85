"""M7, M10, M19, M20, M22: whichever way the axes point, in single precision, of clean samples, twice, held firmly."""

from itertools import permutations, product

import numpy as np
import pytest
from shapes_made import even_directions, lumpy, turned

import quadriform as qf
from quadriform.points import Frame

CLOUD = lumpy(80)
RADIUS = Frame.of(CLOUD).scale
FRAMES = [np.eye(3)[list(order)] * signs for order in permutations(range(3)) for signs in product((1, -1), repeat=3)]
TURNS = [matrix for matrix in FRAMES if np.linalg.det(matrix) > 0]


def off(found, points):
    """Largest distance of points to a superquadric, in their RMS radii."""
    return found.first_order_distance(points).max() / Frame.of(points).scale


@pytest.fixture(scope="module")
def plain():
    return qf.fit_superquadric(CLOUD).superquadric


def test_the_24_ways_to_name_the_axes(plain):
    """M7."""
    assert len(TURNS) == 24
    vertices = plain.grid(8)[0]
    assert max(off(qf.fit_superquadric(CLOUD @ t.T).superquadric, vertices @ t.T) for t in TURNS) < 1e-7


def test_single_precision_near_the_origin():
    """M10."""
    vertices = qf.fit(CLOUD, box=(3, 3, 3)).model.mesh(resolution=8).vertices
    found = qf.fit(CLOUD.astype(np.float32), box=(3, 3, 3)).model
    assert np.abs(found.distance(vertices)).max() < 1e-6 * max(1, np.abs(CLOUD).max() / RADIUS) * RADIUS


def test_clean_samples_give_their_shape_back_or_a_warning():
    """M19: 99 of 100 shapes and poses."""
    good, rng = 0, np.random.default_rng(19)
    for seed in range(100):
        axes, exponents = np.exp(rng.uniform(0, np.log(10), 3)), rng.uniform(0.2, 1.8, 2)
        truth = qf.Superquadric(semi_axes=axes, exponents=exponents, rotation=turned(seed), translation=axes)
        found = qf.fit_superquadric(truth.surface(rng.normal(size=(200, 3)) * axes))
        near = off(found.superquadric, truth.surface(even_directions(500))) < 1e-6
        assert near or found.warnings, seed
        good += near
    assert good >= 99


def test_the_fit_of_a_fit_is_the_fit(plain):
    """M20."""
    again = qf.fit_superquadric(plain.surface(even_directions(500))).superquadric
    assert off(again, plain.grid(8)[0]) < 1e-6


def test_springs_without_end_leave_but_a_shift(plain):
    """M22: of the whole box; a shift costs springs nothing."""
    found = qf.refine(plain, CLOUD, box=(3, 3, 3), regularity="springs", strength=1e12)
    moved = (found.model.box.control_points - found.model.box.rest).reshape(-1, 3)
    assert np.ptp(moved, axis=0).max() < 1e-9 * RADIUS
