"""Smooth bodies without files, points on parts of them, and noise of five types; all by the number of the case."""

from dataclasses import dataclass

import numpy as np

import quadriform as qf

PATTERNS = ("whole", "slices", "caps", "strips", "holes")
NOISES = ("isotropic", "anisotropic", "correlated", "heavy-tailed", "outliers")
HALF_LENGTH = 50.0
RESOLUTION = 48
DENSE = 200_000
"""Points on the whole surface, from which those of a pattern are drawn."""
SPACINGS = 2.0
"""A surface with data has a point within so many mean spacings, or within one slice distance. The points of slices
stand for the whole surface, which a few of them, spread over many slices, sample no more closely than that."""


@dataclass(frozen=True)
class Observed:
    """Points of one case.

    Attributes:
        truth: the whole surface.
        points: (n, 3), noise included.
        noise: standard deviation of one coordinate, outliers left out.
        reach: how far from its nearest point a part of the surface is still one with data.
        radius: of the ball of the body's volume.
    """

    truth: qf.Mesh
    points: np.ndarray
    noise: float
    reach: float
    radius: float


def body(rng: np.random.Generator) -> qf.Mesh:
    """An ellipsoid of random proportions with a taper, a bend and four bumps; its long axis is z."""
    ball = qf.Superquadric().mesh(RESOLUTION)
    p = ball.vertices * (HALF_LENGTH * np.array([*rng.uniform(0.4, 0.9, 2), 1.0]))
    height = p[:, 2:] / HALF_LENGTH
    p = p * (1 + rng.uniform(-0.25, 0.25) * height * np.array([1, 1, 0]))
    p = p + rng.uniform(-6, 6) * height**2 * np.array([1, 0, 0])
    for _ in range(4):
        centre, direction = p[rng.integers(len(p))], rng.normal(size=3)
        height = rng.uniform(1, 4) * direction / np.linalg.norm(direction)
        p = p + np.exp(-((p - centre) ** 2).sum(axis=1) / (2 * rng.uniform(12, 20) ** 2))[:, None] * height
    return qf.Mesh(p, ball.faces)


def sampled(mesh: qf.Mesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random points (n, 3), even over the area."""
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    triangle = rng.choice(len(areas), count, p=areas / areas.sum())
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    return np.einsum("kc,kcx->kx", weights, mesh.vertices[mesh.faces][triangle])


def observed(number: int) -> Observed:
    """The case of a number; 25 numbers in turn have all pairs of pattern and noise."""
    rng = np.random.default_rng([2029, number])
    pattern, noise = PATTERNS[number % 5], NOISES[number // 5 % 5]
    truth = body(rng)
    radius, dense = float(np.cbrt(0.75 * truth.volume() / np.pi)), sampled(truth, DENSE, rng)
    count, sigma = int(rng.choice([150, 500, 2000])), radius * rng.uniform(0.003, 0.03)
    mask, distance = seen(pattern, dense, radius, rng)
    spacing = np.sqrt(truth.area() * (1.0 if distance else mask.mean()) / count)
    points = dense[rng.choice(np.flatnonzero(mask), count, replace=False)]
    reach = max(SPACINGS * spacing, distance, 3 * sigma)
    return Observed(truth, disturbed(noise, points, sigma, radius, rng), sigma, reach, radius)


def seen(pattern: str, points: np.ndarray, radius: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Which points are measured, (n,), and the distance between slices, 0 without slices."""
    if pattern == "whole":
        return np.ones(len(points), dtype=bool), 0.0
    if pattern == "slices":
        return _slices(points, int(rng.integers(4, 11)))
    if pattern == "holes":
        centres = points[rng.choice(len(points), int(rng.integers(2, 6)))]
        away = np.linalg.norm(points[:, None] - centres, axis=2) > rng.uniform(0.3, 0.6, len(centres)) * radius
        return away.all(axis=1), 0.0
    direction = rng.normal(size=3)
    rank = np.argsort(np.argsort(points @ direction)) / len(points)
    missing = rng.uniform(0.15, 0.6)
    if pattern == "caps":
        return rank > missing, 0.0
    first = rng.uniform(0.1, 0.9 - missing)
    return (rank < first) | (rank > first + missing), 0.0


def _slices(points: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Thin slices across z, the outer ones half a distance from the ends."""
    low, extent = points[:, 2].min(), np.ptp(points[:, 2])
    distance = extent / count
    position = ((points[:, 2] - low) / distance) % 1
    return np.abs(position - 0.5) * distance < 0.004 * extent, distance


def disturbed(noise: str, points: np.ndarray, sigma: float, radius: float, rng: np.random.Generator) -> np.ndarray:
    """The points with noise of standard deviation sigma in each coordinate (RMS over the coordinates)."""
    error = sigma * rng.normal(size=points.shape)
    if noise == "anisotropic":
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        error = error @ (frame * [1, 1, 3] / np.sqrt(11 / 3)) @ frame.T
    if noise == "correlated":
        error = (
            sigma * (smooth_field(points / (0.3 * radius), rng) + 0.5 * rng.normal(size=points.shape)) / np.sqrt(1.25)
        )
    if noise == "heavy-tailed":
        error = sigma * rng.standard_t(3, points.shape) / np.sqrt(3)
    if noise == "outliers":
        wrong = rng.random(len(points)) < 0.1
        low, extent = points.min(axis=0), np.ptp(points, axis=0)
        anywhere = low + extent * rng.uniform(-0.25, 1.25, points.shape)
        return np.where(wrong[:, None], anywhere, points + error)
    return points + error


def smooth_field(points: np.ndarray, rng: np.random.Generator, waves: int = 100) -> np.ndarray:
    """A random vector field of unit variance with a correlation of exp(-d^2 / 2), by random Fourier features."""
    phase = points @ rng.normal(size=(3, waves)) + rng.uniform(0, 2 * np.pi, waves)
    return np.sqrt(2 / waves) * np.cos(phase) @ rng.normal(size=(waves, 3))
