"""Outliers of the superquadric that belong to another object, such as a neighbouring body or the table below.

Where the shape of the body is no superquadric, parts of the body itself are outliers too, such as the apex of a heart.
These are connected to the body: some of their points are as near to it as its own points are to each other.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.connected import JOIN, components, connection_distance
from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.result import SuperquadricFit
from quadriform.points import Array

Masks = dict[str, NDArray[np.bool_]]


LEAST_NEAR = 0.01
"""Least fraction of the points of an elongated part of the body that are near the rest of it; of a table or a neighbour
that touches the body fewer are."""


def points_of_others(clouds: Mapping[str, Array], starts: Mapping[str, SuperquadricFit]) -> Masks:
    """Name -> (n,) whether each point of a cloud is an outlier of its superquadric that belongs to something else."""
    return {name: _of_one(name, clouds, starts) for name in clouds}


def extended_to_clouds(
    sampled: Masks, clouds: Mapping[str, Array], index: Mapping[str, NDArray[np.int64]] | None
) -> Masks:
    """Name -> (n,) masks of whole clouds from those of a sample, given by index: each point has that of the nearest.

    Without an index the sample is the whole cloud.
    """
    if index is None:
        return sampled
    return {name: mask[cKDTree(clouds[name][index[name]]).query(clouds[name])[1]] for name, mask in sampled.items()}


def _of_one(name: str, clouds: Mapping[str, Array], starts: Mapping[str, SuperquadricFit]) -> NDArray[np.bool_]:
    cloud, inliers = clouds[name], starts[name].inliers
    found, outliers = np.zeros(len(cloud), dtype=np.bool_), np.flatnonzero(inliers < INLIER)
    if not len(outliers) or len(cloud) - len(outliers) <= JOIN.neighbours:
        return found
    others, body = cloud[outliers], cloud[inliers >= INLIER]
    limit = connection_distance(body)
    # outliers within the limit of each other are one part; it belongs to the body if enough of it is near the inliers
    part = components(others, limit)
    begins = np.bincount(part, cKDTree(body).query(others)[0] <= limit) / np.bincount(part)
    found[outliers] = begins[part] < LEAST_NEAR
    return found
