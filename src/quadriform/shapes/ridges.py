"""Nearest points beside the ridges of superquadrics with an exponent above 1.

There the curvature of the surface is infinite along its coordinate planes (exponents from 1 to 2), or it has edges (2)
or cusps (above 2), and Newton's method in the tangent plane fails. Between two planes, however, the surface is an
analytic function of t = log|y / x| and u = log|z| over the radius of its ring, and the planes lie at infinity:

    ellipsoid      |x| = s / N(1, e^t), |y| = |x| e^t, s = 1 / N(1, e^u), |z| = s e^u, N(1, e^t) = (1 + e^(k t))^(1/k)
    toroid         the same with the ring a4 +- s in place of s for x and y
    hyperboloid1   s = N(1, e^u), |z| = e^u (a hyperbola in the latitude)
    hyperboloid2   |y| = s e^t, |x| = s N(1, e^t), s = N(1, e^u), |z| = e^u (and one in the longitude)

with k = 2 / e of the longitude for t and of the latitude for u. So each part between two planes is searched by itself.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from quadriform.points import LARGEST, Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS, Kind
from quadriform.shapes.superellipse import log_abs, norm
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

FAR = 45.0
"""Beyond these logarithms a point is on the plane: e^-45 is below rounding."""
SCAN = (-28.0, -14.0, -7.0, -3.5, -1.5, -0.5, -0.15, 0.0, 0.15, 0.5, 1.5, 3.5, 7.0, 14.0, 28.0)
"""Logarithms at which the search may begin."""
AT_ONCE = 10_000
"""Trial points in one call: with fewer its overhead counts, more leave the cache."""
STEPS = 80
POOR, GOOD = 0.25, 0.5
"""A step that brings less than the first fraction of the predicted gain shortens the next ones, more than the second
lengthens them: the usual rule of trust regions (Nocedal and Wright, algorithm 4.1). Only their number depends on it."""
SHORTER, LONGER, LONGEST = 0.25, 2.0, 8.0
TAIL, MORE = 6.0, 1.2
"""Beyond the first of these logarithms a step is twice the one before where that brought more than this multiple of its
predicted gain: the distance tends to its limit at a plane as an exponential, on which all Newton steps are equally
short, and bring 1.26 times it. Not along an arm, where a long step passes over a minimum."""
AHEAD = 1e-5
"""Step of the differences that stand for second derivatives, in units of the smaller exponent up to 1."""
OVERFLOW = 700.0
"""Beyond its exponential no number of double precision is left."""
ROUNDING = 1e-15
"""Of the size and the distance: below their product a gain of half the squared distance is rounding."""

Index = NDArray[np.int64]


def has_ridges(superquadric: Superquadric) -> bool:
    """Whether the curvature is infinite somewhere."""
    return bool((superquadric.exponents > 1).any())


def has_arms(superquadric: Superquadric) -> bool:
    """Whether the surface ends in cusps: along an arm there may be a minimum beside that at its tip."""
    return bool(superquadric.exponents.max() > EXPONENTS[1])


def beside_ridges(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, beside: NDArray[np.bool_]
) -> tuple[Index, Array]:
    """More candidates for the nearest point: (m,) indices of targets, and undeformed surface points (m, 3).

    Args:
        superquadric: with an exponent above 1.
        box: carries the surface.
        targets: (n, 3).
        origins: (n, 3), a foot point of each beside a plane, before deformation.
        beside: (n, 3), which of its coordinates in the own frame are small beside the largest.
    """
    if not len(origins):
        return np.empty(0, dtype=np.int64), origins
    index, signs, start = _octants(superquadric, superquadric.scaled(origins), beside)
    scanned = _Search(superquadric, box, targets[index], signs).scanned(start, beside[index])
    if has_arms(superquadric):
        moved = np.flatnonzero((scanned != start).any(axis=1))
        scanned, signs = np.concatenate([scanned, start[moved]]), np.concatenate([signs, signs[moved]])
        index = np.concatenate([index, index[moved]])
    search = _Search(superquadric, box, targets[index], signs)
    return index, search.points(search.least(scanned))


def _octants(superquadric: Superquadric, scaled: Array, beside: NDArray[np.bool_]) -> tuple[Index, Array, Array]:
    """The parts of the surface around scaled points: index of the point, signs (m, 4) and logarithms t, u (m, 2)."""
    start = _logarithms(superquadric, scaled)
    own = np.where(scaled < 0, -1.0, 1.0)
    tube = np.ones(len(scaled))
    if KINDS[superquadric.kind].has_hole:
        tube[norm(scaled[:, 0], scaled[:, 1], superquadric.exponents[1]) < (superquadric.hole_radius or 0.0)] = -1
    indices, signs = [], []
    # beyond a plane that a point lies beside there may be a nearer one: its mirror images start searches too
    for mirror in product((1.0, -1.0), repeat=3):
        index = np.flatnonzero((beside | (np.array(mirror) > 0)).all(axis=1))
        indices.append(index)
        signs.append(np.column_stack([own[index] * mirror, tube[index]]))
    every = np.concatenate(indices)
    return every, np.concatenate(signs), start[every]


def _logarithms(superquadric: Superquadric, scaled: Array) -> Array:
    """t and u of scaled surface points, (n, 2)."""
    e1, e2 = superquadric.exponents
    x, y, z = (log_abs(column) for column in scaled.T)
    ring = norm(scaled[:, 0], scaled[:, 1], e2)
    latitude, longitude = KINDS[superquadric.kind].curves
    t = y - x if longitude == "circle" else y - _log_norm(2 / e1, z)
    u = z - log_abs(ring - (superquadric.hole_radius or 0.0)) if latitude == "circle" else z
    return np.clip(np.stack([t, u], axis=1), -FAR, FAR)


def _log_norm(k: float, t: Array) -> Array:
    """log N(1, e^t)."""
    return np.asarray(np.logaddexp(0, k * t) / k)


def _fraction(k: float, t: Array) -> Array:
    """Derivative of `_log_norm` by t."""
    return np.asarray(1 / (1 + np.exp(np.clip(-k * t, -OVERFLOW, OVERFLOW))))


def _rounding(size: float, value: Array) -> Array:
    """Gains (n,) that are rounding, where half the squared distances are `value`; of degree two in lengths."""
    distance = np.sqrt(2 * value)
    return np.asarray(ROUNDING * size * (distance + 1e-13 * size))


def _parts(along: tuple[bool, bool], count: int) -> list[Array]:
    """Pairs (k, 2) of logarithms that are scanned along t, u or both; so many pairs at once for `count` points."""
    pairs = np.array(list(product(*(SCAN if each else (0.0,) for each in along))))
    return np.array_split(pairs, min(len(pairs), 1 + len(pairs) * count // AT_ONCE)) if count else []


@dataclass(frozen=True)
class _Search:
    """Damped Newton steps over t and u, each target in a part of the surface between coordinate planes.

    Attributes:
        superquadric: whose surface.
        box: carries it.
        targets: (n, 3).
        signs: (n, 4), of x, y, z and of the side of the tube's core.
    """

    superquadric: Superquadric
    box: ControlBox
    targets: Array
    signs: Array

    def scaled(self, index: Index, at: Array) -> Array:
        """Scaled surface points (n, 3) at t, u (n, 2)."""
        # the formulas of the module in logarithms, where no power overflows
        (t, u), signs = at.T, self.signs[index]
        k1, k2 = 2 / self.superquadric.exponents
        log_t, log_u = _log_norm(k2, t), _log_norm(k1, u)
        latitude, longitude = self._kind.curves
        log_s, log_z = (-log_u, u - log_u) if latitude == "circle" else (log_u, u)
        log_x = log_s - log_t if longitude == "circle" else log_s + log_t
        log_y = (log_x if longitude == "circle" else log_s) + t
        q = signs[:, :3] * np.exp(np.stack([log_x, log_y, log_z], axis=1))
        if self._kind.has_hole:
            # the ring a4 +- s in place of s: add the core of the tube, with the sign of the side of it
            core = self._hole * np.exp(np.stack([-log_t, t - log_t], axis=1))
            q[:, :2] = signs[:, 3:] * q[:, :2] + signs[:, :2] * core
        return q

    def derivatives(self, index: Index, at: Array, scaled: Array) -> tuple[Array, Array]:
        """Derivatives of scaled surface points (n, 3) by t and by u, each (n, 3)."""
        k1, k2 = 2 / self.superquadric.exponents
        # coordinates are products of powers, so their derivatives are themselves times those of their logarithms
        p, r, one = _fraction(k2, at[:, 0]), _fraction(k1, at[:, 1]), np.ones(len(at))
        latitude, longitude = self._kind.curves
        by_t = scaled * np.stack([-p, 1 - p, 0 * one] if longitude == "circle" else [p, one, 0 * one], axis=1)
        by_u = scaled * np.stack([-r, -r, 1 - r] if latitude == "circle" else [r, r, one], axis=1)
        if self._kind.has_hole:
            tube = self.signs[index, 3] * np.exp(-_log_norm(k1, at[:, 1]))
            by_u[:, :2] *= (tube / (self._hole + tube))[:, None]
        return by_t, by_u

    @property
    def _kind(self) -> Kind:
        return KINDS[self.superquadric.kind]

    @property
    def _hole(self) -> float:
        return self.superquadric.hole_radius or 0.0

    def to_world(self, scaled: Array) -> Array:
        """Directions of scaled coordinates in the world."""
        return (scaled * self.superquadric.semi_axes) @ self.superquadric.rotation.T

    def points(self, at: Array) -> Array:
        """Undeformed surface points of all targets, (n, 3)."""
        return self._in_space(self.scaled(np.arange(len(at)), at))

    def _in_space(self, scaled: Array) -> Array:
        return self.superquadric.to_world(scaled * self.superquadric.semi_axes)

    @np.errstate(over="ignore", invalid="ignore")
    def value(self, index: Index, at: Array) -> Array:
        """Half the squared distance (n,) of some targets; infinite beyond the range of coordinates."""
        points = self._in_space(self.scaled(index, at))
        far = (np.abs(points) > LARGEST).any(axis=1)
        points[far] = self.superquadric.translation
        half = ((self.targets[index] - self.box.deform(points)) ** 2).sum(axis=1) / 2
        return np.where(far | np.isnan(half), np.inf, half)

    def gradient(self, index: Index, at: Array) -> Array:
        """Its derivatives by t and u, (n, 2)."""
        q = self.scaled(index, at)
        points = self._in_space(q)
        offset = self.targets[index] - self.box.deform(points)
        undeformed = np.einsum("nij,ni->nj", self.box.jacobian(points), offset)
        by_parameters = self.derivatives(index, at, q)
        return -np.stack([(undeformed * self.to_world(by)).sum(axis=1) for by in by_parameters], axis=1)

    def scanned(self, start: Array, beside: NDArray[np.bool_]) -> Array:
        """The best t and u among the start and a few logarithms of the coordinates that are beside planes."""
        best = start.copy()
        value = self.value(np.arange(len(start)), best)
        # t runs along x and y, u along z: only the logarithms of coordinates beside a plane are scanned.
        sideways = np.stack([beside[:, 0] | beside[:, 1], beside[:, 2] | (beside[:, 0] & beside[:, 1])], axis=1)
        for along in ((False, True), (True, False), (True, True)):
            index = np.flatnonzero((sideways == along).all(axis=1))
            for numbers in _parts(along, len(index)):
                # all numbers of a part at once: (numbers, points, 2)
                trials = np.where(along, numbers[:, None], start[index])
                found = self.value(np.tile(index, len(numbers)), trials.reshape(-1, 2)).reshape(trials.shape[:2])
                first, row = found.argmin(axis=0), np.arange(len(index))
                closer = found[first, row] < value[index]
                best[index[closer]] = trials[first, row][closer]
                value[index[closer]] = found[first, row][closer]
        return best

    def least(self, start: Array) -> Array:
        """The t and u of the least distance, by Newton steps within a radius that follows their success."""
        at, active, (radius, growth) = start.copy(), np.arange(len(start)), np.ones((2, len(start)))
        size, value = float(np.linalg.norm(self.box.edges)), self.value(active, at)
        most = 1.0 if has_arms(self.superquadric) else LONGEST
        for _ in range(STEPS):
            if not len(active):
                break
            step, predicted = self._step(active, at[active], radius[active])
            step *= np.where(np.abs(at[active]) > TAIL, growth[active, None], 1.0)
            trial = np.clip(at[active] + step, -FAR, FAR)
            found = self.value(active, trial)
            gain = value[active] - found
            closer = found < value[active]
            long = np.hypot(*step.T)
            radius[active] = np.select(
                [gain < POOR * predicted, gain > GOOD * predicted],
                [SHORTER * long, np.minimum(LONGER * radius[active], LONGEST)],
                radius[active],
            )
            growth[active] = np.where(gain > MORE * predicted, np.minimum(LONGER * growth[active], most), 1.0)
            at[active[closer]], value[active[closer]] = trial[closer], found[closer]
            active = active[(predicted > _rounding(size, value[active])) & (radius[active] > 1e-9)]
        return at

    def _step(self, index: Index, at: Array, radius: Array) -> tuple[Array, Array]:
        """Newton steps (n, 2), downhill also where the curvature is negative, and the gains that they predict."""
        ahead = AHEAD * np.minimum(1, self.superquadric.exponents[::-1])
        # there, and a little along t and along u: in one call, for most of a call is overhead
        near = at + np.stack([0 * ahead, ahead * [1, 0], ahead * [0, 1]])[:, None]
        gradient, *others = self.gradient(np.tile(index, 3), near.reshape(-1, 2)).reshape(3, -1, 2)
        by_t, by_u = ((other - gradient) / shift for other, shift in zip(others, ahead))
        a, b, c = by_t[:, 0], (by_t[:, 1] + by_u[:, 0]) / 2, by_u[:, 1]
        # Scaled to a unit diagonal, so that the Hessian is well conditioned.
        scale = np.sqrt(np.maximum(np.abs(np.stack([a, c], axis=1)), 1e-300))  # t may matter far less than u
        by_scaled = gradient / scale
        first, cross, last = a / scale[:, 0] ** 2, b / scale.prod(axis=1), c / scale[:, 1] ** 2
        # Eigenvalues and eigenvectors of the symmetric 2 x 2 matrix in closed form.
        half, angle = np.hypot((first - last) / 2, cross), 0.5 * np.arctan2(cross, (first - last) / 2)
        step = np.zeros_like(at)
        for curvature, rotation in (((first + last) / 2 + half, 0.0), ((first + last) / 2 - half, np.pi / 2)):
            axis = np.stack([np.cos(angle + rotation), np.sin(angle + rotation)], axis=1)
            along = -(by_scaled * axis).sum(axis=1) / np.maximum(np.abs(curvature), 1e-12)
            step += along[:, None] * axis
        step = np.clip(step / scale, -radius[:, None], radius[:, None])
        # a clipped Newton step need not descend; a step along one coordinate is taken where it predicts a larger gain
        rise = (gradient * step).sum(axis=1) + (a * step[:, 0] ** 2 + c * step[:, 1] ** 2) / 2 + b * step.prod(axis=1)
        alone = np.clip(-gradient / scale**2, -radius[:, None], radius[:, None])
        gains = -(gradient * alone + np.stack([a, c], axis=1) * alone**2 / 2)
        single = alone * (gains == gains.max(axis=1, keepdims=True))
        worse = -rise < gains.max(axis=1)
        return np.where(worse[:, None], single, step), np.where(worse, gains.max(axis=1), -rise)
