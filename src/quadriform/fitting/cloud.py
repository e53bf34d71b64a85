"""A cloud whatever the order of its points: its distinct points, and orders and axes that rounding does not choose.

On the lattices of images, and on any body with symmetry, much is equal but for rounding, and that differs between
processors: the best of equal values, axes that moments of second order leave open, and points at equal distances.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array, Frame

EQUAL = 1e-9
"""Values that differ by less than this fraction of their size are equal, but for rounding."""
OPEN = 1e-7
"""Eigenvalues nearer to each other than this fraction of the largest leave their axes open."""
DETERMINES = 1e-6
"""A moment above this fraction of the largest possible one determines a direction."""
FOLDS = range(1, 7)
"""Symmetries about an axis that are looked for: by 360 degrees, 180, ... 60."""
SWEEPS = 30
SADDLE = np.radians([20.0, 35.0, 50.0])
"""Rotations about the three axes that lead away from a frame where fourth moments are stationary without being
extreme."""
DECIMALS = 9
"""Distances that agree to so many decimals, the largest being 1, are equal: but for rounding they would be."""


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
        if (np.diff(np.sort(points[:, 0])) > 0).all():  # no two alike: the common case, and quick to see
            return cls(points, weights, counted, np.arange(len(points)))
        distinct, index = np.unique(points, axis=0, return_inverse=True)
        index = index.reshape(-1).astype(np.int64)
        return cls(distinct, np.bincount(index, weights).astype(np.float64), counted, index)

    def of_distinct(self, values: Array) -> Array:
        """Values (n, ...) of the whole cloud for its distinct points (m, ...): of copies those of the first."""
        first = np.empty(len(self.points), dtype=np.int64)
        first[self.index[::-1]] = np.flatnonzero(self.counted)[::-1]
        return values[first]

    def spread(self, values: Array) -> Array:
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
    """Indices of points (n, 3) by their distance from the origin; the equally far by how far to the heavier side.

    So it rotates and scales with the points and does not depend on their order, on the lattices of images either.
    Of clouds whose symmetry leaves no heavier side the coordinates decide.
    """
    far = np.linalg.norm(points, axis=1)
    points, far = points / far.max(), far / far.max()
    # the first moment weighted by distance: it rotates with the points
    heavier = far @ points / far.sum()
    # rounded, so that equal distances compare as equal on every processor
    keys = np.round([*points.T, points @ heavier, far], DECIMALS)
    order = np.argsort(keys[-1], kind="stable")
    same = np.diff(keys[-1, order], prepend=-1.0, append=2.0) == 0
    tied = same[1:] | same[:-1]  # few, but on a lattice: only they need the other keys
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
    differ = falling[:-1] / 2 - falling[1:] / 2 > EQUAL * np.maximum(np.abs(falling[1:]), 1.0)
    group = np.concatenate([[0], np.cumsum(differ)])
    return order[np.lexsort((order, group))]


def first_least(values: Array) -> NDArray[np.int64]:
    """Index of the least of values (..., n) along the last axis; of equal ones the first."""
    least = values.min(axis=-1, keepdims=True)
    return np.argmax(values <= least + EQUAL * np.abs(least), axis=-1)


def canonical_axes(values: Array, axes: Array, points: Array) -> Array:
    """Principal axes (3, 3), columns, that do not depend on rounding.

    Where eigenvalues differ these are the given ones. Equal eigenvalues leave their axes open: there moments of higher
    order determine them, which rotate with the points; where these are isotropic too, the axes nearest to the
    coordinates'.

    Args:
        values: (3,) eigenvalues, in order.
        axes: (3, 3) eigenvectors as columns.
        points: (n, 3) centred, maybe each times the root of its weight.
    """
    near = np.abs(np.diff(values)) <= OPEN * np.abs(values).max()
    if not near.any():
        return axes
    if not near.all():
        alone = 2 if near[0] else 0
        return _around(axes[:, alone], alone, points)
    far = (points**2).sum(axis=1)
    # where second moments are isotropic, fourth moments contracted to a matrix may not be
    fourth = (far[:, None] * points).T @ points
    spread, other = np.linalg.eigh(fourth)
    if (np.diff(spread) > DETERMINES * spread[-1]).any():
        differ = np.diff(spread) > DETERMINES * spread[-1]
        return other if differ.all() else _around(other[:, 2 if differ[1] else 0], 2 if differ[1] else 0, points)
    return _of_fourth_moments(points, float((far**2).sum()))


def _around(axis: Array, index: int, points: Array) -> Array:
    """Axes (3, 3) with a given one at its index; the others by the first symmetry about it that the points have."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis) > np.abs(axis).max() - DETERMINES)])
    beside = np.eye(3)[np.argmax(np.abs(axis) < np.abs(axis).min() + DETERMINES)]
    first = beside - (beside @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    # in the plane across the axis as complex numbers: a k-fold symmetry has moments of order k only
    plane = points @ first + 1j * (points @ second)
    far = np.linalg.norm(points, axis=1)
    for fold in FOLDS:
        weights = far ** (4 if fold < 3 else 0)
        moment, most = (weights * plane**fold).sum(), (weights * np.abs(plane) ** fold).sum()
        if np.abs(moment) > DETERMINES * most:
            moment = -moment if fold == 4 else moment  # of a square the axes are its sides, not its diagonals
            angle = _nearest_to_zero(float(np.angle(moment)) / fold, fold)
            first = np.cos(angle) * first + np.sin(angle) * second
            second = np.cross(axis, first)
            break
    return np.stack({0: (axis, first, second), 2: (first, second, axis)}[index], axis=1)


def _nearest_to_zero(angle: float, fold: int) -> float:
    """One of the equivalent angles: rounding does not choose between the two ends of their range."""
    step = 2 * np.pi / fold
    return angle - step if angle > step / 2 - DETERMINES else angle


def _of_fourth_moments(points: Array, most: float) -> Array:
    """The frame (3, 3) whose sum of fourth moments is farthest from that of an isotropic cloud, by Jacobi's rotations.

    In a plane that sum is a constant and the real part of a moment of (x + i y)^4: its extreme is known at once.
    """
    even = 3 / 5 * most
    found = []
    for begin in (np.eye(3), _rotated()):
        for sign in (1.0, -1.0):
            frame = _extreme(points, begin, sign, most)
            found.append((frame, abs(float(((points @ frame) ** 4).sum()) - even)))
    frame, strength = found[best_first(np.array([each[1] for each in found]) / most)[0]]
    return frame if strength > DETERMINES * most else np.eye(3)


def _extreme(points: Array, frame: Array, sign: float, most: float) -> Array:
    """The frame (3, 3), reached from a given one, whose sum of fourth moments is largest (sign 1) or least (-1)."""
    for _ in range(SWEEPS):
        largest = 0.0
        for i, j in combinations(range(3), 2):
            local = points @ frame
            moment = sign * ((local[:, i] + 1j * local[:, j]) ** 4).sum()
            angle = float(np.angle(moment)) / 4 if np.abs(moment) > EQUAL * most else 0.0
            c, s = np.cos(angle), np.sin(angle)
            frame = frame.copy()
            frame[:, [i, j]] = frame[:, [i, j]] @ np.array([[c, -s], [s, c]])
            largest = max(largest, abs(angle))
        if largest < 1e-14:
            break
    return frame


def _rotated() -> Array:
    """A frame off all symmetries of the coordinate axes."""
    frame = np.eye(3)
    for (i, j), angle in zip(combinations(range(3), 2), SADDLE):
        c, s = np.cos(angle), np.sin(angle)
        frame[:, [i, j]] = frame[:, [i, j]] @ np.array([[c, -s], [s, c]])
    return frame
