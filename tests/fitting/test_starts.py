"""Starts of a refinement: walls that are too thin, axes that rounding would choose, plain fits beside robust ones."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import SKEW, even_directions, made, turned

from quadriform.fitting.cloud import dense_points
from quadriform.fitting.refinement import starts
from quadriform.shapes.superquadric import Superquadric

SURFACE = replace(made(exponents=(0.8, 1.1), semi_axes=(1.2, 0.9, 0.8)), translation=np.zeros(3))
POINTS = SURFACE.surface(even_directions(60)) * np.random.default_rng(2).uniform(0.95, 1.05, (60, 1))


def test_a_wall_that_is_too_thin_becomes_that_of_a_smaller_copy():
    """An inner body that is nearly as large as the outer one somewhere, though its points are half as far."""
    outer = Superquadric(semi_axes=(2.0, 2.0, 3.0), rotation=SKEW)
    clouds = {"epi": outer.surface(even_directions(200)), "endo": 0.5 * outer.surface(even_directions(150))}
    for reach, kept in ((0.82, True), (0.85, False)):  # a third of the half between them is at five sixths
        inner = Superquadric(semi_axes=(1.0, 1.0, 3 * reach), rotation=SKEW)
        found = starts.nested({"endo": inner, "epi": outer}, clouds)
        assert (found["endo"] is inner) == kept and found["epi"] is outer
    np.testing.assert_allclose(found["endo"].semi_axes, [1, 1, 1.5], rtol=1e-9)
    beyond = {"epi": clouds["epi"], "endo": 0.999 * clouds["epi"]}
    shifted = Superquadric(semi_axes=(2.1, 2.1, 3.1), rotation=SKEW)
    assert starts.nested({"endo": shifted, "epi": outer}, beyond)["endo"] is not shifted


@pytest.mark.parametrize("seed", range(4))
def test_the_first_axes_point_to_positive_coordinates(seed):
    surface = Superquadric("ellipsoid", (3, 2, 1), (0.5, 0.7), turned(seed))
    for signs in ((1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, 1)):
        found = starts.with_positive_axes(replace(surface, rotation=surface.rotation * signs))
        for axis in (0, 1):
            column = found.rotation[:, axis]
            assert column[np.abs(column) > 0.1][0] > 0
        assert np.linalg.det(found.rotation) == pytest.approx(1)
        np.testing.assert_allclose(np.abs(found.rotation), np.abs(surface.rotation))


def test_candidates_are_the_robust_fit_and_plain_ones_of_dense_points():
    stray = np.concatenate([POINTS, [[9.0, 9, 9]]])
    found = starts.candidates({"a": stray}, {"a": SURFACE}, "ellipsoid")
    assert len(found) == 3 and found[0]["a"] is SURFACE
    without = starts.candidates({"a": POINTS}, {"a": SURFACE}, "ellipsoid")
    assert dense_points(stray).tolist() == [True] * 60 + [False]
    np.testing.assert_allclose(found[2]["a"].parameters, without[2]["a"].parameters, rtol=1e-9, atol=1e-9)
    few = starts.candidates({"a": POINTS[:10]}, {"a": SURFACE}, "ellipsoid")
    assert len(few) == 2
    assert starts.candidates({"a": POINTS}, {"a": SURFACE}, "toroid") == [{"a": SURFACE}]
