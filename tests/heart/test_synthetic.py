"""The synthetic ventricle against the formulas of its module, written out point by point."""

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.heart.synthetic import CENTRE, ROTATION, SyntheticVentricle

HEART = SyntheticVentricle()


def moved(x, y, z, time):
    """The polynomial motion of the module."""
    s = np.sin(np.pi * time) ** 2
    b0, b1, m = 0.525, 3.86e-4, 0.36
    f = (1 + 0.002 * z) * (1 - s * b0 + s * b1 * (x * x + y * y + m * z * z))
    psi = s * (0.02 + 0.004 * z)
    return f * (x - psi * y), f * (y + psi * x), z * (1 - s * 0.24 + s * 6.5e-5 * z * z)


@pytest.mark.parametrize("time", [0.0, 0.2, 0.5])
def test_points_move_as_the_formulas_say(time, rng):
    local = rng.uniform(-30, 30, (20, 3))
    expected = np.array([moved(*row, time) for row in local])
    np.testing.assert_allclose(HEART.local_positions(local, time), expected, rtol=1e-12, atol=1e-12)
    world = HEART.positions(local @ ROTATION.T + CENTRE, time)
    np.testing.assert_allclose((world - CENTRE) @ ROTATION, expected, rtol=1e-9, atol=1e-9)
    rho = np.hypot(local[:, 0], local[:, 1])
    np.testing.assert_allclose(np.abs(HEART.radius(rho, local[:, 2], time)), np.hypot(*expected[:, :2].T), rtol=1e-9)
    np.testing.assert_allclose(HEART.height(local[:, 2], time), expected[:, 2], rtol=1e-12)
    turned = np.arctan2(expected[:, 1], expected[:, 0]) - np.arctan2(local[:, 1], local[:, 0])
    factor = HEART.scale(rho**2, local[:, 2], time)
    found = HEART.angle(local[:, 2], time) + np.where(factor < 0, np.pi, 0)
    np.testing.assert_allclose(np.cos(turned - found), 1, rtol=1e-9)


@pytest.mark.parametrize("time", [0.0, 0.3, 0.5])
def test_the_model_is_exact_everywhere(time, rng):
    points = rng.uniform(-25, 25, (30, 3)) @ ROTATION.T + CENTRE
    model = HEART.model(time)
    np.testing.assert_allclose(model.deform(points), HEART.positions(points, time), rtol=1e-9)
    assert (model.space, model.unit, list(model.surfaces)) == ("LPS", "mm", ["epi", "endo"])
    assert [len(HEART.models([0.0, 0.5])), len(HEART.models(0.2))] == [2, 1]


@pytest.mark.parametrize(("name", "across", "along"), [("endo", 24.0, 44.0), ("epi", 34.0, 53.0)])
def test_points_of_a_surface_are_even_before_deformation(name, across, along):
    n = 100
    points = (HEART.surface_points(name, 0.0, n) - CENTRE) @ ROTATION
    z = points[:, 2]
    np.testing.assert_allclose(z, along * (1 - (2 * np.arange(n) + 1) / n), rtol=1e-9, atol=1e-9)
    egg = points[:, :2] / (1 + 0.002 * z)[:, None]
    np.testing.assert_allclose((egg**2).sum(axis=1) / across**2 + z**2 / along**2, 1, rtol=1e-9)
    steps = np.diff(np.unwrap(np.arctan2(points[:, 1], points[:, 0])))
    np.testing.assert_allclose(np.cos(steps), np.cos(np.pi * (3 - 5**0.5)), rtol=1e-9)
    noisy = HEART.surface_points(name, 0.0, n, 0.5, 3)
    expected = 0.5 * np.random.default_rng(3).normal(size=(n, 3))
    np.testing.assert_allclose(noisy - HEART.surface_points(name, 0.0, n), expected, atol=1e-9)
    assert HEART.semi_axes(name) == (across, along)
    with pytest.raises(OptionError):
        HEART.semi_axes("rv")


@pytest.mark.parametrize("fraction", [0.8, 0.6])
def test_mitral_points_lie_on_the_endocardium_at_a_fraction_of_its_length(fraction):
    local = (HEART.mitral_points(0.0, fraction, 6) - CENTRE) @ ROTATION
    np.testing.assert_allclose(local[:, 2], -44 + 88 * fraction, rtol=1e-9)
    ring = local[:, :2] / (1 + 0.002 * local[:, 2:])
    np.testing.assert_allclose((ring**2).sum(axis=1) / 24**2 + (local[:, 2] / 44) ** 2, 1, rtol=1e-9)
    angles = np.arctan2(local[:, 1], local[:, 0])
    np.testing.assert_allclose(np.cos(angles - 2 * np.pi * np.arange(6) / 6), 1, rtol=1e-12)
    np.testing.assert_allclose(np.sin(angles - 2 * np.pi * np.arange(6) / 6), 0, atol=1e-9)
    later = (HEART.mitral_points(0.5, fraction, 6) - CENTRE) @ ROTATION
    undeformed = np.column_stack([ring, local[:, 2]])
    np.testing.assert_allclose(later, [moved(*row, 0.5) for row in undeformed], rtol=1e-9, atol=1e-9)
    point, direction = HEART.base_plane(fraction)
    np.testing.assert_allclose((HEART.mitral_points(0.0, fraction) - point) @ direction, 0, atol=1e-9)
    np.testing.assert_allclose(direction, ROTATION[:, 2])
    assert HEART.activation(0.5) == 1 and HEART.activation(0.25) == pytest.approx(0.5)
