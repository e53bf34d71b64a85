"""Points that are connected, and a neighbour in line with a face, which a one-sided body must not grow to."""

import numpy as np
import pytest
from clouds_made import random_directions, seen

from quadriform import fit_superquadric
from quadriform.fitting.connected import components, connection_distance, unconnected
from quadriform.fitting.superquadric import multistart
from quadriform.shapes.superquadric import Superquadric

BOX = Superquadric("ellipsoid", (1.0, 0.9, 0.7), (0.1, 0.1))


def test_a_distance_divides_points_into_components():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3.5, 0, 0]])
    assert components(points, 1.0).tolist() == [0, 0, 0, 1]
    assert len(np.unique(components(points, 1.6))) == 1 and len(np.unique(components(points, 0.5))) == 4


def test_few_points_far_from_the_rest_are_not_connected():
    ball, far = random_directions(2000, 1), 0.1 * random_directions(100, 2) + [1.6, 0, 0]
    points = np.concatenate([ball, far])
    assert (unconnected(points) == (np.arange(2100) >= 2000)).all()
    assert connection_distance(7 * points) == pytest.approx(7 * connection_distance(points))
    assert not unconnected(points[:8]).any()


def test_of_many_points_a_sample_is_asked():
    points = np.concatenate([random_directions(24_000, 1), 0.1 * random_directions(1000, 2) + [1.6, 0, 0]])
    assert (unconnected(points) == (np.arange(25_000) >= 24_000)).all()


def test_slices_are_connected():
    angle, z = np.meshgrid(np.linspace(0, 2 * np.pi, 200, endpoint=False), np.arange(-0.8, 0.9, 0.4))
    radius = np.sqrt(1 - z**2)
    slices = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1).reshape(-1, 3)
    assert not unconnected(slices).any()


def in_line(rng):
    """A box seen from one side, and beyond its hidden end points at the height of its upper face."""
    points = seen(BOX, rng)
    beyond = rng.uniform([-0.9, -1.6, 0], [0.9, -1.3, 0], (400, 3))
    beyond[:, 2] = BOX.semi_axes[2]
    return np.concatenate([points, beyond + 0.02 * rng.normal(size=beyond.shape)])


def largest_error(points):
    found = fit_superquadric(points)
    return np.abs(np.sort(found.superquadric.semi_axes) / np.sort(BOX.semi_axes) - 1).max(), found


def test_a_body_does_not_grow_to_a_neighbour_in_line_with_a_face(rng, monkeypatch):
    points = in_line(rng)
    error, found = largest_error(points)
    assert error < 0.05 and (found.inliers[-400:] < 0.5).all()
    monkeypatch.setattr(multistart, "unconnected", lambda body: np.zeros(len(body), dtype=bool))
    assert largest_error(points)[0] > 0.1
