"""Outliers of the superquadric that belong to another object, such as a neighbouring body or the table below.

Where the shape of the body is no superquadric, parts of the body itself are outliers too, such as the apex of a heart.
These are connected to the body: some of their points are as near to it as its own points are to each other.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.result import SuperquadricFit
from quadriform.points import Array

Masks = dict[str, NDArray[np.bool_]]


@dataclass(frozen=True)
class ConnectionSettings:
    """The constants of what is connected to a body."""

    neighbours: int = 8
    """Neighbours of each inlier in the graph whose minimum spanning tree is taken."""
    usual: float = 0.99
    """Quantile of the edges of this tree that is taken for the distance of connected points: one edge in a hundred may
    lead across a hole, or to an inlier by chance."""
    farther: float = 3.0
    """Points farther from each other than this many such distances are not connected: a slice may be missing."""
    most: float = 0.9
    """Least fraction of the inliers that are connected to each other, as slices are at their distance from each other.
    The rest may be inliers by chance."""
    least: float = 0.01
    """Least fraction of the points of an elongated part of the body that are near the rest of it; of a table or a
    neighbour that touches the body fewer are."""


JOIN = ConnectionSettings()


def of_others(clouds: Mapping[str, Array], starts: Mapping[str, SuperquadricFit]) -> Masks:
    """Name -> (n,) whether each point of a cloud is an outlier of its superquadric that belongs to something else."""
    return {name: _of_one(name, clouds, starts) for name in clouds}


def spread(found: Masks, clouds: Mapping[str, Array], index: Mapping[str, NDArray[np.int64]] | None) -> Masks:
    """Name -> (n,) masks for whole clouds from those of a sample, given by index: that of the nearest sampled point."""
    if index is None:
        return found
    return {name: of[cKDTree(clouds[name][index[name]]).query(clouds[name])[1]] for name, of in found.items()}


def _of_one(name: str, clouds: Mapping[str, Array], starts: Mapping[str, SuperquadricFit]) -> NDArray[np.bool_]:
    cloud, inliers = clouds[name], starts[name].inliers
    found, outliers = np.zeros(len(cloud), dtype=np.bool_), np.flatnonzero(inliers < INLIER)
    if not len(outliers) or len(cloud) - len(outliers) <= JOIN.neighbours:
        return found
    others, body = cloud[outliers], cloud[inliers >= INLIER]
    limit = JOIN.farther * _step(body)
    # outliers within the limit of each other are one part; it belongs to the body if enough of it is near the inliers
    pairs = cKDTree(others).query_pairs(limit, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(others),) * 2)
    part = connected_components(graph, directed=False)[1]
    begins = np.bincount(part, cKDTree(body).query(others)[0] <= limit) / np.bincount(part)
    found[outliers] = begins[part] < JOIN.least
    return found


def _step(body: Array) -> float:
    """The distance at which most points of a body (n, 3) are connected to each other."""
    length, near = cKDTree(body).query(body, k=JOIN.neighbours + 1)
    rows, steps = np.repeat(np.arange(len(body)), JOIN.neighbours), np.maximum(length[:, 1:].ravel(), 1e-300)
    # the minimum spanning tree has the shortest edges that connect points; its long ones are cut
    tree = minimum_spanning_tree(coo_matrix((steps, (rows, near[:, 1:].ravel())), shape=(len(body),) * 2).tocsr())
    step = float(np.quantile(tree.data, JOIN.usual))
    tree.data[tree.data > JOIN.farther * step] = 0
    tree.eliminate_zeros()
    part = connected_components(tree, directed=False)[1]
    joined = part == np.bincount(part).argmax()
    # parts are added to the largest one, the nearest first, until most points are connected
    while joined.mean() < JOIN.most:
        away = cKDTree(body[joined]).query(body[~joined])[0]
        step = max(step, float(away.min()))
        joined |= np.isin(part, part[~joined][away <= step])
    return step
