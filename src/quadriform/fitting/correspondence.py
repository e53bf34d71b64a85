"""Where on the surface a data point belongs when sliding would not find it: near, and facing the same way."""

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.sheet import FacingCloud
from quadriform.points import Array
from quadriform.shapes.closest import surface_normals
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

CANDIDATES = 40
FACING = 0.4
"""A point that faces the other way counts as if it were this much farther, times the square root of two (RMS radii)."""
MODEL_RESOLUTION = 14


def match_facing(superquadric: Superquadric, box: ControlBox, cloud: FacingCloud) -> Array:
    """For each data point the origin (n, 3) of the best of its 40 nearest model points."""
    origins, _ = superquadric.grid(MODEL_RESOLUTION)
    model, normals = box.deform(origins), surface_normals(superquadric, box, origins)
    distance, near = _nearest(model, cloud.points)
    facing = np.einsum("nki,ni->nk", normals[near], cloud.normals)
    return origins[_best(distance, near, facing, cloud.flatness[:, None])]


def match_unclaimed(
    superquadric: Superquadric, box: ControlBox, cloud: FacingCloud, claimed: Array
) -> tuple[Array, Array]:
    """Model points that no data point chose, and the data point that each would choose: matching the other way.

    Without it a part of the surface that the data has left behind hangs in empty space.

    Args:
        superquadric: of the surface.
        box: that carries it.
        cloud: the data.
        claimed: (n, 3) origins that data points chose.

    Returns:
        Origins (m, 3) of the unclaimed model points and the data points (m, 3) they are drawn to.
    """
    origins, _ = superquadric.grid(MODEL_RESOLUTION)
    free = np.ones(len(origins), dtype=bool)
    free[cKDTree(origins).query(claimed)[1]] = False
    origins = origins[free]
    if not len(origins):
        return origins, origins
    model, normals = box.deform(origins), surface_normals(superquadric, box, origins)
    distance, near = _nearest(cloud.points, model)
    facing = np.einsum("nki,ni->nk", cloud.normals[near], normals)
    return origins, cloud.points[_best(distance, near, facing, cloud.flatness[near])]


def _nearest(among: Array, of: Array) -> tuple[Array, Array]:
    distance, near = cKDTree(among).query(of, k=np.arange(1, min(CANDIDATES, len(among)) + 1))
    return distance, near


def _best(distance: Array, near: Array, facing: Array, trust: Array) -> Array:
    cost = distance**2 + FACING**2 * trust * (1 - facing)
    return near[np.arange(len(near)), cost.argmin(axis=1)]
