"""The order in which few points are taken from many."""

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array

TIE = 9
"""Distances that agree to so many decimals, the largest being 1, are equal: but for rounding they would be."""


def outwards(points: Array) -> NDArray[np.int64]:
    """Indices of points (n, 3) by their distance from the origin; the equally far by how far to the heavier side.

    So it turns and scales with the points and does not see in what order they come, on the lattices of images either.
    Of clouds whose symmetry leaves no heavier side the coordinates decide.
    """
    far = np.linalg.norm(points, axis=1)
    points, far = points / far.max(), far / far.max()
    heavier = far @ points / far.sum()
    keys = np.round([*points.T, points @ heavier, far], TIE)
    order = np.argsort(keys[-1], kind="stable")
    same = np.diff(keys[-1, order], prepend=-1.0, append=2.0) == 0
    tied = same[1:] | same[:-1]  # few, but on a lattice: only they need the other keys
    there = np.sort(order[tied])
    order[tied] = there[np.lexsort(keys[:, there])]
    return order
