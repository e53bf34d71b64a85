"""What rounding must not choose: axes that moments of second order leave open, and the best of what is equally good.

On lattices of images, and on any body with symmetry, much is equal but for rounding, and that differs between
processors.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array

EQUAL = 1e-9
"""Values that differ by less than this share of their size are equal, but for rounding."""
OPEN = 1e-7
"""Eigenvalues nearer to each other than this share of the largest leave their axes open."""
TELLS = 1e-6
"""A moment above this share of what it could be tells a direction."""
FOLDS = range(1, 7)
"""Symmetries about an axis that are looked for: whole turns, halves, ... sixths."""
SWEEPS = 30
SADDLE = np.radians([20.0, 35.0, 50.0])
"""Turns about the three axes that lead away from a frame where fourth moments are stationary without being extreme."""


def best_first(values: Array) -> NDArray[np.int64]:
    """Indices (n,) from the largest value to the smallest; of equal ones the first, whatever their last digits are."""
    values = np.nan_to_num(values, nan=-np.inf)  # infinite ones become the largest numbers
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    apart = falling[:-1] / 2 - falling[1:] / 2 > EQUAL * np.maximum(np.abs(falling[1:]), 1.0)
    group = np.concatenate([[0], np.cumsum(apart)])
    return order[np.lexsort((order, group))]


def first_least(values: Array) -> NDArray[np.int64]:
    """Index of the least of values (..., n) along the last axis; of equal ones the first."""
    least = values.min(axis=-1, keepdims=True)
    return np.argmax(values <= least + EQUAL * np.abs(least), axis=-1)


def settled_axes(values: Array, axes: Array, points: Array) -> Array:
    """Principal axes (3, 3), columns, that do not depend on rounding.

    Where eigenvalues differ these are the given ones. Equal eigenvalues leave their axes open: there moments of higher
    order tell them, which turn with the points; where these are isotropic too, the axes nearest to the coordinates'.

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
    fourth = (far[:, None] * points).T @ points
    spread, other = np.linalg.eigh(fourth)
    if (np.diff(spread) > TELLS * spread[-1]).any():
        apart = np.diff(spread) > TELLS * spread[-1]
        return other if apart.all() else _around(other[:, 2 if apart[1] else 0], 2 if apart[1] else 0, points)
    return _of_fourth_moments(points, float((far**2).sum()))


def _around(axis: Array, place: int, points: Array) -> Array:
    """Axes (3, 3) with a given one in its place; the others by the first symmetry about it that the points have."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis) > np.abs(axis).max() - TELLS)])
    beside = np.eye(3)[np.argmax(np.abs(axis) < np.abs(axis).min() + TELLS)]
    first = beside - (beside @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    plane = points @ first + 1j * (points @ second)
    far = np.linalg.norm(points, axis=1)
    for fold in FOLDS:
        weights = far ** (4 if fold < 3 else 0)
        moment, most = (weights * plane**fold).sum(), (weights * np.abs(plane) ** fold).sum()
        if np.abs(moment) > TELLS * most:
            moment = -moment if fold == 4 else moment  # of a square the axes are its sides, not its diagonals
            angle = _nearest_to_zero(float(np.angle(moment)) / fold, fold)
            first = np.cos(angle) * first + np.sin(angle) * second
            second = np.cross(axis, first)
            break
    return np.stack({0: (axis, first, second), 2: (first, second, axis)}[place], axis=1)


def _nearest_to_zero(angle: float, fold: int) -> float:
    """One of the equivalent angles: rounding does not choose between the two ends of their range."""
    step = 2 * np.pi / fold
    return angle - step if angle > step / 2 - TELLS else angle


def _of_fourth_moments(points: Array, most: float) -> Array:
    """The frame (3, 3) whose sum of fourth moments is farthest from that of an isotropic cloud, by Jacobi's turns.

    In a plane that sum is a constant and the real part of a moment of (x + i y)^4: its extreme is known at once.
    """
    even = 3 / 5 * most
    found = []
    for begin in (np.eye(3), _turned()):
        for sign in (1.0, -1.0):
            frame = _extreme(points, begin, sign, most)
            found.append((frame, abs(float(((points @ frame) ** 4).sum()) - even)))
    frame, strength = found[best_first(np.array([each[1] for each in found]) / most)[0]]
    return frame if strength > TELLS * most else np.eye(3)


def _extreme(points: Array, frame: Array, sign: float, most: float) -> Array:
    """The frame (3, 3), reached from a given one, whose sum of fourth moments is largest (sign 1) or least (-1)."""
    for _ in range(SWEEPS):
        turned = 0.0
        for i, j in combinations(range(3), 2):
            local = points @ frame
            moment = sign * ((local[:, i] + 1j * local[:, j]) ** 4).sum()
            angle = float(np.angle(moment)) / 4 if np.abs(moment) > EQUAL * most else 0.0
            c, s = np.cos(angle), np.sin(angle)
            frame = frame.copy()
            frame[:, [i, j]] = frame[:, [i, j]] @ np.array([[c, -s], [s, c]])
            turned = max(turned, abs(angle))
        if turned < 1e-14:
            break
    return frame


def _turned() -> Array:
    """A frame off all symmetries of the coordinate axes."""
    frame = np.eye(3)
    for (i, j), angle in zip(combinations(range(3), 2), SADDLE):
        c, s = np.cos(angle), np.sin(angle)
        frame[:, [i, j]] = frame[:, [i, j]] @ np.array([[c, -s], [s, c]])
    return frame
