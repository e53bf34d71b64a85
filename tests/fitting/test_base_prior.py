"""Beyond a base nothing is measured: a body closes there near the plane, and below it the data alone is followed."""

from dataclasses import replace

import numpy as np
import pytest

import quadriform as qf
from quadriform.fitting.refinement.base_prior import CLOSURE, BasePrior
from quadriform.fitting.refinement.large_clouds import LARGE
from quadriform.shapes.control_box import common_box

UP = np.array([0.0, 0.0, 1.0])
RADIUS = 30.0


def tube(count: int, height: float, sigma: float, seed: int = 1) -> np.ndarray:
    """Points with noise of a tube of radius 30 with a round apex, open at z = height."""
    random = np.random.default_rng(seed)
    z, around = random.uniform(-1, height / RADIUS, count), random.uniform(0, 2 * np.pi, count)
    radius = np.sqrt(1 - np.minimum(z, 0) ** 2)
    points = RADIUS * np.column_stack([radius * np.cos(around), radius * np.sin(around), z])
    return points + sigma * random.normal(size=points.shape)


def distances(points: np.ndarray) -> np.ndarray:
    """Of points to the true tube."""
    along = np.column_stack([points[:, :2], np.minimum(points[:, 2], 0)])
    return np.linalg.norm(along, axis=1) - RADIUS


@pytest.mark.parametrize(("height", "sigma"), [(15.0, 0.3), (60.0, 1.0)])
def test_an_open_tube_closes_near_its_base(height, sigma):
    """Without the prior these reach 25 mm and more beyond the base."""
    base = (height * UP, UP)
    cloud = tube(2000, height, sigma)
    fit = qf.fit(cloud, base=base)
    vertices = fit.model.mesh(resolution=24).vertices
    size = np.sqrt(((cloud - cloud.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert vertices[:, 2].max() - height < 1.5 * CLOSURE.allowed_height * size
    wall = vertices[(vertices[:, 2] < height - 2) & (np.hypot(*vertices[:, :2].T) > RADIUS / 2)]
    assert np.sqrt((distances(wall) ** 2).mean()) < 0.35 * sigma


def test_exact_points_are_followed_as_if_there_were_no_base():
    """A prior is weighed against the noise, and there is none: the whole ellipsoid is found from its lower part."""
    body = qf.Superquadric(semi_axes=(20, 25, 40), exponents=(1, 1))
    points = body.mesh(20).vertices
    fit = qf.refine(body, points[points[:, 2] < 15], base=(15 * UP, UP))
    assert np.abs(body.first_order_distance(fit.model.mesh(resolution=8).vertices)).max() < 1e-6 * 40


def test_the_prior_leaves_sigma_open():
    """What is expected was not measured: far beyond the base the reported uncertainty is that of no data."""
    fit = qf.fit(tube(800, 15, 0.5), base=(15 * UP, UP), box=(4, 4, 4))
    vertices = fit.model.mesh(resolution=12).vertices
    top, wall = vertices[:, 2].argmax(), vertices[:, 2] < 0
    sigma = fit.uncertainty(vertices)
    assert sigma[top] > 5 * np.median(sigma[wall])


def test_all_points_of_a_large_cloud_keep_the_base(monkeypatch):
    """More points than are fitted at once: the base was forgotten in the rounds on all of them."""
    small = replace(LARGE, many=1000, sample=800)
    monkeypatch.setattr("quadriform.fitting.refinement.large_clouds.LARGE", small)
    fit = qf.fit(tube(2000, 15, 0.5), base=(15 * UP, UP), box=(4, 4, 4))
    assert fit.n_points == 2000
    assert fit.model.mesh(resolution=16).vertices[:, 2].max() - 15 < 10


def test_the_equations_are_those_of_the_cost():
    """At the box itself, and for a step that leaves the same points above the allowed height."""
    body = qf.Superquadric(semi_axes=(0.6, 0.7, 1.2), exponents=(0.8, 1.0))
    box = common_box({"body": body}, (4, 4, 4))
    step = 1e-3 * np.random.default_rng(0).normal(size=box.control_points.shape)
    penalty = BasePrior(body, (0.3 * UP, UP), 2.0)
    moved = box.with_control_points(box.control_points + step)
    assert penalty.cost(box) > 0.01
    assert penalty.equations(box).squares(np.zeros((64, 3))) == pytest.approx(penalty.cost(box), rel=1e-9)
    # fractions of the area change as well, which the equations leave out: they are of second order in the heights
    assert penalty.equations(box).squares(step.reshape(-1, 3)) == pytest.approx(penalty.cost(moved), rel=1e-2)
    assert BasePrior(body, (1.2 * UP, UP), 2.0).cost(box) == 0
