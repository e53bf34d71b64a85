"""The search beside the ridges of exponents above 1; that it finds the nearest points is in `test_closest.py`."""

import numpy as np
import pytest

from quadriform.shapes import ridges
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.ridges import _Search
from quadriform.shapes.superquadric import Superquadric


@pytest.mark.parametrize("at_once", [1, 1000])
def test_how_many_trials_are_made_at_once_does_not_matter(at_once, rng, monkeypatch):
    surface = Superquadric(semi_axes=(3.0, 2.0, 4.0), exponents=(1.7, 1.3))
    box = ControlBox.around(surface, (3, 3, 3))
    bent = box.with_control_points(box.control_points + rng.normal(0, 0.2, (3, 3, 3, 3)))
    targets = 3 * rng.normal(size=(60, 3))
    targets[:20, 2] = targets[20:40, 0] = 0
    found = closest_on(surface, bent, targets)
    monkeypatch.setattr(ridges, "AT_ONCE", at_once)
    again = closest_on(surface, bent, targets)
    np.testing.assert_array_equal(again.origins, found.origins)


def test_steps_towards_a_plane_grow(monkeypatch):
    """There the distance is an exponential of the logarithms, on which all Newton steps are equally short."""
    surface = Superquadric(semi_axes=(20.0, 30.0, 40.0), exponents=(1.007, 1.001))
    box = ControlBox.around(surface, (3, 3, 3))
    angles = np.linspace(0.3, 1.2, 10)
    targets = np.stack([20 * np.cos(angles), 30 * np.sin(angles), 0 * angles], axis=1) * 1.001
    steps, one = [], _Search._step
    monkeypatch.setattr(_Search, "_step", lambda self, *given: steps.append(len(given[0])) or one(self, *given))
    search = _Search(surface, box, targets, np.ones((10, 4)))
    found = search.points(search.least(np.stack([np.log(1.5 * np.tan(angles)), np.full(10, -5.0)], axis=1)))
    assert np.abs(found[:, 2]).max() < 1e-6
    assert 0 < len(steps) < 16
