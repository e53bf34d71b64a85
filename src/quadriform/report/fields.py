"""Values on a surface that the page cannot compute: residual, uncertainty, wall thickness."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.result import Fit
from quadriform.points import Array
from quadriform.report.viewer import FIELD_CELLS, ScalarField
from quadriform.shapes.model import DeformableModel

NEIGHBOURS = 6
"""Data points whose mean residual is shown at a point of the grid."""
FAR = 1.5
"""Without a data point within this many cells of the grid, nothing is known of the residual."""


def residual_field(
    models: Sequence[DeformableModel], clouds: Mapping[str, Sequence[Array]], residuals: Mapping[str, Sequence[Array]]
) -> ScalarField:
    """Mean signed distance of the data near each grid point of the surfaces; NaN without data.

    Args:
        models: one a frame.
        clouds: surface -> data points (n, 3) of each frame.
        residuals: surface -> their signed distances (n,).
    """
    values = {
        name: [_nearby(model, name, cloud, off) for model, cloud, off in zip(models, clouds[name], residuals[name])]
        for name in clouds
    }
    return ScalarField("residual", models[0].unit.replace("unknown", "units"), values)


def _nearby(model: DeformableModel, name: str, cloud: Array, residuals: Array) -> Array:
    points = _grid_points(model, name)
    if not len(cloud):
        return np.full(len(points), np.nan)
    count = min(NEIGHBOURS, len(cloud))
    # k as a list: for one neighbour the tree would return (n,) instead of (n, 1)
    distances, index = cKDTree(cloud).query(points, k=np.arange(1, count + 1))
    # the grid is nearly even, so that its cells are about as large as the mean of the area
    cell = np.sqrt(model.area(name) / len(points))
    return np.where(distances[:, 0] < FAR * cell, residuals[index].mean(axis=1), np.nan)


def uncertainty_field(fit: Fit) -> ScalarField:
    """One standard deviation of each surface along its normal."""
    model = fit.model
    values = {name: [fit.uncertainty(_grid_points(model, name), name)] for name in model.surfaces}
    return ScalarField("uncertainty", model.unit.replace("unknown", "units"), values)


def thickness_field(models: Sequence[DeformableModel]) -> ScalarField:
    """Distance of each grid point of both walls of a ventricle, "endo" and "epi", to the other wall."""
    # from either wall: the nearest point of the other is not mutual where the wall is curved
    pairs = (("endo", "epi"), ("epi", "endo"))
    values = {one: [np.abs(m.distance(_grid_points(m, one), other)) for m in models] for one, other in pairs}
    return ScalarField("thickness", models[0].unit.replace("unknown", "units"), values)


def _grid_points(model: DeformableModel, name: str) -> Array:
    return model.box.deform(model.superquadric(name).grid(FIELD_CELLS)[0])
