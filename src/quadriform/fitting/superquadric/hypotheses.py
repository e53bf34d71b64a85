"""Where a robust fit may start: ellipsoids of parts of the cloud in several frames, all found without chance.

Every choice here turns, moves and scales with the points and does not see their order.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.neighbourhood import TIE
from quadriform.fitting.superquadric.batch import Candidates
from quadriform.fitting.superquadric.initial import hyperboloids, tori
from quadriform.fitting.ties import settled_axes
from quadriform.points import Array
from quadriform.shapes import pose
from quadriform.shapes.superquadric import Superquadric

NEIGHBOURS = 9
SPARSE = 2.0
"""A point whose neighbours are this many times further away than the median point's is left out of starts."""
DENSE_SHARE = 0.4
"""The densest points: mostly surface even when there are more outliers than inliers."""
SIDE_SHARE = 0.4
"""How much of the cloud lies on one side of a cut: a start must do without what lies on the other."""
THINNEST = 1e-2
"""Least semi-axis of a start over its longest."""


ORDERS = np.array([np.roll(np.eye(3), shift, axis=1) for shift in range(3)])
EIGHTH = pose.rotation_from_euler(np.array([0, 0, np.pi / 4]))
FRAMES = np.concatenate([ORDERS, ORDERS @ EIGHTH])
"""Each axis as z, and the same turned by 45 degrees: the dual, where e2 and 2 - e2 look alike."""
CUTS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])


def reach(points: Array, cloud: Array) -> Array:
    """Distance (n,) of each point to the last of its near neighbours in a cloud, maybe a sample of the points."""
    return cKDTree(cloud).query(points, min(NEIGHBOURS, len(cloud) - 1) + 1)[0][:, -1]


def dense_parts(points: Array) -> Array:
    """Weights (2, n), 0 or 1, of two parts of a cloud: without lone points, and the densest points only."""
    far = reach(points, points)
    most = (1 + TIE) * np.array([SPARSE * np.median(far), np.quantile(far, DENSE_SHARE)])
    return (far <= most[:, None]).astype(np.float64)


def sides(points: Array, core: NDArray[np.bool_]) -> Array:
    """Weights (26, n), 0 or 1, of parts of the core (n,) on one side of a plane.

    The planes' normals are 26 even directions about the core's principal axes.
    """
    centre = points[core].mean(axis=0)
    axes = settled_axes(*np.linalg.eigh(np.cov(points[core].T)), points[core] - centre)
    heights = (points - centre) @ axes @ (CUTS / np.linalg.norm(CUTS, axis=1)[:, None]).T
    most = np.quantile(heights[core], SIDE_SHARE, axis=0) + TIE * np.abs(heights[core]).max()
    return (core[:, None] & (heights <= most)).T.astype(np.float64)


def _moments(points: Array, weights: Array) -> tuple[Array, Array]:
    """Centres (H, 3) and second moments (H, 3, 3) of weighted parts (H, n) of a cloud, of all without any weight."""
    weights = np.where(weights.sum(axis=1, keepdims=True) > 0, weights, 1.0)
    share = weights / weights.sum(axis=1, keepdims=True)
    centres = share @ points
    squares = (points[:, :, None] * points[:, None]).reshape(-1, 9)
    return centres, (share @ squares).reshape(-1, 3, 3) - centres[:, :, None] * centres[:, None]


def principal_axes(points: Array, weights: Array) -> Array:
    """Principal axes (H, 3, 3) of weighted parts (H, n) of a cloud, right-handed, the longest last."""
    centres, second = _moments(points, weights)
    values, axes = np.linalg.eigh(second)
    for part, centre in enumerate(centres):
        shares = np.sqrt(weights[part])[:, None] if weights[part].any() else 1.0
        axes[part] = settled_axes(values[part], axes[part], shares * (points - centre))
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    return axes


def ellipsoids(points: Array, weights: Array, rotations: Array) -> Candidates:
    """Ellipsoids by centre and spread of weighted parts of a cloud.

    Args:
        points: (n, 3).
        weights: (H, n), a row for each part.
        rotations: (H, k, 3, 3), k frames for each part.
    """
    centres, second = _moments(points, weights)
    count = rotations.shape[0] * rotations.shape[1]
    turned = np.swapaxes(rotations, 2, 3) @ second[:, None] @ rotations
    spread = np.einsum("hkaa->hka", turned).reshape(-1, 3)
    sizes = np.sqrt(3 * np.maximum(spread, THINNEST**2 * spread.max(axis=1, keepdims=True)))
    return Candidates(
        "ellipsoid",
        np.log(sizes),
        np.ones((count, 2)),
        rotations.reshape(-1, 3, 3),
        np.repeat(centres, rotations.shape[1], axis=0),
        np.zeros((count, 1)),
    )


def other_kind(points: Array, kind: str) -> Candidates:
    """Starts of a toroid or hyperboloid about several axes, each also turned by 45 degrees about its own."""
    first = tori(points) if kind == "toroid" else hyperboloids(points, kind)
    return Candidates.of(first + [_eighth_turned(s) for s in first])


def _eighth_turned(s: Superquadric) -> Superquadric:
    size = np.sqrt((s.semi_axes[:2] ** 2).mean())
    axes = np.array([size, size, s.semi_axes[2]])
    return Superquadric(s.kind, axes, s.exponents, s.rotation @ EIGHTH, s.translation, s.hole_radius, s.height)
