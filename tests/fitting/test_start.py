"""Starts: the moments of inertia (P12 to P14), where they are exact and where not; the other kinds' starts."""

import numpy as np
import pytest
from shapes_made import SKEW, even_directions, made, turned

from quadriform.errors import DegenerateError
from quadriform.fitting.superquadric.initial import (
    NOT_RADIAL,
    STARTS,
    ellipsoid_by_moments,
    hyperboloid_by_quadric,
    principal_frame,
    starts_not_radial,
    toroid_by_moments,
)
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric

EVEN = sphere_grid(6)[0]  # unchanged by every turn of the cube, so its second moments are exactly 1/3 each


def test_the_even_points_are_even():
    np.testing.assert_allclose(EVEN.T @ EVEN / len(EVEN), np.eye(3) / 3, atol=1e-14)
    np.testing.assert_allclose(EVEN.mean(axis=0), 0, atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_moments_are_exact_on_an_affine_image_of_even_points_of_a_sphere(seed):
    """P14, held as the surface: its points and no others have F = 1."""
    rng = np.random.default_rng(seed)
    matrix, shift = rng.normal(size=(3, 3)) + 2 * np.eye(3), 10 * rng.normal(size=3)
    found = ellipsoid_by_moments(EVEN @ matrix.T + shift)
    np.testing.assert_allclose(found.implicit(even_directions(200) @ matrix.T + shift), 1, rtol=1e-9)
    np.testing.assert_allclose(np.sort(found.semi_axes), np.sort(np.linalg.svd(matrix, compute_uv=False)), rtol=1e-9)


def test_moments_are_not_exact_on_even_points_of_a_long_ellipsoid():
    """Points even in area, not in the sphere's direction: the long axis comes out shorter by more than 5 %."""
    mesh = Superquadric(semi_axes=(1, 1, 5)).mesh(40)
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    copies = np.maximum(1, (areas / areas.min()).round().astype(int))
    even = np.repeat(mesh.vertices[mesh.faces].mean(axis=1), copies, axis=0)
    sizes = np.sort(ellipsoid_by_moments(even).semi_axes)
    assert sizes[2] < 0.95 * 5
    assert sizes[0] > 1.02


def test_inertia_is_p12(rng):
    """Mass 1: the sum over the points of |x|^2 I - x x^T, divided by their number."""
    points = rng.normal(size=(40, 3)) * [1, 2, 3] + 5
    offset = points - points.mean(axis=0)
    inertia = sum(p @ p * np.eye(3) - np.outer(p, p) for p in offset) / len(points)
    centre, axes, moments = principal_frame(points)
    np.testing.assert_allclose(centre, points.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(axes.T @ inertia @ axes, np.diag(moments), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert moments[0] >= moments[1] >= moments[2]  # the longest extent, the least inertia, is last


@pytest.mark.parametrize("seed", range(8))
def test_principal_frame_turns_with_the_points(seed, rng):
    points = rng.gamma(2.0, size=(200, 3)) * [1, 2, 3]
    turn = turned(seed)
    centre, axes, moments = principal_frame(points)
    again = principal_frame(points @ turn.T + 7)
    np.testing.assert_allclose(again[0], turn @ centre + 7, rtol=1e-12)
    np.testing.assert_allclose(again[1], turn @ axes, atol=1e-10)
    np.testing.assert_allclose(again[2], moments, rtol=1e-10)


def test_round_torus_start_is_exact_on_its_even_points():
    torus = Superquadric("toroid", (1, 1, 1), rotation=SKEW, translation=(1, 2, 3), hole_radius=3)
    found = toroid_by_moments(torus.grid(12)[0])
    np.testing.assert_allclose(found.semi_axes, 1, rtol=1e-9)
    assert found.hole_radius == pytest.approx(3, rel=1e-9)
    np.testing.assert_allclose(np.abs(found.rotation[:, 2] @ SKEW[:, 2]), 1, rtol=1e-12)


@pytest.mark.parametrize("kind", ["hyperboloid1", "hyperboloid2"])
def test_quadric_start_is_exact_on_quadrics(kind):
    s = made(kind, (1, 1))
    found = hyperboloid_by_quadric(s.grid(8)[0], kind)
    np.testing.assert_allclose(s.implicit(found.grid(6)[0]), 1, rtol=1e-9)
    assert found.height == pytest.approx(s.height, rel=1e-9)


def test_points_of_an_ellipsoid_are_no_hyperboloid():
    points = made(exponents=(1, 1)).surface(even_directions(300))
    with pytest.raises(DegenerateError, match=r"hyperboloid1.*try 'ellipsoid'"):
        hyperboloid_by_quadric(points, "hyperboloid1")


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_its_start(kind):
    points = made(kind, (1, 1)).grid(6)[0]
    assert STARTS[kind](points).kind == kind
    assert (kind in NOT_RADIAL) == (not KINDS[kind].is_radial)
    assert {found.kind for found in NOT_RADIAL.get(kind, lambda _: [])(points)} <= {kind}


def test_a_kind_without_starts_is_not_taken_for_another(rng):
    with pytest.raises(KeyError, match="a fifth"):
        starts_not_radial(rng.normal(size=(50, 3)), "a fifth")


@pytest.mark.parametrize("kind", ["toroid", "hyperboloid1"])
def test_the_second_half_of_the_starts_of_a_kind_is_the_first_rotated_by_45_degrees(kind):
    """About z; the mean of both squared semi-axes across it, the semi-axis along it and the rest stay."""
    points = made(kind, semi_axes=(20.0, 12.0, 9.0)).mesh(16).vertices
    starts = starts_not_radial(points, kind)
    half = len(starts) // 2
    turned_by = np.swapaxes(starts.rotations[:half], 1, 2) @ starts.rotations[half:]
    diagonal = np.array([1.0, 1.0]) / np.sqrt(2)
    np.testing.assert_allclose(np.abs(turned_by[:, :2, 0]), np.tile(diagonal, (half, 1)), atol=1e-12)
    axes = np.exp(starts.log_axes)
    squared = (axes[:half, :2] ** 2).mean(axis=1)
    np.testing.assert_allclose(axes[half:, :2] ** 2, np.column_stack([squared, squared]), rtol=1e-9)
    np.testing.assert_allclose(axes[half:, 2], axes[:half, 2])
    for one in (starts.exponents, starts.translations, starts.log_holes):
        np.testing.assert_allclose(one[half:], one[:half])
