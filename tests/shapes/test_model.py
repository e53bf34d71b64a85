"""The deformable model: distances, sides, sizes, numbers, several surfaces."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes_made import even_directions, made, single

from quadriform.errors import OptionError, PointsError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric


def sphere(radius=2.0):
    s = Superquadric(semi_axes=(radius,) * 3)
    return single(s, ControlBox.around(s))


def wavy(exponents=(0.8, 1.2), size=0.2, seed=4):
    s = made(exponents=exponents)
    box = ControlBox.around(s)
    noise = np.random.default_rng(seed).normal(size=box.control_points.shape)
    return single(s, box.with_control_points(box.control_points + size * noise))


def test_distance_to_a_sphere(rng):
    points = rng.normal(size=(200, 3)) * 2
    radius = np.linalg.norm(points, axis=1)
    model = sphere()
    np.testing.assert_allclose(model.distance(points), radius - 2, atol=1e-6)
    np.testing.assert_allclose(model.distance(3 * points[radius > 1]), 3 * radius[radius > 1] - 2, rtol=1e-8)
    np.testing.assert_allclose(model.closest(points[radius > 1]), (2 * points / radius[:, None])[radius > 1], atol=1e-4)
    np.testing.assert_array_equal(model.contains(points), radius < 2)


def test_distance_is_the_nearest_of_a_fine_mesh(rng):
    """Never longer than to the nearest of 60,000 vertices, and hardly shorter; foot points lie on the surface."""
    model = wavy()
    fine = model.mesh(resolution=100).vertices
    points = model.deform(made().surface(even_directions(200))) + rng.normal(size=(200, 3)) * 0.3
    nearest = cKDTree(fine).query(points)[0]
    found = np.abs(model.distance(points))
    assert (found <= nearest + 1e-9).all()
    spacing = np.sqrt(model.area() / len(fine))
    assert (np.sqrt(found**2 + spacing**2) >= nearest - 0.1 * spacing).all()
    foot = model.foot_points(points)
    np.testing.assert_allclose(foot.points, model.deform(foot.origins), atol=1e-12)
    np.testing.assert_allclose(model.superquadric().implicit(foot.origins), 1, rtol=1e-9)


def test_foot_points_look_along_the_normal():
    model = wavy()
    on = model.foot_points(model.mesh(resolution=6).vertices)
    lifted = on.points + 0.02 * on.normals
    foot = model.foot_points(lifted)
    np.testing.assert_allclose(foot.signed, 0.02, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(foot.normals, axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(foot.points, on.points, atol=1e-6)
    assert model.contains(on.points - 0.02 * on.normals).all() and not model.contains(lifted).any()


def test_affine_box_scales_volume_by_its_determinant(rng):
    s = made(exponents=(0.8, 1.2))
    matrix = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    box = ControlBox.around(s)
    model = single(s, box.with_control_points(box.control_points @ matrix.T))
    assert model.volume() == pytest.approx(np.linalg.det(matrix) * s.volume(), rel=1e-3)
    assert sphere().volume() == pytest.approx(32 / 3 * np.pi, rel=1e-4)
    assert sphere().area() == pytest.approx(16 * np.pi, rel=1e-4)


def test_counts_of_numbers():
    s, torus = made(), made("toroid")
    assert single(s, ControlBox.around(s)).n_parameters == 386
    assert DeformableModel({"epi": s, "endo": s}, ControlBox.around(s)).n_parameters == 397
    assert single(torus, ControlBox.around(torus)).n_parameters == 387
    assert single(s, ControlBox.around(s, (3, 4, 2))).n_parameters == 11 + 72


def test_surfaces_by_name():
    outer, inner = made(), Superquadric(semi_axes=(1, 1, 1), translation=(1, -2, 0.5))
    model = DeformableModel({"epi": outer, "endo": inner}, ControlBox.around(outer))
    np.testing.assert_allclose(model.mesh("endo", 6).vertices, inner.grid(6)[0], atol=1e-12)
    np.testing.assert_allclose(model.mesh(resolution=6).vertices, outer.grid(6)[0], atol=1e-12)
    assert model.distance([[1.0, -2, 0.5]], "endo")[0] == pytest.approx(-1, rel=1e-6)
    for ask in (model.mesh, model.volume, model.area):
        with pytest.raises(OptionError, match=r"surface='lv'.*'epi', 'endo'"):
            ask("lv")
    with pytest.raises(OptionError, match="at least one"):
        DeformableModel({}, ControlBox.around(outer))


def test_placed_is_the_scaled_shifted_model(rng):
    model, offset = wavy(), np.array([10.0, 20, -5])
    placed = model.transformed(2.0, offset)
    points = rng.normal(size=(50, 3)) * 3
    np.testing.assert_allclose(placed.distance(2 * points + offset), 2 * model.distance(points), atol=1e-7)
    np.testing.assert_allclose(placed.deform(2 * points + offset), 2 * model.deform(points) + offset, atol=1e-11)
    np.testing.assert_allclose(placed.undeform(placed.deform(offset + 0 * points)), offset + 0 * points, atol=1e-9)


def test_torus_distance(rng):
    torus = Superquadric("toroid", (1, 1, 1), hole_radius=2.5)
    points = rng.normal(size=(100, 3)) * 2
    wanted = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 2.5, points[:, 2]) - 1
    np.testing.assert_allclose(single(torus, ControlBox.around(torus)).distance(points), wanted, atol=1e-6)


@pytest.mark.parametrize("call", ["deform", "undeform", "distance", "contains", "closest"])
def test_bad_points_are_refused(call):
    with pytest.raises(PointsError, match="not finite"):
        getattr(sphere(), call)([[0, 0, np.nan]])
