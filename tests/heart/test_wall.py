"""The wall along the volumetric map, strain from its gradient, and twist, against closed forms."""

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.heart.axis import LongAxis
from quadriform.heart.wall import Wall
from quadriform.heart.wall_motion import (
    ReferenceWall,
    deformation_gradient,
    green_strain,
    in_axes,
    local_axes,
    relative_lengthening,
)
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.pose import rotation_from_euler
from quadriform.shapes.superquadric import Superquadric

ENDO = Superquadric(semi_axes=(10, 10, 10))
EPI = Superquadric(semi_axes=(14, 14, 14))
AXIS = LongAxis(np.array([0.0, 0, -10]), np.array([0.0, 0, 10]))


@pytest.fixture
def rest():
    return ControlBox.around(EPI)


def affine(box, matrix, shift=(0, 0, 0)):
    return box.with_control_points(box.control_points @ np.asarray(matrix).T + shift)


def test_a_shell_is_as_thick_as_it_is(rest):
    wall = Wall.between(ENDO, EPI)
    assert wall.thickness(rest) == pytest.approx(4, rel=1e-12)
    assert wall.thickness(affine(rest, 1.5 * np.eye(3))) == pytest.approx(6, rel=1e-12)
    shell = 4 / 3 * np.pi * (14**3 - 10**3)
    assert wall.volumes(rest).sum() == pytest.approx(shell, rel=1e-9)
    assert wall.volumes(affine(rest, np.diag([2, 3, 0.5]))).sum() == pytest.approx(3 * shell, rel=1e-9)


def test_centres_and_rotations_may_differ(rng):
    """Every line starts on one surface and ends on the other."""
    turn = rotation_from_euler(np.array([0.4, -0.2, 0.9]))
    epi = Superquadric(semi_axes=(16, 14, 20), exponents=(0.7, 1.2), rotation=turn, translation=(1, -1, 2))
    wall = Wall.between(Superquadric(semi_axes=(8, 9, 11), exponents=(1.1, 0.9)), epi)
    assert epi.implicit(wall.at(1.0)) == pytest.approx(1, abs=1e-9)
    assert Superquadric(semi_axes=(8, 9, 11), exponents=(1.1, 0.9)).implicit(wall.at(0.0)) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("size", [1 - 1e-15, 1, 1 + 1e-15, 1 + 1e-12])
def test_a_wall_no_thicker_than_rounding_is_refused(size):
    """Both surfaces from the same points: whether a line across the wall has length zero was decided by rounding."""
    with pytest.raises(OptionError, match=r"'endo' lies on or outside 'epi' in 100 %"):
        Wall.between(EPI, Superquadric(semi_axes=tuple(14 * size * np.ones(3))))


def test_a_thin_wall_is_as_thick_as_it_is(rest):
    wall = Wall.between(Superquadric(semi_axes=(14 - 1e-6,) * 3), EPI)
    np.testing.assert_allclose(wall.thickness(rest), 1e-6, rtol=1e-6)


def test_swapped_surfaces_are_refused():
    with pytest.raises(OptionError, match="are the names swapped"):
        Wall.between(EPI, ENDO)


def test_a_rigid_motion_strains_nothing(rest):
    wall = Wall.between(ENDO, EPI)
    moved = affine(rest, rotation_from_euler(np.array([0.3, 1.0, -0.4])), (5, -2, 30))
    gradient = deformation_gradient(rest, moved, wall.at(0.5))
    assert np.abs(green_strain(gradient)).max() < 1e-12


def test_the_gradient_is_between_frames_not_from_the_undeformed_space(rest):
    one, two = np.diag([1.2, 0.9, 1.0]), np.array([[1.0, 0.3, 0], [0, 1.1, 0], [0.2, 0, 0.8]])
    gradient = deformation_gradient(affine(rest, one), affine(rest, two @ one), Wall.between(ENDO, EPI).at(0.3))
    assert gradient == pytest.approx(np.broadcast_to(two, gradient.shape), abs=1e-12)


def test_radial_is_outward_and_the_axes_are_right_handed(rest):
    wall = Wall.between(ENDO, EPI)
    points = wall.at(0.5)
    axes = local_axes(rest, points, wall.normals_at(0.5), AXIS.direction)
    away = np.abs(points[:, 2]) < 0.9 * np.linalg.norm(points, axis=1)
    radial, around, along = axes[away].transpose(1, 0, 2)
    assert np.einsum("ij,ij->i", radial, points[away]) == pytest.approx(np.linalg.norm(points[away], axis=1))
    assert np.abs(around[:, 2]).max() < 1e-12
    assert (along[:, 2] > 0).all()
    assert np.cross(radial, around) == pytest.approx(along)


def test_strain_of_a_stretch_along_the_axis(rest):
    """At the equator longitudinal is z: lengthening by a tenth is 0.1, and 0.105 after Green."""
    wall = Wall.between(ENDO, EPI)
    points = wall.at(0.5)
    axes = local_axes(rest, points, wall.normals_at(0.5), AXIS.direction)
    strain = in_axes(green_strain(deformation_gradient(rest, affine(rest, np.diag([1, 1, 1.1])), points)), axes)
    equator = np.abs(points[:, 2]) < 1e-9
    assert equator.any()
    assert strain[equator, 2, 2] == pytest.approx(0.105)
    assert relative_lengthening(strain)[equator] == pytest.approx(np.tile([0, 0, 0.1], (equator.sum(), 1)), abs=1e-12)


def test_twist_is_counter_clockwise_from_the_apex(rest):
    """A turn about the axis by 0.002 z radians: the apex turns against the base, whichever way the heart lies."""
    at = rest.rest.reshape(-1, 3)
    wanted = np.stack([at[:, 0] - 0.002 * at[:, 2] * at[:, 1], at[:, 1] + 0.002 * at[:, 2] * at[:, 0], at[:, 2]], 1)
    twisted = rest.with_control_points(np.linalg.solve(rest.matrix(at), wanted))
    reference = ReferenceWall.at(Wall.between(ENDO, EPI), rest, AXIS, None)
    found = reference.slices.twist(twisted)
    assert found.distance == pytest.approx(10)
    assert found.angle == pytest.approx(2 * np.degrees(np.arctan(0.01)), rel=1e-9)
    assert found.angle_per_length == pytest.approx(found.angle / 10)
    assert found.radii == pytest.approx(np.sqrt(12**2 - 5**2), rel=2e-3)
    assert found.shear_angle == pytest.approx(found.angle * found.radii.mean() / 10)
    assert reference.mean(reference.strain(twisted)[..., 1, 2], reference.between_slices()) > 0
    tilted = affine(twisted, rotation_from_euler(np.array([1.2, 0.4, 0.0])), (3, 4, 5))
    assert reference.slices.twist(tilted).angle == pytest.approx(found.angle, rel=1e-6)


def test_a_mirror_image_has_the_opposite_twist(rest):
    at = rest.rest.reshape(-1, 3)
    other = np.stack([at[:, 0] + 0.002 * at[:, 2] * at[:, 1], at[:, 1] - 0.002 * at[:, 2] * at[:, 0], at[:, 2]], 1)
    twisted = rest.with_control_points(np.linalg.solve(rest.matrix(at), other))
    reference = ReferenceWall.at(Wall.between(ENDO, EPI), rest, AXIS, None)
    assert reference.slices.twist(twisted).angle == pytest.approx(-2 * np.degrees(np.arctan(0.01)), rel=1e-9)


def test_a_base_cuts_the_wall_too(rest):
    wall = Wall.between(ENDO, EPI)
    half = ReferenceWall.at(wall, rest, AXIS, BasePlane(np.zeros(3), np.array([0.0, 0, 1])))
    assert half.volumes.sum() == pytest.approx(2 / 3 * np.pi * (14**3 - 10**3), rel=1e-4)


def test_a_leaning_heart_twists_as_an_upright_one():
    """Slices that are not round: the lean must be taken off before angles are compared."""
    endo, epi = Superquadric(semi_axes=(10, 6, 10)), Superquadric(semi_axes=(14, 9, 14))
    box = ControlBox.around(epi)
    at = box.rest.reshape(-1, 3)
    wanted = np.stack([at[:, 0] - 0.01 * at[:, 2] * at[:, 1], at[:, 1] + 0.01 * at[:, 2] * at[:, 0], at[:, 2]], 1)
    twisted = box.with_control_points(np.linalg.solve(box.matrix(at), wanted))
    slices = ReferenceWall.at(Wall.between(endo, epi), box, AXIS, None).slices
    leaning = affine(twisted, rotation_from_euler(np.array([1.2, 0.0, 0.0])), (3, 4, 5))
    assert slices.twist(leaning).angle == pytest.approx(slices.twist(twisted).angle, rel=1e-9)
    assert slices.twist(leaning).apical == pytest.approx(slices.twist(twisted).apical, rel=1e-9)
