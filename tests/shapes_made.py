"""Shapes the tests are made of: superquadrics of every kind in a skew pose, even samples, a ventricle, a rotation."""

import numpy as np

from quadriform.points import Frame
from quadriform.shapes import pose
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

KINDS = ("ellipsoid", "toroid", "hyperboloid1", "hyperboloid2")
SKEW = pose.rotation_from_euler(np.array([0.4, -0.7, 1.1]))
HEIGHTS = {"hyperboloid1": 6.0, "hyperboloid2": 7.0}


def made(kind="ellipsoid", exponents=(0.6, 1.4), semi_axes=(3.0, 2.0, 4.0)):
    """A superquadric of a kind, turned and moved."""
    hole = 2.5 if kind == "toroid" else None
    return Superquadric(kind, semi_axes, exponents, SKEW, (1.0, -2.0, 0.5), hole_radius=hole, height=HEIGHTS.get(kind))


def even_directions(n):
    """Fibonacci's even directions of the sphere, (n, 3)."""
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def angles(kind, n=400, seed=5):
    """Latitudes and longitudes (n, 2) where the natural parametrisation of a kind is defined."""
    lat, lon = np.random.default_rng(seed).uniform(-1, 1, (2, n))
    if kind == "toroid":
        return np.pi * np.stack([lat, lon], axis=1)
    if kind == "hyperboloid2":
        return np.stack([1.2 * lat, 1.2 * lon + np.pi * (np.arange(n) % 2)], axis=1)
    return np.stack([1.2 * lat, np.pi * lon], axis=1)


def ventricle(n=3000):
    """Points of a half ellipsoid closed by a flat base: half axes 32 and 27, 65 deep, the base 22 above the ring."""
    u = even_directions(n)
    return np.column_stack([32 * u[:, 0], 27 * u[:, 1], np.where(u[:, 2] < 0, 65 * u[:, 2], 22 * np.cbrt(u[:, 2]))])


def lumpy(n=1000, seed=7):
    """Random points of a ventricle with bumps and no symmetry, so that no two model points are equally near."""
    u = np.random.default_rng(seed).normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    p = u * np.array([32, 27, 50])
    p[:, 2] = np.where(u[:, 2] > 0, 0.5 * p[:, 2], p[:, 2])
    return p + 2 * np.sin(p[:, [1, 2, 0]] / 9 + [0.3, 1.0, 2.0])


def two_walls(n=1500):
    """Outer and inner wall of a ventricle, as a mapping of clouds."""
    return {"epi": ventricle(n), "endo": ventricle(n) * [0.7, 0.7, 0.8]}


def turned(seed):
    """A rotation matrix drawn with a seed."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * [np.sign(np.linalg.det(q)), 1, 1]


def single(superquadric, box):
    """A model of one surface."""
    return DeformableModel({"surface": superquadric}, box)


def gap(one, other, surface=None):
    """Largest distance between two models' surfaces, both ways, in units of the first one's RMS radius."""
    a, b = one.mesh(surface, 8).vertices, other.mesh(surface, 8).vertices
    largest = max(np.abs(other.distance(a, surface)).max(), np.abs(one.distance(b, surface)).max())
    return largest / Frame.of(a).scale
