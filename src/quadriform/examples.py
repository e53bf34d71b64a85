"""Point sets of the figures of Bardinet, Cohen and Ayache 1998; lengths in mm, every body about 100 mm long.

All are deterministic: random ones come from a fixed seed.
"""

from __future__ import annotations

import numpy as np

from quadriform.errors import choose
from quadriform.points import Array, check_points
from quadriform.shapes.barr import taper
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.superquadric import Superquadric

ARMS = (50.0, 30.0)
"""Half length and half width of each of the three crossing superquadrics."""
ROUNDED_BOX = Superquadric(semi_axes=np.array((50.0, 40.0, 30.0)), exponents=np.array((0.3, 0.3)))
"""The body of Fig. 2: flat faces, curved at the edges only."""
PARAMETRISATIONS = ("natural", "regular")


def rounded_box(parametrisation: str = "regular", steps: int = 20) -> Array:
    """Points of a rounded box on the closed grid of latitude and longitude (Fig. 2), ((steps + 1)(2 steps + 1), 3).

    Args:
        parametrisation: "natural" (P2), or "regular" (section 2.2).
        steps: cells from pole to pole; twice as many around. Poles and seam are on the grid and occur repeatedly.

    Raises:
        OptionError: another parametrisation.
    """
    choose(parametrisation, PARAMETRISATIONS, "parametrisation")
    latitude, longitude = np.linspace(-np.pi / 2, np.pi / 2, steps + 1), np.linspace(-np.pi, np.pi, 2 * steps + 1)
    up, around = (angles.ravel() for angles in np.meshgrid(latitude, longitude, indexing="ij"))
    if parametrisation == "natural":
        return ROUNDED_BOX.natural(np.stack([up, around], axis=1))
    return ROUNDED_BOX.surface(np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1))


def crossing_superquadrics(resolution: int = 24) -> Array:
    """The outer points (n, 3) of three crossing superquadrics with a taper along z (Figs. 3, 6 and 8).

    Args:
        resolution: of each superquadric's grid, as in `Superquadric.mesh`; 24 gives 5,478 points.
    """
    half, width = ARMS
    arms = [
        Superquadric(semi_axes=np.where(np.arange(3) == k, half, width), exponents=np.array((0.6, 0.6)))
        for k in range(3)
    ]
    grids = [arm.grid(resolution)[0] for arm in arms]
    outer = [
        points[np.all([arm.implicit(points) > 1 for arm in arms if arm is not own], axis=0)]
        for own, points in zip(arms, grids)
    ]
    return taper(np.concatenate(outer), (-0.35, -0.35), half)


def ventricle(resolution: int = 32) -> Array:
    """The true surface of a ventricle (Figs. 9 to 12): half an ellipsoid with a flat base and two bumps.

    Args:
        resolution: n, even; the answer has 6 n^2 + 2 points: 6,146 for 32, as many as the paper's complete data.
    """
    u, _ = sphere_grid(resolution)
    # The apex is longer than the base, which is cut nearly flat.
    height = np.where(u[:, 2] < 0, 70 * u[:, 2], 30 * u[:, 2])
    p = np.column_stack([33 * u[:, 0], 30 * u[:, 1], np.minimum(height, 18 + 0.2 * height)])
    for centre, push, width in (((24, 8, -10), (5, 1.5, 0), 12.0), ((-18, -18, -35), (3, 3, 0), 11.0)):
        p = p + np.exp(-((p - centre) ** 2).sum(1) / (2 * width**2))[:, None] * np.array(push)
    return p


def noisy(points: Array, sigma: float = 0.5) -> Array:
    """The points (n, 3) with normal noise of standard deviation `sigma` on each coordinate."""
    checked = check_points(points)
    return checked + np.random.default_rng(0).normal(0, sigma, checked.shape)


def with_outliers(points: Array, ratio: float) -> Array:
    """The points (n, 3), of which a ratio is moved anywhere in the box around them, enlarged by a half."""
    result = np.array(check_points(points))
    rng = np.random.default_rng(1)
    moved = rng.permutation(len(result))[: round(ratio * len(result))]
    low, high = result.min(axis=0), result.max(axis=0)
    result[moved] = (low + high) / 2 + 0.75 * (high - low) * rng.uniform(-1, 1, (len(moved), 3))
    return result


def three_planes(points: Array, count: int = 600) -> Array:
    """The `count` points nearest to three orthogonal planes through the mean, across the cloud's own axes (Fig. 9)."""
    checked = check_points(points)
    centred = checked - checked.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    return checked[np.argsort(np.abs(centred @ axes.T).min(axis=1), kind="stable")[:count]]


def regular_grid(points: Array, count: int = 900) -> Array:
    """About `count` of the points (n, 3): those where the lines of a cubic lattice meet the surface (Fig. 9).

    Tagged MRI lays such lines through the tissue and tracks where they cross it. The spacing of the lattice is the
    one of a series of 60, from the extent down to its fortieth, whose number of points is nearest to `count`.
    """
    checked = check_points(points)
    centred = checked - checked.mean(axis=0)
    extent = float(np.ptp(centred, axis=0).max())
    found = [_on_lattice_lines(centred, extent / cells) for cells in np.geomspace(1, 40, 60)]
    return checked[min(found, key=lambda index: abs(len(index) - count))]


def _on_lattice_lines(points: Array, spacing: float) -> np.ndarray:
    """Indices of the points nearest to each crossing of a lattice line with the surface, in their order.

    Each point belongs to its nearest line: the one along the axis in which it is farthest from a lattice plane.
    """
    position = points / spacing + 0.5
    node = np.floor(position)
    off = np.abs(position - node - 0.5)
    along = off.argmax(axis=1)
    rows = np.arange(len(points))
    distance = np.sqrt(np.maximum((off**2).sum(axis=1) - off[rows, along] ** 2, 0))
    node[rows, along] = np.sign(points[rows, along])  # a line enters the body and leaves it
    order = np.argsort(distance, kind="stable")
    # the first of equal rows is the nearest point of its crossing
    nearest = order[np.unique(np.column_stack([along, node])[order], axis=0, return_index=True)[1]]
    return np.sort(nearest[distance[nearest] < 0.25])
