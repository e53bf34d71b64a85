"""A subset of the points of a surface, evenly spread: one in each cube of space."""

import numpy as np

from quadriform.points import Array

OFFSET = np.array([0.31830989, 0.36787944, 0.41421356])
"""Corner of a cube, in sides of a cube: off every voxel grid, so that no point lies on a face between two cubes."""


def thinned(points: Array, side: float) -> Array:
    """Return of the points (n, 3) in each cube of this side the one nearest to its centre, in their order.

    The cubes are fixed in the world, so the result does not depend on the order of the points, nor on the axes of the
    image. A side of 0 keeps all points.
    """
    if side == 0 or not len(points):
        return points
    scaled = points / side + OFFSET
    cube = np.floor(scaled)
    off_centre = np.linalg.norm(scaled - cube - 0.5, axis=1)
    # sorted by cube, in each cube by distance from its centre: the first of each cube is kept
    order = np.lexsort((off_centre, *cube.T))
    first = np.unique(cube[order], axis=0, return_index=True)[1]
    kept: Array = points[np.sort(order[first])]
    return kept
