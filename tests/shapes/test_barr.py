"""Barr's tapering, twisting and bending: what each keeps."""

import numpy as np
import pytest
from shapes_made import even_directions

from quadriform.errors import PointsError
from quadriform.shapes import barr
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric


def determinants(function, points, h=1e-5):
    columns = [(function(points + h * axis) - function(points - h * axis)) / (2 * h) for axis in np.eye(3)]
    return np.linalg.det(np.stack(columns, axis=2))


def test_taper_scales_the_cross_sections_linearly():
    ring = np.array([[1.0, 2, 0], [1, 2, 4], [1, 2, -4], [1, 2, 2]])
    np.testing.assert_allclose(
        barr.taper(ring, (0.5, -0.25), 4.0), [[1, 2, 0], [1.5, 1.5, 4], [0.5, 2.5, -4], [1.25, 1.75, 2]]
    )


def test_taper_is_undone_by_the_inverse_scale(rng):
    points = rng.uniform(-1, 1, (50, 3))
    tapered = barr.taper(points, (0.4, 0.4), 1.0)
    np.testing.assert_allclose(tapered[:, :2] / (1 + 0.4 * tapered[:, 2:]), points[:, :2], rtol=1e-13)
    np.testing.assert_allclose(
        determinants(lambda p: barr.taper(p, (0.4, 0.4), 1.0), points), (1 + 0.4 * points[:, 2]) ** 2
    )


def test_twist_keeps_volume_and_distance_from_the_axis(rng):
    points = rng.normal(size=(50, 3))
    twisted = barr.twist(points, 0.7)
    np.testing.assert_allclose(np.hypot(*twisted[:, :2].T), np.hypot(*points[:, :2].T), rtol=1e-13)
    np.testing.assert_allclose(determinants(lambda p: barr.twist(p, 0.7), points), 1, rtol=1e-8)
    np.testing.assert_allclose(barr.twist(twisted, -0.7), points, atol=1e-14)
    mesh = Superquadric(semi_axes=(3, 2, 4)).mesh(80)
    assert Mesh(barr.twist(mesh.vertices, 0.3), mesh.faces).volume() == pytest.approx(mesh.volume(), rel=2e-3)


def test_twist_turns_by_rate_times_height():
    np.testing.assert_allclose(barr.twist([[1.0, 0, 2.0]], np.pi / 4), [[0, 1, 2]], atol=1e-15)


def test_bend_keeps_the_length_of_the_axis_and_makes_it_a_circle():
    z = np.linspace(-3, 3, 20001)
    bent = barr.bend(np.column_stack([0 * z, 0 * z, z]), 0.25)
    assert np.linalg.norm(np.diff(bent, axis=0), axis=1).sum() == pytest.approx(6, rel=1e-8)
    np.testing.assert_allclose(np.linalg.norm(bent - [4, 0, 0], axis=1), 4, rtol=1e-13)
    np.testing.assert_allclose(bent[10000], 0, atol=1e-15)


def test_bend_keeps_cross_sections_and_squeezes_the_inner_side(rng):
    points = rng.uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(determinants(lambda p: barr.bend(p, 0.25), points), 1 - 0.25 * points[:, 0], rtol=1e-8)
    np.testing.assert_array_equal(barr.bend(points, 0), points)
    np.testing.assert_allclose(barr.bend(points, 1e-7), points, atol=1e-6)


def test_three_crossing_superquadrics_under_one_taper():
    """The paper's Fig. 3: three crossing bodies under one global taper still cross where they did."""
    shapes = [Superquadric(semi_axes=np.roll((4, 1, 1), k), exponents=(1, 0.5)) for k in range(3)]
    d = even_directions(400)
    tapered = [barr.taper(shape.surface(d), (0.3, 0.3), 4.0) for shape in shapes]
    for shape, points in zip(shapes, tapered):
        undone = np.column_stack([points[:, :2] / (1 + 0.3 * points[:, 2:] / 4), points[:, 2]])
        np.testing.assert_allclose(shape.implicit(undone), 1, rtol=1e-9)
        others = [other.implicit(undone) for other in shapes if other is not shape]
        assert all((f < 1).any() and (f > 1).any() for f in others)  # each runs through both others


@pytest.mark.parametrize(
    "deform", [lambda p: barr.taper(p, (1, 1), 1), lambda p: barr.twist(p, 1), lambda p: barr.bend(p, 1)]
)
def test_bad_points_are_refused(deform):
    with pytest.raises(PointsError, match="not finite"):
        deform([[np.nan, 0, 0]])
