"""From LPS to RAS and back: x and y change their signs, and nothing else changes."""

import numpy as np
import pytest
from shapes_made import KINDS, even_directions, made

from quadriform.errors import InputError, OptionError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.spaces import rotation_between
from quadriform.shapes.splines import TimeBasis

SIGNS = np.array([-1.0, -1.0, 1.0])


def lps(kind="ellipsoid", space="LPS"):
    surface = made(kind)
    box = ControlBox.around(surface, (3, 4, 3))
    moved = box.control_points + np.random.default_rng(2).normal(scale=0.2, size=box.control_points.shape)
    return DeformableModel({"surface": surface}, box.with_control_points(moved), space, "mm", "a" * 64)


def moving(space="LPS"):
    still = lps(space=space)
    boxes = still.box.control_points + np.random.default_rng(3).normal(scale=0.1, size=(4, 3, 4, 3, 3))
    basis = TimeBasis(np.arange(4.0), 4.0)
    return MovingModel(still.surfaces, still.box.origin, still.box.edges, basis, boxes, space, "mm", "b" * 64)


@pytest.mark.parametrize("kind", KINDS)
def test_every_vertex_has_x_and_y_negated(kind):
    there, here = lps(kind).in_space("RAS"), lps(kind)
    np.testing.assert_allclose(there.mesh(resolution=6).vertices, here.mesh(resolution=6).vertices * SIGNS, atol=1e-12)
    assert (there.space, there.unit, there.input_sha256) == ("RAS", "mm", "a" * 64)


def test_what_it_says_about_the_world_turns_along():
    """The superquadric, its box, the map and its inverse, distances: all of points with x and y negated."""
    here, points = lps(), 3 * even_directions(60) + [1, -2, 0.5]
    there, turned = here.in_space("RAS"), points * SIGNS
    np.testing.assert_allclose(there.superquadric().implicit(turned), here.superquadric().implicit(points), rtol=1e-12)
    np.testing.assert_allclose(there.deform(turned), here.deform(points) * SIGNS, atol=1e-12)
    np.testing.assert_allclose(there.distance(turned), here.distance(points), atol=1e-9)
    np.testing.assert_allclose(there.box.local(turned), here.box.local(points), atol=1e-12)
    np.testing.assert_allclose(there.box.rest, here.box.rest * SIGNS, atol=1e-12)
    assert there.volume() == pytest.approx(here.volume(), rel=1e-12) and there.volume() > 0
    assert there.min_jacobian() == pytest.approx(here.min_jacobian(), rel=1e-9)


def test_semi_axes_exponents_and_handedness_stay():
    here, there = lps().superquadric(), lps().in_space("RAS").superquadric()
    assert np.linalg.det(there.rotation) == pytest.approx(1)
    assert (here.semi_axes == there.semi_axes).all() and (here.exponents == there.exponents).all()
    np.testing.assert_allclose(there.with_parameters(there.parameters).rotation, there.rotation, atol=1e-12)


@pytest.mark.parametrize("make", [lps, moving])
def test_there_and_back_are_the_same_values(make):
    here = make()
    back = here.in_space("RAS").in_space("LPS")
    for one, other in ((here, back), (here, here.in_space("LPS"))):
        boxes = (one.box, other.box) if make is lps else (one, other)
        for name in ("origin", "edges", "control_points"):
            assert np.array_equal(*(getattr(box, name) for box in boxes))
        assert np.array_equal(one.surfaces["surface"].rotation, other.surfaces["surface"].rotation)
    assert back.space == "LPS" and here.in_space("RAS").space == "RAS"


def test_a_moving_model_turns_at_all_times():
    here, there = moving(), moving().in_space("RAS")
    for time in (0.0, 1.3, 5.9):
        one, other = (model.at(time) for model in (here, there))
        np.testing.assert_allclose(
            other.mesh(resolution=4).vertices, one.mesh(resolution=4).vertices * SIGNS, atol=1e-12
        )
        assert other.space == "RAS"
    points = here.surfaces["surface"].grid(2)[0]
    paths = there.trajectories(points * SIGNS, [0.0, 2.2])
    np.testing.assert_allclose(paths, here.trajectories(points, [0.0, 2.2]) * SIGNS, atol=1e-12)


@pytest.mark.parametrize("make", [lps, moving])
def test_what_cannot_be_is_named(make):
    with pytest.raises(InputError, match="found 'unknown'"):
        make(space="unknown").in_space("RAS")
    with pytest.raises(OptionError, match="'LAS'"):
        make().in_space("LAS")
    assert make(space="unknown").in_space("unknown").space == "unknown"


def test_the_turn_is_a_rotation():
    turn = rotation_between("LPS", "RAS")
    assert np.linalg.det(turn) == 1 and np.array_equal(turn @ turn, np.eye(3))
    assert np.array_equal(rotation_between("RAS", "LPS"), turn)
    with pytest.raises(OptionError, match="'unknown'"):
        rotation_between("LPS", "unknown")
