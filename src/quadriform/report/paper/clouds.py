"""Synthetic data of the paper's kinds and sizes; lengths in mm, every object about 100 mm long."""

import numpy as np

from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.shapes.barr import taper
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.voxels import voxels_inside

ARMS = (50.0, 30.0)
"""Half length and half width of each superquadric that crosses the two others."""
SCANNER = ((98, 100, 110), 0.926)
"""Voxels and their side in mm of the paper's third image, by the Dynamic Spatial Reconstructor (p. 47)."""
BRIGHTNESS = (40.0, 90.0, 200.0)
"""Background, muscle and blood with its contrast agent."""


def crossing(resolution: int = 24) -> Array:
    """Three crossing superquadrics with a taper along z (the paper's Fig. 3): (n, 3) points of what is seen outside."""
    half, width = ARMS
    arms = [
        Superquadric(semi_axes=np.where(np.arange(3) == k, half, width), exponents=np.array((0.6, 0.6)))
        for k in range(3)
    ]
    grids = [arm.grid(resolution)[0] for arm in arms]
    seen = [
        points[np.all([arm.implicit(points) > 1 for arm in arms if arm is not own], axis=0)]
        for own, points in zip(arms, grids)
    ]
    return taper(np.concatenate(seen), (-0.35, -0.35), half)


def ventricle(resolution: int = 32) -> Array:
    """Half an ellipsoid with a flat base and two bumps: points (6 n^2 + 2, 3), without noise."""
    u, _ = sphere_grid(resolution)
    height = np.where(u[:, 2] < 0, 70 * u[:, 2], 30 * u[:, 2])
    p = np.column_stack([33 * u[:, 0], 30 * u[:, 1], np.minimum(height, 18 + 0.2 * height)])
    for centre, push, width in (((24, 8, -10), (5, 1.5, 0), 12.0), ((-18, -18, -35), (3, 3, 0), 11.0)):
        p = p + np.exp(-((p - centre) ** 2).sum(1) / (2 * width**2))[:, None] * np.array(push)
    return p


def noisy(points: Array, sigma: float = 0.5) -> Array:
    """The same points with normal noise of `sigma` on each coordinate, drawn from a fixed seed."""
    return points + np.random.default_rng(0).normal(0, sigma, points.shape)


def with_strangers(points: Array, share: float) -> Array:
    """Of the points (n, 3) a share is put anywhere in the box around them, half as large again; from a fixed seed."""
    rng = np.random.default_rng(1)
    moved = rng.permutation(len(points))[: round(share * len(points))]
    low, high = points.min(axis=0), points.max(axis=0)
    result = points.copy()
    result[moved] = (low + high) / 2 + 0.75 * (high - low) * rng.uniform(-1, 1, (len(moved), 3))
    return result


def three_planes(points: Array, count: int = 600) -> Array:
    """The `count` points nearest to three orthogonal planes: through the mean, across the cloud's own axes."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    return points[np.argsort(np.abs(centred @ axes.T).min(axis=1), kind="stable")[:count]]


def subsample(points: Array, count: int = 900) -> Array:
    """`count` of the points, drawn evenly from a fixed seed."""
    return points[np.random.default_rng(2).permutation(len(points))[:count]]


def scanner_image() -> Volume:
    """The synthetic ventricle at rest as the paper's scanner would show it: bright blood, dark muscle, blur, noise."""
    from scipy.ndimage import gaussian_filter

    shape, side = SCANNER
    model = SyntheticVentricle().model(0.0)
    corner = model.mesh("epi").vertices.mean(axis=0) - side * (np.array(shape) - 1) / 2
    affine = np.diag([side, side, side, 1.0])
    affine[:3, 3] = corner
    volume = Volume(np.full(shape, BRIGHTNESS[0]), affine)
    for name, value in zip(("epi", "endo"), BRIGHTNESS[1:]):
        mesh = model.mesh(name, 48)
        inside = voxels_inside(type(mesh)(volume.voxels(mesh.vertices), mesh.faces), shape)
        volume.values[inside] = value
    noise = np.random.default_rng(3).normal(0, 12.0, shape)
    return Volume(gaussian_filter(volume.values, 1.0) + gaussian_filter(noise, 0.7), affine)
