"""How well modes represent a population: members that were left out, and random ones."""

import numpy as np
from scipy.linalg import eigh
from scipy.spatial.distance import cdist

from quadriform.points import Array
from quadriform.priors.principal import Components

NEGLIGIBLE = 1e-9
"""Components with a smaller fraction of the variance, all together, are outside of all modes."""
RANDOM_MEMBERS = 1000
SEED = 0


def modes_for(variances: Array, fraction: float) -> int:
    """Return the number of modes that explain a fraction of the variance."""
    explained = np.cumsum(variances) / variances.sum()
    return int(np.searchsorted(explained, fraction - NEGLIGIBLE)) + 1


def leave_one_out_error(rows: Array, found: Components, modes: int) -> float:
    """Return the RMS distance of each shape to its projection on as many modes of all others.

    Args:
        rows: (n, p), features of three or more shapes.
        found: their components.
        modes: their number; fewer where the others have fewer.
    """
    n = len(rows)
    kept = modes_for(found.variances, 1 - NEGLIGIBLE)
    along, outside = _split(rows, found, kept)
    scatter = np.diag(found.variances[:kept] * (n - 1))
    count = min(modes, n - 2, kept)
    # without a shape at distance d from the mean of all: its distance from the mean of the others is n / (n - 1) d, and
    # their scatter is that of all less n / (n - 1) d d'
    factor = n / (n - 1)
    squares = np.empty(n)
    for number, d in enumerate(along):
        _, axes = eigh(scatter - factor * np.outer(d, d), subset_by_index=[kept - count, kept - 1])
        squares[number] = ((d - axes @ (d @ axes)) ** 2).sum()
    return float(factor * np.sqrt((squares + outside).mean()))


def specificity(rows: Array, found: Components, modes: int) -> float:
    """Return the mean distance of random members of the Gaussian over the first modes to the nearest shape.

    Args:
        rows: (n, p), features of the shapes.
        found: their components.
        modes: number of modes.
    """
    along, outside = _split(rows, found, modes)
    deviations = np.sqrt(found.variances[:modes])
    members = np.random.default_rng(SEED).normal(size=(RANDOM_MEMBERS, modes)) * deviations
    squared = cdist(members, along, "sqeuclidean") + outside
    return float(np.sqrt(squared.min(axis=1)).mean())


def _split(rows: Array, found: Components, modes: int) -> tuple[Array, Array]:
    """Coordinates (n, modes) of rows along the first components, and the squares (n,) of their distances to these."""
    centred, axes = rows - found.mean, found.directions[:modes]
    along = centred @ axes.T
    return along, ((centred - along @ axes) ** 2).sum(axis=1)
