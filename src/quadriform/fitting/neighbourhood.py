"""What neighbours determine: normals, the direction of curves, isolated points, edges, independent points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import evenly_chosen
from quadriform.points import Array
from quadriform.shapes.threads import threads_for

NEIGHBOURS = 12
SURFACE = 0.4
"""Most points on a surface are flatter than this; in a filled volume they are not."""
EVEN = 0.25
"""Flatness that 12 neighbours on an evenly sampled surface have at least; a curve has less."""
DENSE_RANK, ISOLATED_RATIO = 10, 3.0
"""A point is isolated when its tenth neighbour is farther than three times the usual."""
TIE, TIED = 1e-6, 12
"""Distances that differ by this fraction are equal, but for rounding; so many more neighbours are compared for them."""
DISAGREE = 0.05
"""Given normals of which more pairs of neighbours face opposite ways have arbitrary signs."""
AROUND, EDGE_ANGLE, EDGES = 20, np.radians(150), 0.01
"""At an edge 20 neighbours leave an angle of 150 degrees empty; of a closed surface less than one point in a hundred
does."""
FACES_DISTANCE, ABOVE_NOISE, SMOOTHEST = 0.05, 4.0, 0.1
"""Two faces meet where heights differ from a smooth surface by more than the first, a fraction of the neighbours' RMS
distance, and by more than the second times the noise: what they differ by at the smoothest tenth of the points."""
ISOLATED = np.sqrt(2.0)
"""Points whose neighbours are this many times farther away than those of the median point are not on a surface of the
cloud's density, whose creases have neighbours on both sides: outliers, mostly."""
MOST_CORRELATED, ASKED, SURE = 64, 10_000, 3.0
"""Correlation that reaches beyond so many neighbours counts for no more; it is taken at an even sample of so many
points; it counts when it is so many of its own standard errors above none at all."""


@dataclass(frozen=True)
class Neighbourhood:
    """Principal axes of the 12 nearest neighbours of n points.

    Attributes:
        along: (n, 3) unit, where the neighbours spread most.
        normals: (n, 3) unit, where they spread least; signs are arbitrary.
        flatness: (n,) in [0, 1]; near 0 on curves and in filled volumes, where the normal means nothing.
    """

    along: Array
    normals: Array
    flatness: Array

    @classmethod
    def of(cls, points: Array) -> "Neighbourhood":
        """From the points (n, 3) alone."""
        near, counts = nearest(points, points, NEIGHBOURS)
        middle = np.einsum("nk,nki->ni", counts, points[near]) / counts.sum(axis=1, keepdims=True)
        spread = counts[:, :, None] * (points[near] - middle[:, None])
        # eigenvectors of the scatter: the smallest eigenvalue belongs to the normal
        values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
        flatness = (values[:, 1] - values[:, 0]) / np.maximum(values[:, 2], 1e-300)
        return cls(axes[:, :, 2], axes[:, :, 0], np.clip(flatness, 0, 1))

    def take(self, index: NDArray[np.int64]) -> "Neighbourhood":
        """Of the chosen points."""
        return Neighbourhood(self.along[index], self.normals[index], self.flatness[index])

    def alone_across(self) -> Array:
        """How little the data determines across the line it runs along, (n,): 0 on a surface, 1 on a curve."""
        return np.clip(1 - self.flatness / EVEN, 0, 1) ** 2


def outward_normals(points: Array, given: Array) -> Array:
    """Given normals (n, 3) facing outwards.

    Where neighbours agree on the side they face, it is the same for all of them or the opposite one, as the outermost
    point shows; where they do not, the signs mean nothing and are found as in `oriented`.
    """
    one, other = _flattest_paths(points, given).nonzero()
    if (np.einsum("ij,ij->i", given[one], given[other]) < 0).mean() > DISAGREE:
        return oriented(points, given)
    outward = points - points.mean(axis=0)
    root = np.linalg.norm(outward, axis=1).argmax()
    return given if given[root] @ outward[root] >= 0 else -given


def oriented(points: Array, normals: Array) -> Array:
    """The normals (n, 3) with signs that agree with their neighbours, outwards (after Hoppe et al. 1992).

    Signs are carried along the flattest paths; an edge straight through a thin wall, along the normals, is no path.
    The outermost point of each connected part faces outwards.
    """
    normals = normals.copy()
    tree = _flattest_paths(points, normals)
    outward = points - points.mean(axis=0)
    far = np.linalg.norm(outward, axis=1)
    parts, member = connected_components(tree, directed=False)
    for part in range(parts):
        inside = np.flatnonzero(member == part)
        root = inside[far[inside].argmax()]
        if normals[root] @ outward[root] < 0:
            normals[root] *= -1
        order, before = breadth_first_order(tree, root, directed=False)
        for point in order[1:]:
            if normals[point] @ normals[before[point]] < 0:
                normals[point] *= -1
    return normals


def _flattest_paths(points: Array, normals: Array) -> coo_matrix:
    near, counts = nearest(points, points, NEIGHBOURS)
    rows, rank = counts[:, 1:].nonzero()
    columns = near[rows, rank + 1]
    edge = points[columns] - points[rows]
    edge /= np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-300)
    # an edge along a normal leads through a thin wall to a surface that faces the other way
    through = [np.einsum("ij,ij->i", edge, normals[end]) ** 2 for end in (rows, columns)]
    deviation = 1 - np.abs(np.einsum("ij,ij->i", normals[rows], normals[columns]))
    cost = deviation + np.maximum(*through) + 1e-6  # zero would mean no edge
    graph = coo_matrix((cost, (rows, columns)), shape=(len(points),) * 2).tocsr()
    # of both directions the smaller cost, so that the tree does not depend on the order of points
    tree = minimum_spanning_tree(graph.maximum(graph.T))
    return tree + tree.T


def dense_points(points: Array) -> NDArray[np.bool_]:
    """Which points (n,) have neighbours as near as most do; outliers scattered through space have not."""
    reach = cKDTree(points).query(points, k=[min(DENSE_RANK, len(points))], workers=threads_for(len(points)))[0][:, 0]
    return reach <= ISOLATED_RATIO * np.median(reach)


def is_surface(neighbourhood: Neighbourhood) -> bool:
    """Whether most points lie on a sampled surface, not on curves or in a volume."""
    return bool(np.median(neighbourhood.flatness) > SURFACE)


def has_edge(points: Array, neighbourhood: Neighbourhood) -> bool:
    """Whether a sampled surface ends somewhere: its last points have a wide empty angle in their tangent plane.

    Beside a crease of less than a right angle, such as the rim of a cone, points have such an empty angle too, because
    both faces lie on the same side of it; these do not count, for the surface goes on there.
    """
    near, counts = nearest(points, points, AROUND + 1)
    offset, counts = points[near[:, 1:]] - points[:, None, :], counts[:, 1:]
    axes = (neighbourhood.along, np.cross(neighbourhood.normals, neighbourhood.along), neighbourhood.normals)
    along, across, height = (np.einsum("nki,ni->nk", offset, axis) for axis in axes)
    angle = np.arctan2(across, along)
    # neighbours that do not count repeat the first angle, which leaves no empty angle
    angle = np.sort(np.where(counts, angle, angle[:, :1]), axis=1)
    around = np.concatenate([angle, angle[:, :1] + 2 * np.pi], axis=1)
    wide = np.diff(around, axis=1).max(axis=1) > EDGE_ANGLE
    if wide.mean() < EDGES:
        return False
    return bool((wide & ~_creased(along, across, height, counts)).mean() >= EDGES)


def _creased(along: Array, across: Array, height: Array, counts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points (n,) have neighbours on two faces, one above the other in the tangent plane.

    Heights (n, k) of neighbours at `along` and `across` in the tangent plane are then no quadratic function of their
    places, as those of a single face are but for the noise. Only neighbours where `counts` is true count.
    """
    count = counts.sum(axis=1)
    size = np.sqrt((counts * (along**2 + across**2)).sum(axis=1) / count)[:, None]
    dense = size[:, 0] < ISOLATED * np.median(size)
    x, y, z = (np.where(counts, each / np.maximum(size, 1e-300), 0.0) for each in (along, across, height))
    terms = np.stack([counts, x, y, x * x, x * y, y * y], axis=2)
    # least squares of all points at once: a batched QR, with zero rows for neighbours that do not count
    basis = np.linalg.qr(terms)[0]
    left = np.abs(z - np.einsum("nkj,nj->nk", basis, np.einsum("nkj,nk->nj", basis, z)))
    left = np.sort(np.where(counts, left, np.inf), axis=1)
    middle = left[np.arange(len(left)), count // 2]  # the median: one outlier among the neighbours is no second face
    return dense & (middle > np.maximum(FACES_DISTANCE, ABOVE_NOISE * np.quantile(middle, SMOOTHEST)))


def nearest(among: Array, of: Array, count: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Neighbours (n, k) of points, the nearest first, and which of them count.

    These are the nearest `count` and all that are as near as the last of them: on the lattices of images there are
    many, and rounding must not choose among them.
    """
    ranks = np.arange(1, min(count + TIED, len(among)) + 1)
    distance, near = cKDTree(among).query(of, k=ranks, workers=threads_for(len(of)))
    last = distance[:, [min(count, len(among)) - 1]]
    return near, distance <= (1 + TIE) * last


def effective_fraction(feet: Array, deviations: Array, weights: Array) -> float:
    """Effective number of independent points over the number of points, in (0, 1].

    Points of a contour were drawn in one stroke, those of an isosurface have voxels in common: their errors, and the
    misfit of any small model, are correlated. n points whose deviations correlate by c_k with those of their k-th
    neighbours count for n / (1 + sum of c_k); the sum, in pairs, ends where the correlation is lost (the initial
    positive sequence of Geyer, Statistical Science 7(4), 1992). Counted as n they would outweigh the regulariser.

    Args:
        feet: (n, 3), foot points on the fitted surface: neighbours in space would be chosen by their deviations.
        deviations: (n,), signed distances to the fitted surface.
        weights: (n,), how much each counts; outliers nothing.
    """
    count = min(MOST_CORRELATED, len(feet) - 1) // 2 * 2
    # the correlation is a mean over points, so an even sample of them is enough
    some = evenly_chosen(feet, ASKED)
    near = cKDTree(feet).query(feet[some], k=np.arange(2, count + 2), workers=threads_for(len(feet)))[1]
    # pairs with an outlier carry no weight
    joint = weights[some, None] * weights[near]
    products = (joint * deviations[some, None] * deviations[near]).sum(axis=0)
    variance = float(weights @ deviations**2 / weights.sum())
    correlation = products / np.maximum(joint.sum(axis=0) * variance, 1e-300)
    pairs = correlation.reshape(-1, 2).sum(axis=1)
    uncorrelated = np.flatnonzero(pairs < SURE * np.sqrt(2 / weights[some].sum()))
    return float(1 / (1 + pairs[: uncorrelated[0] if len(uncorrelated) else None].sum()))
