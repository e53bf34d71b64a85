"""Which points are connected to each other: by distances not much larger than those between the others."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import evenly_chosen
from quadriform.points import Array


@dataclass(frozen=True)
class ConnectionSettings:
    """The constants of what is connected."""

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
    points: int = 20_000
    """Of a larger body an even sample is taken: time grows with the points, and their gaps with their distance."""


JOIN = ConnectionSettings()


def connection_distance(body: Array) -> float:
    """The distance up to which points are connected to a body (n, 3), most of which is connected itself."""
    return JOIN.farther * _step(body)


def components(points: Array, limit: float) -> NDArray[np.int64]:
    """The number (n,) of the component of each of (n, 3) points, which distances up to a limit connect."""
    pairs = cKDTree(points).query_pairs(limit, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def unconnected(body: Array) -> NDArray[np.bool_]:
    """Which inliers (n,) of a body (n, 3) are not connected to most of them."""
    if len(body) <= JOIN.neighbours:
        return np.zeros(len(body), dtype=np.bool_)
    if len(body) > JOIN.points:
        some = body[evenly_chosen(body, JOIN.points)]
        return unconnected(some)[cKDTree(some).query(body)[1]]
    component = components(body, connection_distance(body))
    return np.asarray(component != np.bincount(component).argmax())


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
