"""How many independent points a cloud is worth: what a fit leaves over is alike at neighbours where points are not.

Points of a contour were drawn in one stroke, those of an isosurface share voxels: their errors, and the misfit of any
small model, are correlated. n points whose deviations correlate by c_k with those of their k-th neighbours count for
n / (1 + sum of c_k); the sum, in pairs, ends where the correlation is lost (the initial positive sequence of Geyer,
Statistical Science 7(4), 1992). Counted as n they would speak too loudly against the regulariser.
"""

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.sampling import outwards
from quadriform.points import Array
from quadriform.shapes.threads import threads_for

MOST = 64
"""Neighbours that are looked at; correlation that reaches farther counts for no more."""
ASKED = 10_000
"""Points whose neighbours are looked at; an even sample of more."""
SURE = 3.0
"""A correlation counts when it is this many of its own standard errors above none at all."""


def independent_share(feet: Array, deviations: Array, weights: Array) -> float:
    """The share of n points that is left when each counts only for what its neighbours do not say already, in (0, 1].

    Args:
        feet: (n, 3), foot points on the fitted surface: neighbours in space would be chosen by their deviations.
        deviations: (n,), signed distances to the fitted surface.
        weights: (n,), how much each counts; strangers nothing.
    """
    count = min(MOST, len(feet) - 1) // 2 * 2
    order = outwards(feet - feet.mean(axis=0))
    some = order[np.linspace(0, len(order) - 1, min(ASKED, len(order))).astype(np.int64)]
    near = cKDTree(feet).query(feet[some], k=np.arange(2, count + 2), workers=threads_for(len(feet)))[1]
    joint = weights[some, None] * weights[near]
    products = (joint * deviations[some, None] * deviations[near]).sum(axis=0)
    variance = float(weights @ deviations**2 / weights.sum())
    correlation = products / np.maximum(joint.sum(axis=0) * variance, 1e-300)
    pairs = correlation.reshape(-1, 2).sum(axis=1)
    lost = np.flatnonzero(pairs < SURE * np.sqrt(2 / weights[some].sum()))
    return float(1 / (1 + pairs[: lost[0] if len(lost) else None].sum()))
