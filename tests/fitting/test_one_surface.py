"""Points of several bodies, of both sides of a wall, and from the inside of a volume are not of one surface."""

import numpy as np
import pytest
from clouds_made import noisy_egg, random_directions
from shapes_made import even_directions, lumpy, turned

import quadriform as qf
from quadriform.fitting.support import closed_bodies, deep_fraction, layered_fraction
from quadriform.fitting.support_settings import ONE

SPHERE = random_directions(600, 1)
LIMIT = 0.2


def noise(scale, count=600, seed=2):
    return scale * np.random.default_rng(seed).normal(size=count)


def test_bodies_apart_are_counted():
    assert closed_bodies(SPHERE, LIMIT) == 1
    assert closed_bodies(np.vstack([SPHERE, np.add(SPHERE, [3.0, 0, 0])]), LIMIT) == 2
    three = np.vstack([SPHERE * [1, 2, 3], np.add(SPHERE, [5.0, 0, 0]), np.add(SPHERE, [0, 6.0, 1])])
    assert closed_bodies(7 * three @ turned(5).T, 7 * LIMIT) == 3


def test_bodies_that_touch_count_as_one():
    assert closed_bodies(np.vstack([SPHERE, np.add(SPHERE, [2.1, 0, 0])]), LIMIT) < 2


@pytest.mark.parametrize("middle", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("axes", [(1, 1, 1), (1, 1, 3), (3, 2, 1)])
def test_the_two_ends_of_one_body_are_no_two_bodies(middle, axes):
    points = random_directions(3000, 3) * axes
    ends = points[np.abs(points[:, 2]) > middle * axes[2]]
    assert closed_bodies(ends, 0.1 * min(axes)) < 2


def test_slices_and_outliers_are_no_bodies():
    points = random_directions(20_000, 4)
    slices = points[np.abs((points[:, 2] * 4 + 0.5) % 1 - 0.5) < 0.01]
    assert closed_bodies(slices, 0.75 * 0.25) < 2
    assert closed_bodies(np.vstack([SPHERE, 4 * SPHERE[:30] / 3 + 9]), LIMIT) == 1
    assert closed_bodies(SPHERE[:1], LIMIT) == closed_bodies(SPHERE[:20], 9.0) == 0
    flat = np.vstack([SPHERE * [1, 1, 0], SPHERE * [1, 1, 0] + [9, 0, 0]])
    assert closed_bodies(flat, LIMIT) == 0


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("outer", [300, 400])
def test_two_layers_are_found(sigma, outer):
    radii = np.repeat([1.0, 0.8], [outer, 600 - outer]) + noise(sigma)
    assert layered_fraction(SPHERE, radii - 0.9, 1.0) > 0.7


@pytest.mark.parametrize("sigma", [0.01, 0.05, 0.2])
def test_noise_is_one_layer(sigma):
    assert layered_fraction(SPHERE, noise(sigma), 1.0) < 0.1
    even = np.random.default_rng(5).uniform(-sigma, sigma, 600)
    assert layered_fraction(SPHERE, 2 * even, 1.0) < 0.2


def test_thin_layers_and_few_points_are_none():
    steps = np.repeat([-0.03, 0.03], 300)  # as of voxels
    assert layered_fraction(SPHERE, steps, 1.0) == 0
    assert layered_fraction(SPHERE[: ONE.neighbours - 1], steps[: ONE.neighbours - 1], 1.0) == 0


def test_a_filled_ball_is_deep_and_a_noisy_one_is_not():
    radii = np.cbrt(np.random.default_rng(6).uniform(size=600))
    thickness = 2 / 3  # 2 V / A of a ball
    assert deep_fraction(radii - 1, thickness) == pytest.approx((1 - 2 / 9) ** 3, abs=0.06)
    assert deep_fraction(noise(0.08), thickness) < 0.03 and deep_fraction(np.empty(0), thickness) == 0


CLOUD = lumpy(600)
NOT_ONE = {
    "bodies": (np.vstack([SPHERE[:300], np.add(SPHERE[300:], [4.0, 0, 0])]), "SEVERAL_BODIES"),
    "wall": (np.vstack([0.8 * CLOUD[:300], CLOUD[300:]]), "DOUBLE_WALL"),
    "filled": (CLOUD * np.cbrt(np.random.default_rng(7).uniform(size=(600, 1))), "FILLED_VOLUME"),
}


@pytest.mark.parametrize("case", NOT_ONE)
def test_a_fit_of_what_is_no_surface_is_unreliable(case):
    points, kind = NOT_ONE[case]
    found = qf.fit(points, box=(3, 3, 3), strength=1e-4)
    assert found.status == "unreliable" and kind in found.warnings
    with pytest.raises(qf.errors.FitError, match=kind):
        found.require_usable()


@pytest.mark.parametrize("points", [CLOUD, noisy_egg(), 9 * even_directions(400)], ids=["lumpy", "noisy", "ball"])
def test_a_surface_is_one(points):
    found = qf.fit(points, box=(3, 3, 3))
    assert found.status == "ok"
