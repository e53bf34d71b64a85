"""Derivatives of F by the point and by every parameter; the log domain; places where F has a corner."""

import numpy as np
import pytest
from shapes_made import KINDS, made

from quadriform.shapes.superquadric import Superquadric

EXPONENTS = [(1.0, 1.0), (0.6, 1.4), (0.3, 0.3), (1.8, 0.7)]
CALLS = ("implicit", "gradient", "parameter_derivatives", "project", "first_order_distance")


def scattered(superquadric, seed=3):
    """Points inside, on and outside the surface, none near a coordinate plane of its frame."""
    rng = np.random.default_rng(seed)
    signs, sizes = rng.choice([-1.0, 1.0], (60, 3)), rng.uniform(0.2, 1.0, (60, 3))
    reach = superquadric.semi_axes * (2.0 + 1.3 * (superquadric.hole_radius or 0.0) * np.array([1, 1, 0]))
    return superquadric.translation + (signs * sizes * reach) @ superquadric.rotation.T


def slope(function, step):
    """Derivative at 0 by central differences, extrapolated by Richardson."""
    wide, narrow = ((function(h) - function(-h)) / (2 * h) for h in (step, step / 2))
    return (4 * narrow - wide) / 3


def assert_slopes(found, wanted):
    """Within 1e-6 of each value; values a thousand times below the largest are held to its scale."""
    assert np.abs(wanted).max() > 0.01
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("exponents", EXPONENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_gradient(kind, exponents):
    s = made(kind, exponents)
    points = scattered(s)
    wanted = np.stack([slope(lambda h, a=a: s.implicit(points + h * np.eye(3)[a]), 1e-3) for a in range(3)], axis=1)
    assert_slopes(s.gradient(points), wanted)


@pytest.mark.parametrize("exponents", EXPONENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_parameter_derivatives(kind, exponents):
    s = made(kind, exponents)
    points = scattered(s)
    value, found = s.parameter_derivatives(points)
    np.testing.assert_allclose(value, s.implicit(points), rtol=1e-14)
    p = s.parameters
    assert found.shape == (len(points), 12 if kind == "toroid" else 11) == (len(points), len(p))
    for k in range(len(p)):
        wanted = slope(lambda h, k=k: s.with_parameters(p + h * np.eye(len(p))[k]).implicit(points), 1e-3)
        assert_slopes(found[:, k], wanted)


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_round_trip(kind):
    s = made(kind)
    again = s.with_parameters(s.parameters)
    np.testing.assert_allclose(again.parameters, s.parameters, rtol=1e-14)
    np.testing.assert_allclose(again.rotation, s.rotation, atol=1e-15)
    assert (again.kind, again.height, again.hole_radius) == (s.kind, s.height, s.hole_radius)


@pytest.mark.parametrize("exponents", [*EXPONENTS, (0.01, 0.01), (2.0, 2.0), (0.01, 2.0)])
@pytest.mark.parametrize("kind", KINDS)
def test_finite_where_f_has_a_corner_and_far_away(kind, exponents):
    """On planes, axes and at the centre, at 1e20 and next to nothing; also for callers who let NumPy raise."""
    s = made(kind, exponents)
    unit = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 1.3, 0.4], [0.5, 0, 2.0], [1, 1, 0], [0, 0, 1e-200]]
    )
    corners = s.translation + (unit * s.semi_axes) @ s.rotation.T
    far = 1e20 * np.array([[1, 1, -1], [1, 0, 0], [0, 0, 1], [-1, 1e-10, 1]])
    plain = Superquadric(kind, exponents=exponents, hole_radius=s.hole_radius, height=s.height)
    for shape, points in ((s, corners), (s, far), (plain, unit), (plain, far)):
        with np.errstate(all="raise"):
            for call in CALLS:
                result = getattr(shape, call)(points)
                for array in result if isinstance(result, tuple) else (result,):
                    assert np.isfinite(array).all(), call


def test_log_domain_keeps_the_value():
    """F is of degree one, and the largest |coordinate| / semi-axis where the shape is nearly a box."""
    box = made(exponents=(0.01, 0.01))
    local = np.array([[0.3, -0.2, 0.9], [0.5, 1.2, 0.1], [-2.0, 0.4, 1.0]])
    points = (local * box.semi_axes) @ box.rotation.T
    for size in (1e-20, 1.0, 1e20):
        f = Superquadric(semi_axes=box.semi_axes, exponents=box.exponents, rotation=box.rotation).implicit(
            size * points
        )
        np.testing.assert_allclose(f, size * np.abs(local).max(axis=1), rtol=1e-12)
