"""Clouds the tests of the refinement are made of: an egg with bumps, a thick-walled cup, noise, outliers, scans."""

import numpy as np
from shapes_made import even_directions

from quadriform.points import unit_vectors


def egg(directions):
    """A lop-sided egg with bumps, about 85 long; no superquadric, but star-shaped."""
    p = directions * np.array([30, 26, 1.0])
    p[:, 2] = np.where(directions[:, 2] < 0, 60, 25) * directions[:, 2]
    return p + 2.5 * np.sin(p[:, [1, 2, 0]] / 10 + [0.3, 1.0, 2.0])


def random_directions(n, seed):
    u = np.random.default_rng(seed).normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def noisy_egg(n=1000, noise=1.0, seed=3):
    return egg(random_directions(n, seed)) + noise * np.random.default_rng(seed + 1).normal(size=(n, 3))


EGG = egg(even_directions(1500))
"""Points of the true surface."""


def with_outliers(points, count, seed=5):
    """The last `count` points thrown anywhere into 1.3 times the cloud's own extent."""
    middle, half = (points.max(axis=0) + points.min(axis=0)) / 2, np.ptp(points, axis=0) / 2
    result = points.copy()
    result[-count:] = middle + 1.3 * half * np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    return result


def error(model, truth=EGG):
    """RMS distance of true surface points to a model."""
    return np.sqrt((model.distance(truth) ** 2).mean())


def cup(n, wall=5.0, seed=0):
    """Two half ellipsoids joined by a round rim, evenly sampled by area, and the normals out of the solid wall."""
    rim = np.linspace(0, np.pi, 60)
    bottom = np.linspace(-np.pi / 2, 0, 300)
    outer = np.column_stack([30 * np.cos(bottom), 60 * np.sin(bottom)])
    inner = np.column_stack([(30 - wall) * np.cos(bottom), (60 - wall) * np.sin(bottom)])[::-1]
    top = np.column_stack([30 - wall / 2 + wall / 2 * np.cos(rim), wall / 2 * np.sin(rim)])
    profile = np.concatenate([outer[:-1], top, inner[1:]])
    step = np.diff(profile, axis=0)
    middle = (profile[1:] + profile[:-1]) / 2
    across = np.column_stack([step[:, 1], -step[:, 0]]) / np.linalg.norm(step, axis=1, keepdims=True)
    area = np.cumsum(np.linalg.norm(step, axis=1) * middle[:, 0])
    place = np.searchsorted(area, (np.arange(n) + 0.5) / n * area[-1])
    angle = np.pi * (1 + 5**0.5) * np.arange(n) + np.random.default_rng(seed).normal(0, 0.02, n)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.column_stack([middle[place, :1] * around, middle[place, 1]])
    return points, np.column_stack([across[place, :1] * around, across[place, 1]])


EYE = np.array([5.0, 6.0, 4.0])
NOISE = 0.02
"""Along the ray."""


def seen(truth, rng, count=5000):
    """Points (n, 3) of the side of a superquadric that faces an eye, with noise along the ray."""
    around = rng.uniform(-1, 1, (8 * count, 3))
    around[np.arange(len(around)), rng.integers(0, 3, len(around))] = rng.choice([-1.0, 1.0], len(around))
    points = truth.surface(truth.semi_axes * around @ truth.rotation.T)
    ray = unit_vectors(points - EYE)
    facing = np.einsum("ij,ij->i", ray, truth.gradient(points)) < 0
    return (points + NOISE * rng.normal(size=(len(points), 1)) * ray)[facing][:count]
