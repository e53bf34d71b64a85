"""Volumes below a plane, against closed forms."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from quadriform.errors import DegenerateError, OptionError
from quadriform.heart.axis import LongAxis
from quadriform.heart.base import base_rule, plane_through
from quadriform.heart.measure import contour_length
from quadriform.heart.volumes import section_centre, volume, volume_below
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

UP = np.array([0.0, 0, 1])
TWO = 2 * [DeformableModel({"endo": Superquadric()}, ControlBox.around(Superquadric()))]


@pytest.fixture
def cube():
    """A box 2 x 3 x 4 with a corner at (1, 1, 1), triangles counter-clockwise from outside."""
    mesh = Superquadric(exponents=(0.01, 0.01)).mesh(2)
    return Mesh(np.array([1.0, 1, 1]) + (np.sign(np.round(mesh.vertices, 1)) + 1) / 2 * [2, 3, 4], mesh.faces)


@pytest.mark.parametrize("height", [1.5, 2.0, 3.0, 4.9])
def test_a_box_is_cut_exactly(cube, height):
    plane = BasePlane(np.array([7.0, -3, height]), UP)
    assert volume_below(cube, plane) == pytest.approx(6 * (height - 1), rel=1e-12)
    assert section_centre(cube, plane) == pytest.approx([2, 2.5, height], rel=1e-12)


def test_planes_that_miss(cube):
    above, under = (BasePlane(np.array([0.0, 0, z]), UP) for z in (6, 0))
    assert volume_below(cube, above) == pytest.approx(24) == volume_below(cube, None)
    assert volume_below(cube, under) == 0
    assert section_centre(cube, above) is None


def test_both_sides_of_an_oblique_plane_make_the_whole(cube, rng):
    for _ in range(20):
        direction = rng.normal(size=3)
        point = np.array([2, 2.5, 3]) + 0.5 * rng.normal(size=3)
        plane = BasePlane(point, direction / np.linalg.norm(direction))
        other = BasePlane(point, -plane.direction)
        assert volume_below(cube, plane) + volume_below(cube, other) == pytest.approx(24, rel=1e-12)


def test_an_open_mesh_needs_no_lid_beyond_the_plane(cube):
    top = (cube.vertices[cube.faces][:, :, 2] == 5).all(axis=1)
    assert top.any()
    plane = BasePlane(np.array([2.0, 2, 4]), UP)
    assert volume_below(Mesh(cube.vertices, cube.faces[~top]), plane) == pytest.approx(18, rel=1e-12)


def test_the_cap_of_a_ball_is_archimedes_own():
    ball = Superquadric(semi_axes=(10, 10, 10))
    model = DeformableModel({"endo": ball}, ControlBox.around(ball))
    cap = np.pi * 14**2 * (3 * 10 - 14) / 3
    assert volume(model, "endo", BasePlane(np.array([0.0, 0, 4]), UP)) == pytest.approx(cap, rel=2e-5)


def test_the_contour_of_a_ball_is_an_arc():
    mesh = Superquadric(semi_axes=(10, 10, 10)).mesh(48)
    axis = LongAxis(np.array([0.0, 0, -10]), np.array([0.0, 0, 10]))
    assert contour_length(mesh, axis, None) == pytest.approx(20 * np.pi, rel=1e-3)
    half = BasePlane(np.array([0.0, 0, 5]), UP)
    assert contour_length(mesh, axis, half) == pytest.approx(20 * (np.pi - np.arccos(0.5)), rel=1e-3)


def test_the_plane_of_mitral_points_leads_away_from_the_cavity(rng):
    loop = np.array([[1.0, 0, 5], [0, 1, 5], [-1, 0, 5], [0, -1, 5.0]])
    plane = plane_through(loop, np.zeros(3))
    assert plane.direction == pytest.approx(UP)
    assert plane.point == pytest.approx([0, 0, 5])
    assert plane_through(loop, np.array([0, 0, 9.0])).direction == pytest.approx(-UP)
    with pytest.raises(DegenerateError, match="on a line"):
        plane_through(np.outer([0, 1, 2], [1.0, 2, 3]), np.zeros(3))


@pytest.mark.parametrize(
    ("base", "words"),
    [
        (1.5, "expected a number from 0.001 to 1"),
        (([0, 0, 0], [0, 0, 0]), "direction of the plane is zero"),
        ([[0, 0, 0], [1, 0, 0]], "2 mitral points in frame 0"),
        ([np.zeros((4, 3))] * 3, "expected mitral points for each of 2 frames, found 3"),
        (np.float32(0.0005), "expected a number from 0.001 to 1"),
        (True, "expected a number from 0.001 to 1"),
        ("0.9", r"base='0.9': expected a number, a plane \(point, direction\), or mitral points"),
        (Path("points.csv"), "expected a number, a plane"),
        (1j, "expected a number, a plane"),
    ],
)
def test_what_is_no_base_is_refused(base, words):
    with pytest.raises(OptionError, match=words):
        base_rule(base, TWO, {})


@pytest.mark.parametrize(
    ("base", "fraction"),
    [(np.float32(0.5), 0.5), (np.float64(0.9), 0.9), (np.int64(1), 1), (1, 1), (Fraction(3, 4), 0.75), (0.001, 0.001)],
)
def test_every_kind_of_real_number_is_a_fraction_of_the_axis(base, fraction):
    found = base_rule(base, TWO, {}).fraction
    assert found == fraction and type(found) is float


def test_the_rule_has_a_description():
    loop = np.eye(3)
    assert "whole closed surface" in base_rule(None, TWO, {}).description
    assert "80 %" in base_rule(0.8, TWO, {}).description
    rule = base_rule(([0, 0, 0], [0, 0, 2]), TWO, {})
    assert "fixed plane" in rule.description and rule.fixed.direction.tolist() == [0, 0, 1]
    assert "the same in all frames" in base_rule(loop, TWO, {}).description
    assert "own" in base_rule([loop, loop], TWO, {}).description
