"""Fewer points of a surface, evenly: one for each cube of space."""

import numpy as np

from quadriform.points import Array

OFFSET = np.array([0.31830989, 0.36787944, 0.41421356])
"""Where a cube begins, as a share of its side: off every lattice, so that no point lies between two cubes."""


def thinned(points: Array, side: float) -> Array:
    """Of the points (n, 3) in each cube of this side the one nearest to its middle, in their order.

    The cubes are fixed in the world, so the answer does not depend on the order of the points, nor on the axes of
    the grid that they come from. A side of 0 keeps all points.
    """
    if side == 0 or not len(points):
        return points
    place = points / side + OFFSET
    cube = np.floor(place)
    off_centre = np.linalg.norm(place - cube - 0.5, axis=1)
    order = np.lexsort((off_centre, *cube.T))
    first = np.unique(cube[order], axis=0, return_index=True)[1]
    kept: Array = points[np.sort(order[first])]
    return kept
