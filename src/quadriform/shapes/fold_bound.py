"""A proof that the deformation does not fold: a lower bound of the Jacobian's determinant over a whole region.

The determinant of a Bernstein map is a Bernstein polynomial itself, and its least coefficient is a lower bound of it
everywhere, not only at samples. Halving the region (an octree) makes the bound as tight as required; the leaves of the
lowest bound are split first, and leaves that lie outside the surfaces are dropped. "Box" is the undeformed control box;
low corners and sides of leaves are in its coordinates, from 0 to 1.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes import bernstein
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superellipse import norm, quiet
from quadriform.shapes.superquadric import Superquadric

BUDGET = 8_000
"""Leaves made before the search ends with the bound so far: some seconds, and 14 kB each for 5 x 5 x 5 points."""
BATCH = 32
"""Leaves of the lowest bound that are split at once, or a quarter of all if that is more."""
SLACK = 1e-9
"""Fraction of its size by which a surface is enlarged, so that rounding drops no leaf or point that touches it."""
TIGHT, SIGN_ONLY, POSITIVE = 0.02, 0.5, 0.99
"""Relative tolerances of a bound: where it is reported, where its size hardly matters, and where it need not."""
SAMPLES = 25
"""Points along each axis of the grid on which `possible_folds` evaluates the determinant."""


@dataclass(frozen=True)
class Bound:
    """What is known of the smallest determinant over a region.

    Attributes:
        lower: no point of the region has a smaller determinant; proven, rounding included.
        sampled: the smallest determinant at a sampled point of the region; the true minimum lies in [lower, sampled].
        where: (3,), that point before deformation.
    """

    lower: float
    sampled: float
    where: Array


@dataclass(frozen=True)
class _Leaves:
    """Parts of the region: Bernstein coefficients (n, a, b, c) over them, low corners and sides (n, 3) in the box."""

    coefficients: Array
    low: Array
    side: Array

    def at(self, index: NDArray) -> "_Leaves":
        """The leaves at an index or where a mask is true."""
        return _Leaves(self.coefficients[index], self.low[index], self.side[index])

    def joined(self, other: "_Leaves") -> "_Leaves":
        """These leaves and then others."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("coefficients", "low", "side"))
        return _Leaves(*(np.concatenate(pair) for pair in pairs))

    def lowest(self) -> Array:
        """The least coefficient (n,) of each leaf, a lower bound of the determinant there."""
        return self.coefficients.min(axis=(1, 2, 3))

    def halved(self) -> "_Leaves":
        """The eight children of each leaf; every axis is halved in turn."""
        coefficients, low, side = self.coefficients, self.low, self.side
        for axis in range(3):
            half = side * np.where(np.arange(3) == axis, 0.5, 1)
            low = np.concatenate([low, low + half * (np.arange(3) == axis)])
            coefficients, side = _halved(coefficients, axis), np.concatenate([half, half])
        return _Leaves(coefficients, low, side)

    def corners(self) -> tuple[Array, Array]:
        """Box coordinates (n, 8, 3) of the corners and the values there (n, 8), which are coefficients."""
        ends = np.array(list(product((0, 1), repeat=3)))
        # along each axis the coefficient of index 0 is the value at the low end, and that of index -1 at the high end
        values = self.coefficients[:, -ends[:, 0], -ends[:, 1], -ends[:, 2]]
        return self.low[:, None] + ends * self.side[:, None], values


def _halved(coefficients: Array, axis: int) -> Array:
    """Coefficients (2 n, a, b, c) over the first halves along an axis of n leaves, and then over the second ones."""
    n, *shape = coefficients.shape
    found = np.empty((2, n, *shape))
    before, count, after = n * int(np.prod(shape[:axis])), shape[axis], int(np.prod(shape[axis + 1 :]))
    for half, matrix in zip(found, _halves(count - 1)):
        # no axis is moved, and each product is too small for BLAS to start threads, which take longer than it
        if axis == 2:
            leaves = n, shape[0] * shape[1], count
            np.matmul(coefficients.reshape(leaves), matrix.T, out=half.reshape(leaves))
        else:
            rows = before, count, after
            np.matmul(matrix, coefficients.reshape(rows), out=half.reshape(rows))
    return found.reshape(2 * n, *shape)


@lru_cache(maxsize=32)
def _halves(degree: int) -> tuple[Array, Array]:
    """Matrices from the coefficients over an interval to those over its halves; cached for the few degrees in use."""
    return bernstein.restriction(degree, 0, 0.5), bernstein.restriction(degree, 0.5, 1)


def jacobian_bound(
    box: ControlBox,
    surfaces: Iterable[Superquadric] = (),
    tolerance: float = TIGHT,
    budget: int = BUDGET,
    low_enough: float = -np.inf,
) -> Bound:
    """A lower bound of det(d deformed / d point) over the inside of surfaces, or over the whole box.

    Args:
        box: the deformation.
        surfaces: undeformed; the region is the union of their insides (of hyperboloids: of their bounding cuboids);
            without any it is the box.
        tolerance: the search ends when `lower` is within this fraction of |`sampled`|, apart from rounding.
        budget: the search ends, with a looser bound, when it has made this many leaves.
        low_enough: the search ends, with a looser bound, when it has found a determinant that is as low as this.
    """
    surfaces = tuple(surfaces)
    root, rounding = _root(box, surfaces)
    sampled, where = _first_sample(box, surfaces)
    leaves, finished_bound, rounds, made = root, np.inf, 0, 1
    while True:
        # A leaf without a point of the body cannot contain its minimum.
        leaves = leaves.at(~_outside_all(box, surfaces, leaves))
        sampled, where = _sample(box, surfaces, leaves, sampled, where)
        lowest = leaves.lowest()
        # Leaves whose bound is near enough to a determinant that occurs need no further halving.
        finished = lowest >= sampled - tolerance * abs(sampled)
        finished_bound = min(finished_bound, lowest[finished].min(initial=np.inf))
        leaves, lowest = leaves.at(~finished), lowest[~finished]
        if not len(lowest) or made >= budget or sampled <= low_enough:
            break
        order = np.argsort(lowest, kind="stable")
        batch = min(max(BATCH, len(order) // 4), len(order))
        leaves = leaves.at(order[batch:]).joined(leaves.at(order[:batch]).halved())
        rounds, made = rounds + 1, made + 8 * batch
    # Every halving rounds the coefficients once more.
    lower = min(finished_bound, lowest.min(initial=np.inf), sampled)
    return Bound(float(lower - rounding * (1 + rounds)), float(sampled), where)


def never_folds(box: ControlBox, surfaces: Iterable[Superquadric]) -> bool:
    """Whether the determinant is provably positive all over the inside of surfaces."""
    return positive_bound(box, surfaces).lower > 0


def positive_bound(box: ControlBox, surfaces: Iterable[Superquadric]) -> Bound:
    """A bound by the search that ends as soon as the determinant is known to be positive, or not to be."""
    return jacobian_bound(box, surfaces, tolerance=POSITIVE, low_enough=0.0)


def determinant_lower_bound(box: ControlBox, surfaces: Iterable[Superquadric], budget: int = BUDGET) -> float:
    """The largest proven lower bound of the determinant over the inside of surfaces; positive where none folds.

    The search of a tight bound spends its budget on more leaves and can end below a loose one. Where both are not
    positive, that of `never_folds` may be.
    """
    surfaces = tuple(surfaces)
    found = max(jacobian_bound(box, surfaces, tolerance, budget).lower for tolerance in (SIGN_ONLY, TIGHT))
    return found if found > 0 else max(found, jacobian_bound(box, surfaces, POSITIVE, budget).lower)


def possible_folds(box: ControlBox, surfaces: Iterable[Superquadric]) -> Array:
    """Points (n, 3) before deformation, inside the surfaces, where the map folds or is not proven not to fold.

    Returns:
        An empty array when the bound proves the determinant positive. Otherwise the sampled point of the lowest
        determinant, and then the folded points of a grid. The determinant at the first may be positive: then no fold
        was found, but the proof did not succeed either.
    """
    surfaces = tuple(surfaces)
    if never_folds(box, surfaces):
        return np.empty((0, 3))
    bound = jacobian_bound(box, surfaces, tolerance=SIGN_ONLY)
    points = grid_inside(box, surfaces)
    folded = points[box.jacobian_determinant(points) <= 0] if len(points) else points
    return np.concatenate([bound.where[None], folded])


def grid_inside(box: ControlBox, surfaces: Sequence[Superquadric], count: int = SAMPLES) -> Array:
    """Points (n, 3) before deformation inside the surfaces, of a grid with `count` along each axis."""
    low, high = _range(box, tuple(surfaces))
    steps = np.linspace(0, 1, count)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    points = box.origin + (low + grid * (high - low)) @ box.edges
    return points[_inside_any(tuple(surfaces), points)]


def determinant_rows(box: ControlBox, points: Array) -> Array:
    """Derivatives of det(d deformed / d point) at (n, 3) points by the control points, (n, 3 k), coordinates together.

    The derivative of a determinant by its matrix is the matrix of its cofactors.
    """
    a, b, c = np.moveaxis(box.jacobian(points), 1, 0)
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return (box.matrix_gradient(points) @ cofactors.transpose(0, 2, 1)).reshape(len(points), -1)


def _root(box: ControlBox, surfaces: tuple[Superquadric, ...]) -> tuple[_Leaves, float]:
    """The whole region as one leaf, and a bound of the rounding error of a coefficient, there and in each halving.

    A sum of k products errs by at most k eps times the sum of their magnitudes, and the k of nested sums add up. With N
    control points, an inner sum in `_triple` has at most 2 N terms and an outer one 3 N; counted are 6 N for both. The
    restrictions of the three derivatives, and one halving, sum over each axis at most as many terms as the result has
    coefficients along it; with the entries of their matrices, which are sums too, ten times as many are counted.
    """
    low, high = _range(box, surfaces)
    derivatives, sizes = [], []
    for axis, degree in enumerate(box.degrees):
        derivative = degree * np.diff(box.control_points, axis=axis)
        # Magnitudes are propagated beside the coefficients to bound their rounding errors.
        size = np.abs(derivative)
        for k in range(3):
            matrix = bernstein.restriction(derivative.shape[k] - 1, low[k], high[k])
            derivative, size = bernstein.along(k, matrix, derivative), bernstein.along(k, np.abs(matrix), size)
        derivatives.append(derivative)
        sizes.append(size)
    per_volume = np.linalg.det(box.edges / (box.edges**2).sum(axis=1, keepdims=True))
    coefficients = per_volume * _triple(derivatives, -1.0)
    magnitude = abs(per_volume) * _triple(sizes, 1.0).max()
    terms = 2 * box.control_points.size + 10 * sum(coefficients.shape)
    rounding = float(terms * np.finfo(np.float64).eps * magnitude)
    return _Leaves(coefficients[None], low[None], (high - low)[None]), rounding


def _triple(columns: list[Array], sign: float) -> Array:
    """Coefficients of a . (b x c) for polynomial vectors; with sign +1 and magnitudes, the size of its terms."""
    a, b, c = columns
    total = np.zeros(())
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        minor = bernstein.product(b[..., j], c[..., k]) + sign * bernstein.product(b[..., k], c[..., j])
        total = total + bernstein.product(a[..., i], minor)
    return total


def _range(box: ControlBox, surfaces: tuple[Superquadric, ...]) -> tuple[Array, Array]:
    """Box coordinates that the surfaces lie between; all of the box without surfaces."""
    if not surfaces:
        return np.zeros(3), np.ones(3)
    signs = np.array(list(product((-1, 1), repeat=3)))
    corners = []
    for surface in surfaces:
        # The bounding cuboid of the surface in its own frame: its corners bound the region, however the box is rotated.
        # An even grid has the surface's points on its axes and its cuts, where each coordinate is largest.
        half = np.abs(surface.to_local(surface.grid(16)[0])).max(axis=0)
        corners.append(box.local(surface.to_world(signs * half)))
    local = np.concatenate(corners)
    whole = np.round(local)  # the box that touches the surface has ranges of exactly 0 to 1
    local = np.where(np.abs(local - whole) < SLACK, whole, local)
    return local.min(axis=0), local.max(axis=0)


def _first_sample(box: ControlBox, surfaces: tuple[Superquadric, ...]) -> tuple[float, Array]:
    """The smallest determinant on the surfaces, or in the middle of the box without any."""
    points = np.concatenate([s.grid(8)[0] for s in surfaces] or [(box.origin + box.edges.sum(axis=0) / 2)[None]])
    values = box.jacobian_determinant(points)
    return float(values.min()), points[values.argmin()]


def _sample(
    box: ControlBox, surfaces: tuple[Superquadric, ...], leaves: _Leaves, sampled: float, where: Array
) -> tuple[float, Array]:
    """The smallest value so far, with the leaves' corners inside the surfaces."""
    corners, values = leaves.corners()
    below = values < sampled
    if not below.any():
        return sampled, where
    points, values = box.origin + corners[below] @ box.edges, values[below]
    values = np.where(_inside_any(surfaces, points), values, np.inf)
    best = values.argmin()
    return (float(values[best]), points[best]) if values[best] < sampled else (sampled, where)


def _inside_any(surfaces: tuple[Superquadric, ...], points: Array) -> NDArray[np.bool_]:
    if not surfaces:
        return np.ones(len(points), dtype=bool)
    return np.any([surface.implicit(points) <= 1 + SLACK for surface in surfaces], axis=0)


def _outside_all(box: ControlBox, surfaces: tuple[Superquadric, ...], leaves: _Leaves) -> NDArray[np.bool_]:
    if not surfaces or not len(leaves.low):
        return np.zeros(len(leaves.low), dtype=bool)
    centres = box.origin + (leaves.low + leaves.side / 2) @ box.edges
    halves = leaves.side[:, :, None] / 2 * box.edges
    return np.all([_outside(surface, centres, halves) for surface in surfaces], axis=0)


@quiet
def _outside(surface: Superquadric, centres: Array, halves: Array) -> NDArray[np.bool_]:
    """Which parallelepipeds, centres (n, 3) and half edges (n, 3, 3), lie wholly outside a closed surface.

    F grows with |x|, |y| and |z| of the surface's frame, so F at the smallest of each bounds it from below; exact
    where the edges have the directions of the surface's axes.
    """
    if KINDS[surface.kind].cut_axis is not None:
        return np.zeros(len(centres), dtype=bool)
    # Interval arithmetic: the smallest and largest |x|, |y|, |z| within each parallelepiped.
    middle = np.abs(surface.scaled(centres))
    reach = np.abs(halves @ surface.rotation).sum(axis=1) / surface.semi_axes
    near, far = np.maximum(middle - reach, 0), middle + reach
    e1, e2 = surface.exponents
    ring = norm(near[:, 0], near[:, 1], e2)
    if surface.hole_radius is not None:
        ring = np.maximum(ring - surface.hole_radius, surface.hole_radius - norm(far[:, 0], far[:, 1], e2))
    return norm(np.maximum(ring, 0), near[:, 2], e1) > 1 + SLACK
