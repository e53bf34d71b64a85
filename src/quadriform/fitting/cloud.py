"""Properties of a cloud that depend neither on its order nor on a model: distinct points, neighbourhoods, ties.

On the lattices of images, and on symmetric bodies, many values and distances are equal up to rounding, and rounding
differs between processors. Ties are therefore resolved explicitly here.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from quadriform.points import Array, Frame
from quadriform.shapes.threads import threads_for


@dataclass(frozen=True)
class Equality:
    """Tolerances within which values are equal: smaller differences are rounding."""

    values: float = 1e-9
    """Values that differ by less than this fraction of their size, of values below 1 by less than this."""
    decimals: int = 9
    """Distances that agree to so many decimals, the largest being 1."""
    neighbours: float = 1e-6
    """Distances to neighbours that differ by less than this fraction, for they are differences of coordinates."""
    compared: int = 12
    """Neighbours beyond the requested number whose distances are compared with that of the last requested one."""


@dataclass(frozen=True)
class Neighbours:
    """The constants of local neighbourhoods."""

    count: int = 12
    """Neighbours of which principal axes are taken: two rings on an even surface."""
    surface: float = 0.4
    """Most points on a surface are flatter than this; in a filled volume they are not."""
    dense_rank: int = 10
    isolated_ratio: float = 3.0
    """A point is isolated when its tenth neighbour is farther than three times the usual."""
    disagree: float = 0.05
    """Given normals have arbitrary signs where more than this fraction of neighbours face opposite directions."""
    around: int = 20
    edge_angle: float = np.radians(150)
    edges: float = 0.01
    """At an edge 20 neighbours leave an angle of 150 degrees empty; of a closed surface less than one point in a
    hundred does."""
    faces_distance: float = 0.05
    above_noise: float = 4.0
    smoothest: float = 0.1
    """Two faces meet where heights differ from a smooth surface by more than the first, a fraction of the neighbours'
    RMS distance, and by more than the second times the noise: what they differ by at the smoothest tenth of the
    points."""
    isolated: float = np.sqrt(2.0)
    """Creases are not sought at points whose neighbours are this many times farther away than those of the median
    point: these are mostly outliers, and on a surface of the cloud's density a crease has neighbours on both sides."""
    correlation: tuple[tuple[int, int], ...] = ((10_000, 16), (10_000, 64), (500, 512), (500, 2048), (500, 8192))
    """Correlation is taken at an even sample of so many points, with so many neighbours of each; the next pair only
    where it reaches beyond these neighbours: finding ten times more takes twenty times as long. Of most clouds with
    independent errors the first pair is enough."""
    sure: float = 3.0
    """A correlation counts when it is this many of its standard errors above zero."""


EQUAL = Equality()
NEAR = Neighbours()


@dataclass(frozen=True)
class Distinct:
    """The distinct points of a cloud of n, those of weight zero left out.

    Attributes:
        points: (m, 3).
        weights: (m,), of all copies together.
        counted: (n,) whether a point of the cloud counts.
        index: for each that does, the index of its distinct point.
    """

    points: Array
    weights: Array
    counted: NDArray[np.bool_]
    index: NDArray[np.int64]

    @classmethod
    def of(cls, cloud: Array, weights: Array) -> "Distinct":
        """From points (n, 3) and weights (n,)."""
        counted = weights > 0
        points, weights = cloud[counted], weights[counted]
        if (np.diff(np.sort(points[:, 0])) > 0).all():  # no equal x: the common case, tested without sorting rows
            return cls(points, weights, counted, np.arange(len(points)))
        distinct, index = np.unique(points, axis=0, return_inverse=True)
        index = index.reshape(-1).astype(np.int64)
        return cls(distinct, np.bincount(index, weights).astype(np.float64), counted, index)

    def of_distinct(self, values: Array) -> Array:
        """Values (m, ...) of the distinct points from those (n, ...) of the whole cloud; the first of copies counts."""
        first = np.empty(len(self.points), dtype=np.int64)
        # in reverse order, so that of several copies the first is written last
        first[self.index[::-1]] = np.flatnonzero(self.counted)[::-1]
        return values[first]

    def expand_to_duplicates(self, values: Array) -> Array:
        """Values (m,) of the distinct points for the whole cloud (n,), zero where a point does not count."""
        result = np.zeros(len(self.counted))
        result[self.counted] = values[self.index]
        return result

    @property
    def copies(self) -> int:
        """How many points that count are copies of others."""
        return len(self.index) - len(self.points)


@dataclass(frozen=True)
class Centred:
    """Distinct points of several clouds in one centred, scaled frame.

    Attributes:
        frame: of all distinct points.
        distinct: name -> distinct points in the unit of the data.
        points: name -> (m, 3), these in the frame.
        mean_weight: of all of them.
        weights: name -> (m,) divided by their mean: weights that are all twice as large are no more evidence.
    """

    frame: Frame
    distinct: dict[str, Distinct]
    points: dict[str, Array]
    mean_weight: float
    weights: dict[str, Array]

    @classmethod
    def of(cls, clouds: Mapping[str, Array], weights: Mapping[str, Array]) -> "Centred":
        """From points (n, 3) and weights (n,) by name."""
        distinct = {name: Distinct.of(cloud, weights[name]) for name, cloud in clouds.items()}
        frame = Frame.of(np.concatenate([each.points for each in distinct.values()]))
        mean = float(np.concatenate([each.weights for each in distinct.values()]).mean())
        points = {name: frame.to_local(each.points) for name, each in distinct.items()}
        return cls(frame, distinct, points, mean, {name: each.weights / mean for name, each in distinct.items()})


def canonical_order(points: Array) -> NDArray[np.int64]:
    """Indices (n,) of points (n, 3) by their distance from the origin; ties by the projection onto the first moment.

    The order of the points, rotations and scales do not change it, on the lattices of images either. Where symmetry
    makes the first moment zero, the coordinates decide.
    """
    far = np.linalg.norm(points, axis=1)
    points, far = points / far.max(), far / far.max()
    # the first moment weighted by distance: it rotates with the points
    moment = far @ points / far.sum()
    # rounded, so that equal distances compare as equal on every processor
    keys = np.round([*points.T, points @ moment, far], EQUAL.decimals)
    order = np.argsort(keys[-1], kind="stable")
    same = np.diff(keys[-1, order]) == 0
    tied = np.append(same, False) | np.append(False, same)  # few, but on a lattice: only they need the other keys
    rows = np.sort(order[tied])
    order[tied] = rows[np.lexsort(keys[:, rows])]
    return order


def evenly_chosen(points: Array, count: int) -> NDArray[np.int64]:
    """Indices of at most `count` of (n, 3) points, spread over their distances to the centre."""
    return evenly_spread(canonical_order(points - points.mean(axis=0)), count)


def evenly_spread(order: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """At most `count` of the indices, evenly over their order."""
    return order[np.linspace(0, len(order) - 1, min(count, len(order))).astype(np.int64)]


def best_first(values: Array) -> NDArray[np.int64]:
    """Indices (n,) from the largest value to the smallest; of equal ones the first, whatever their last digits are."""
    values = np.nan_to_num(values, nan=-np.inf)  # infinite ones become the largest numbers
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    # halves, because the difference of the largest numbers would overflow
    differ = falling[:-1] / 2 - falling[1:] / 2 > EQUAL.values / 2 * np.maximum(np.abs(falling[1:]), 1.0)
    group = np.concatenate([[0], np.cumsum(differ)])
    return order[np.lexsort((order, group))]


def first_least(values: Array) -> NDArray[np.int64]:
    """Index of the least of values (..., n) along the last axis; of equal ones the first."""
    least = values.min(axis=-1, keepdims=True)
    return np.argmax(values <= least + EQUAL.values * np.abs(least), axis=-1)


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
        near, counts = nearest(points, points, NEAR.count)
        middle = np.einsum("nk,nki->ni", counts, points[near]) / counts.sum(axis=1, keepdims=True)
        spread = counts[:, :, None] * (points[near] - middle[:, None])
        # eigenvectors of the scatter: the smallest eigenvalue belongs to the normal
        values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
        flatness = (values[:, 1] - values[:, 0]) / np.maximum(values[:, 2], 1e-300)
        return cls(axes[:, :, 2], axes[:, :, 0], np.clip(flatness, 0, 1))

    def take(self, index: NDArray[np.int64]) -> "Neighbourhood":
        """Of the chosen points."""
        return Neighbourhood(self.along[index], self.normals[index], self.flatness[index])


def outward_normals(points: Array, given: Array) -> Array:
    """Given normals (n, 3) facing outwards.

    Where neighbours agree on the side they face, it is the same for all of them or the opposite one, as the outermost
    point shows; where they do not, the signs mean nothing and are found as in `oriented`.
    """
    one, other = _flattest_paths(points, given).nonzero()
    if (np.einsum("ij,ij->i", given[one], given[other]) < 0).mean() > NEAR.disagree:
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
    """The minimum spanning tree (n, n) of neighbouring points; the cost of an edge is the change of the normal."""
    near, counts = nearest(points, points, NEAR.count)
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
    reach = cKDTree(points).query(points, k=[min(NEAR.dense_rank, len(points))], workers=threads_for(len(points)))[0][
        :, 0
    ]
    return reach <= NEAR.isolated_ratio * np.median(reach)


def is_surface(neighbourhood: Neighbourhood) -> bool:
    """Whether most points lie on a sampled surface, not on curves or in a volume."""
    return bool(np.median(neighbourhood.flatness) > NEAR.surface)


def has_edge(points: Array, neighbourhood: Neighbourhood) -> bool:
    """Whether a sampled surface ends somewhere: its last points have a wide empty angle in their tangent plane.

    Beside a crease of less than a right angle, such as the rim of a cone, points have such an empty angle too, because
    both faces lie on the same side of it; these do not count, for the surface goes on there.
    """
    near, counts = nearest(points, points, NEAR.around + 1)
    offset, counts = points[near[:, 1:]] - points[:, None, :], counts[:, 1:]
    axes = (neighbourhood.along, np.cross(neighbourhood.normals, neighbourhood.along), neighbourhood.normals)
    along, across, height = (np.einsum("nki,ni->nk", offset, axis) for axis in axes)
    angle = np.arctan2(across, along)
    # neighbours that do not count repeat the first angle, which leaves no empty angle
    wide = widest_empty_angle(np.where(counts, angle, angle[:, :1])) > NEAR.edge_angle
    if wide.mean() < NEAR.edges:
        return False
    return bool((wide & ~_creased(along, across, height, counts)).mean() >= NEAR.edges)


def widest_empty_angle(angles: Array) -> Array:
    """The widest angle (n,) between neighbours around the circle, of directions (n, k) in radians."""
    ordered = np.sort(angles, axis=1)
    return np.diff(ordered, axis=1, append=ordered[:, :1] + 2 * np.pi).max(axis=1)


def _creased(along: Array, across: Array, height: Array, counts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points (n,) have neighbours on two faces, one above the other in the tangent plane.

    Heights (n, k) of neighbours at `along` and `across` in the tangent plane are then no quadratic function of their
    positions, as those of a single face are up to the noise. Only neighbours where `counts` is true count.
    """
    count = counts.sum(axis=1)
    size = np.sqrt((counts * (along**2 + across**2)).sum(axis=1) / count)[:, None]
    dense = size[:, 0] < NEAR.isolated * np.median(size)
    x, y, z = (np.where(counts, each / np.maximum(size, 1e-300), 0.0) for each in (along, across, height))
    terms = np.stack([counts, x, y, x * x, x * y, y * y], axis=2)
    # least squares of all points at once: a batched QR, with zero rows for neighbours that do not count
    basis = np.linalg.qr(terms)[0]
    left = np.abs(z - np.einsum("nkj,nj->nk", basis, np.einsum("nkj,nk->nj", basis, z)))
    left = np.sort(np.where(counts, left, np.inf), axis=1)
    middle = left[np.arange(len(left)), count // 2]  # the median: one outlier among the neighbours is no second face
    return dense & (middle > np.maximum(NEAR.faces_distance, NEAR.above_noise * np.quantile(middle, NEAR.smoothest)))


def nearest(among: Array, of: Array, count: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Neighbours (n, k) of points, the nearest first, and which of them count.

    These are the nearest `count` and all that are as near as the last of them: on the lattices of images there are
    many, and rounding must not choose among them.
    """
    ranks = np.arange(1, min(count + EQUAL.compared, len(among)) + 1)
    distance, near = cKDTree(among).query(of, k=ranks, workers=threads_for(len(of)))
    last = distance[:, [min(count, len(among)) - 1]]
    return near, distance <= (1 + EQUAL.neighbours) * last


def effective_fraction_of_points(feet: Array, deviations: Array, weights: Array) -> float:
    """Effective number of independent points over the number of points, in (0, 1].

    Points of a contour are drawn in one stroke, those of an isosurface have voxels in common: their errors are
    correlated, and so is the misfit of any model with few parameters. n points whose deviations correlate by c_k with
    those of their k-th neighbours count for n / (1 + sum of c_k); the sum, in groups of neighbours, goes as far as
    there is a correlation (the initial positive sequence of Geyer, Statistical Science 7(4), 1992). Counted as n they
    would outweigh the regulariser.

    Args:
        feet: (n, 3), foot points on the fitted surface: neighbours in space would be chosen by their deviations.
        deviations: (n,), signed distances to the fitted surface.
        weights: (n,), how much each counts; outliers nothing.
    """
    variance = float(weights @ deviations**2 / weights.sum())
    tree = cKDTree(feet)
    # few neighbours of many points first, then many neighbours of few points, where errors are correlated farther
    for asked, most in NEAR.correlation:
        ranks = _groups_of_ranks(min(most, len(feet) - 1))
        some = evenly_chosen(feet, asked)  # the correlation is a mean over points, so an even sample is enough
        near = tree.query(feet[some], k=np.arange(2, ranks[-1] + 2), workers=threads_for(len(feet)))[1]
        # pairs with an outlier carry no weight
        joint = weights[some, None] * weights[near]
        products = np.add.reduceat((joint * deviations[some, None] * deviations[near]).sum(axis=0), ranks[:-1])
        pairs = np.add.reduceat(joint.sum(axis=0), ranks[:-1])
        correlation = products / np.maximum(pairs * variance, 1e-300)
        ended = np.flatnonzero(correlation < NEAR.sure * np.sqrt(1 / np.maximum(pairs, 1e-300)))
        end = ended[0] if len(ended) else len(correlation)
        total = float((np.diff(ranks) * correlation)[:end].sum())
        if len(ended):
            break
    return 1 / (1 + total)


def _groups_of_ranks(count: int) -> NDArray[np.int64]:
    """Ranks at which groups of neighbours begin, and the end: pairs, then groups of an eighth of all before them."""
    ranks, end = [*range(0, 17, 2)], 16.0
    while end < count:
        end *= 1 + 1 / 8
        ranks.append(int(np.ceil(end)))
    return np.unique(np.minimum([*ranks, count], count))
