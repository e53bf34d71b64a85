"""Step 1 of the paper's iteration: target displacements of the model points (paper 3.2.2)."""

import numpy as np
from scipy.spatial import cKDTree

from quadriform.points import Array

NEIGHBOURS = 4
TIE = 1e-9
"""Distances that differ by less than this fraction are equal."""


def data_to_model(model_points: Array, data: Array, neighbours: int = NEIGHBOURS) -> Array:
    """Displacements (m, 3) of the model points, by the closest MODEL point of each data point: the paper's choice.

    A model point chosen by several data points takes the mean of their displacements; one chosen by none takes the
    inverse-distance mean of its `neighbours` nearest chosen ones.
    """
    chosen = cKDTree(model_points).query(data)[1]  # section 3.2.2
    counts = np.bincount(chosen, minlength=len(model_points))
    # sums over the data points of each model point, without a loop
    sums = np.stack([np.bincount(chosen, data[:, axis], len(model_points)) for axis in range(3)], axis=1)
    assigned = counts > 0
    displacements = np.zeros_like(model_points)
    displacements[assigned] = sums[assigned] / counts[assigned, None] - model_points[assigned]
    if not assigned.all():
        displacements[~assigned] = _interpolate(
            model_points[~assigned], model_points[assigned], displacements[assigned], neighbours
        )
    return displacements


def _interpolate(at: Array, known_at: Array, known: Array, neighbours: int) -> Array:
    count = min(neighbours, len(known_at))
    distance, index = cKDTree(known_at).query(at, k=np.arange(1, min(2 * count, len(known_at)) + 1))
    weight = 1 / np.maximum(distance, 1e-12 * np.ptp(known_at, axis=0).max() + 1e-300)
    # the model's grid is symmetric: neighbours as near as the last one count too, lest rounding chooses among them
    weight[distance > (1 + TIE) * distance[:, count - 1 : count]] = 0
    return np.einsum("nk,nkd->nd", weight, known[index]) / weight.sum(axis=1, keepdims=True)


def model_to_data(model_points: Array, data: Array, neighbours: int = NEIGHBOURS) -> Array:
    """Displacements (m, 3) of the model points to the closest DATA point of each: the usual choice, not the paper's."""
    return data[cKDTree(data).query(model_points)[1]] - model_points
