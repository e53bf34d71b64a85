"""Superquadrics one inside the other: each its own while a wall is left between them, else the inner one a copy."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, made, turned

import quadriform as qf
from quadriform.fitting.refinement.starts import nested, with_positive_axes

OUTER = made(exponents=(1, 1), semi_axes=(34, 34, 53))
INNER = replace(OUTER, semi_axes=np.array([24.0, 24, 44]))


def fitted(inner, outer=OUTER, seen=INNER):
    """What is made of an inner fit, by points of the walls that were seen."""
    directions = even_directions(300)
    clouds = {"endo": seen.surface(directions), "epi": outer.surface(directions)}
    return nested({"endo": inner, "epi": outer}, clouds)


def test_a_surface_inside_keeps_its_own_proportions():
    found = fitted(INNER)
    assert found["endo"] is INNER and found["epi"] is OUTER


@pytest.mark.parametrize("axes", [(24, 24, 52.0), (24, 24, 60)], ids=["nearly touches", "crosses"])
def test_one_that_runs_into_the_outer_becomes_a_copy_of_it_through_the_points(axes):
    found = fitted(replace(INNER, semi_axes=np.array(axes)))["endo"]
    shares = found.semi_axes / OUTER.semi_axes
    assert np.ptp(shares) < 1e-12 and np.array_equal(found.translation, OUTER.translation)
    assert 24 / 34 < shares[0] < 44 / 53


def test_how_thin_a_wall_may_be_is_found_in_the_points():
    """A gap of 2 % is much for a wall of 3 %, and next to nothing for one of 30 %."""
    inner = replace(OUTER, semi_axes=0.98 * OUTER.semi_axes)
    thin, thick = (replace(OUTER, semi_axes=share * OUTER.semi_axes) for share in (0.97, 0.7))
    assert fitted(inner, seen=thin)["endo"] is inner
    assert fitted(inner, seen=thick)["endo"] is not inner


@pytest.mark.parametrize("share", [0.0, 0.03, 0.2])
def test_the_size_of_a_copy_is_that_of_most_points(share):
    """Old bug: by their mean, a few points far outside made the inner surface the larger one."""
    directions, inner = even_directions(300), replace(OUTER, semi_axes=0.8 * OUTER.semi_axes)
    points = inner.surface(directions)
    points[: int(share * 300)] = OUTER.translation + 8 * (OUTER.surface(directions) - OUTER.translation)[:1]
    clouds = {"endo": points, "epi": OUTER.surface(directions)}
    found = nested({"endo": replace(OUTER, semi_axes=1.1 * OUTER.semi_axes), "epi": OUTER}, clouds)["endo"]
    np.testing.assert_allclose(found.semi_axes, inner.semi_axes, rtol=1e-9)


def test_surfaces_apart_are_left_alone():
    """Neither lies inside the other, however near they are."""
    aside = replace(INNER, translation=OUTER.translation + 57 * OUTER.rotation[:, 0])
    assert fitted(aside, seen=aside)["endo"] is aside


def test_half_rotations_are_taken_back():
    """Old bug: on a prism of voxels processors ended at different half-turns, and meshes began at different corners."""
    body = qf.Superquadric(semi_axes=(1, 2, 3), exponents=(0.7, 0.9), rotation=turned(3))
    points = np.random.default_rng(0).normal(size=(50, 3))
    for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        found = with_positive_axes(replace(body, rotation=body.rotation * signs))
        np.testing.assert_array_equal(found.rotation, with_positive_axes(body).rotation)
        assert np.linalg.det(found.rotation) > 0
        np.testing.assert_allclose(found.implicit(points), body.implicit(points), rtol=1e-12)
