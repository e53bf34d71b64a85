"""Where on the surface a data point belongs when sliding would not find it: near, and facing the same way."""

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.sheet import FacingCloud
from quadriform.points import Array
from quadriform.shapes.closest import surface_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

FACING = 0.4
"""A point that faces the other way counts as if it were this much farther, times the square root of two (RMS radii)."""
MODEL_RESOLUTION = 14


def match_facing(superquadric: Superquadric, box: ControlBox, cloud: FacingCloud) -> Array:
    """For each data point the origin (n, 3) of the best of the model points."""
    origins, _ = superquadric.grid(MODEL_RESOLUTION)
    best: Array = origins[_cost(superquadric, box, cloud, origins).argmin(axis=1)]
    return best


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
    return origins, cloud.points[_cost(superquadric, box, cloud, origins).argmin(axis=0)]


def _cost(superquadric: Superquadric, box: ControlBox, cloud: FacingCloud, origins: Array) -> Array:
    """Cost (n, m) of bringing each data point and each model point together: |x - y|^2 + FACING^2 trust (1 - cos).

    One product of matrices: few points against few are done before a tree of them stands.
    """
    model, normals = surface_points(superquadric, box, origins)
    trust = FACING**2 * cloud.flatness
    by_data = np.concatenate([-2 * cloud.points, -trust[:, None] * cloud.normals], axis=1)
    cost: Array = by_data @ np.concatenate([model, normals], axis=1).T
    cost += ((cloud.points**2).sum(axis=1) + trust)[:, None]
    cost += (model**2).sum(axis=1)
    return cost
