"""The free-form deformation: a box of control points that carries the space inside it (paper 3.1, appendix B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from quadriform.errors import OptionError, PointsError
from quadriform.points import LARGEST, Array, check_points, fixed_array
from quadriform.shapes import _kernel, bernstein
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import threads_for
from quadriform.words import short_repr

NEWTON_STEPS = 60
SKEW = 1e-8
"""Largest cosine between edges that are called orthogonal."""
NEWTON_TOLERANCE = 1e-13
"""`undeform` stops when the residual is below this fraction of the box's diagonal."""
STARTS, NODES = 6, 13
"""Nodes of a grid, of so many along each axis, from which `undeform` starts before a point counts as missed."""
MARGIN = 0.2
"""Of a second grid beyond the box, for points without a preimage inside it."""
ACCEPT_TOLERANCE = 1e4 * NEWTON_TOLERANCE
"""Largest residual of a preimage, in diagonals: rounding grows with the coordinates, so it is above that of the
steps."""
ON_SIDE = 1e-9
"""Preimages beyond a side of the box by less, in its lengths, are inside."""
LEAST_DAMPING = 1e-9
"""Below this a step does not descend: there is no solution from this start."""
INSIDE, OUTSIDE, MISSED = 0, 1, 2


@dataclass(frozen=True, repr=False)
class ControlBox:
    """A rectangular box with a lattice of (l+1)(m+1)(n+1) control points, which deform the space inside it.

    Attributes:
        origin: (3,), the corner X0 of the undeformed box, in the world; no relation to the `origins` of surface
            points elsewhere, which are these points before deformation.
        edges: (3, 3), rows S, T, U, orthogonal to each other and not zero: the local coordinates (P15, P16) are
            projections onto each of them.
        control_points: (l+1, m+1, n+1, 3); index i runs along S, j along T, k along U, all upwards.

    Raises:
        OptionError: another shape, numbers that are not finite or beyond 1e30, edges that are zero or not orthogonal.
    """

    __repr__ = short_repr

    origin: Array
    edges: Array
    control_points: Array

    def __post_init__(self) -> None:
        for name, shape in (("origin", (3,)), ("edges", (3, 3)), ("control_points", None)):
            object.__setattr__(self, name, fixed_array(getattr(self, name), name, shape))
        grid = self.control_points.shape
        if len(grid) != 4 or grid[3] != 3 or min(grid[:3]) < 2:
            raise OptionError(f"control_points: expected shape (l+1, m+1, n+1, 3) with l, m, n >= 1, found {grid}")
        _check_edges(self.edges)

    @classmethod
    def around(cls, superquadric: Superquadric, shape: tuple[int, int, int] = (5, 5, 5)) -> ControlBox:
        """The undeformed box that touches a superquadric: sides 2 a1, 2 a2, 2 a3 in its pose (paper 3.2.1).

        Args:
            superquadric: its pose gives the axes; kinds other than the ellipsoid take the box of their extent.
            shape: control points along each axis.
        """
        half = superquadric.semi_axes  # section 3.2.1
        if not superquadric.is_radial:
            half = np.abs(superquadric.to_local(superquadric.grid(16)[0])).max(axis=0)
        edges = 2 * half[:, None] * superquadric.rotation.T
        return cls.undeformed(superquadric.translation - edges.sum(axis=0) / 2, edges, shape)

    @classmethod
    def undeformed(cls, origin: Array, edges: Array, shape: tuple[int, int, int]) -> ControlBox:
        """The undeformed box: its control points are at even positions, and `deform` is the identity."""
        return cls(origin, edges, origin + _lattice(shape) @ edges)  # P17

    def transformed(self, scale: float, offset: Array) -> ControlBox:
        """The same deformation after `scale` x + `offset`: from a centred, scaled frame back to the world."""
        return ControlBox(scale * self.origin + offset, scale * self.edges, scale * self.control_points + offset)

    def rotated(self, rotation: Array) -> ControlBox:
        """The same deformation after a rotation (3, 3) about the world's origin."""
        return ControlBox(rotation @ self.origin, self.edges @ rotation.T, self.control_points @ rotation.T)

    @property
    def degrees(self) -> tuple[int, int, int]:
        """The degrees (l, m, n): one less than the control points along each axis."""
        along_s, along_t, along_u = self._counts
        return along_s - 1, along_t - 1, along_u - 1

    @property
    def _counts(self) -> tuple[int, int, int]:
        """The number of control points along each axis: one more than the degrees."""
        along_s, along_t, along_u = self.control_points.shape[:3]
        return along_s, along_t, along_u

    @property
    def rest(self) -> Array:
        """The control points of the undeformed box, (l+1, m+1, n+1, 3)."""
        return ControlBox.undeformed(self.origin, self.edges, self._counts).control_points

    def with_control_points(self, control_points: Array) -> ControlBox:
        """The box with other control points, given as an array of the same size."""
        return replace(self, control_points=np.reshape(control_points, self.control_points.shape))

    def local(self, points: ArrayLike) -> Array:
        """Local coordinates s, t, u of world points, (n, 3); inside the box they lie in [0, 1]."""
        lengths = (self.edges**2).sum(axis=1)
        return (check_points(points) - self.origin) @ self.edges.T / lengths  # P15, P16

    def deform(self, points: ArrayLike) -> Array:
        """The world points (n, 3) after deformation; any points, not only those of the surface.

        Outside the undeformed box the same polynomials extrapolate.
        """
        given = check_points(points)
        result = np.empty_like(given)
        _kernel.deform(self.compiled(), given, result, threads_for(len(given)))  # P19
        return result

    def matrix(self, points: ArrayLike) -> Array:
        """Deformation matrix B, (n, (l+1)(m+1)(n+1)), with deformed points = B P; the last index runs fastest."""
        local = self.local(points)
        factors = [bernstein.basis(local[:, axis], degree) for axis, degree in enumerate(self.degrees)]
        return bernstein.products(factors)  # P5, P18

    def jacobian(self, points: ArrayLike) -> Array:
        """d deformed / d point, (n, 3, 3), rows the deformed coordinates; the deformation gradient."""
        given = check_points(points)
        result = np.empty((len(given), 3, 3))
        _kernel.jacobian(self.compiled(), given, result, threads_for(len(given)))
        return result

    def jacobian_determinant(self, points: ArrayLike) -> Array:
        """Determinants (n,) of `jacobian` at world points (n, 3): local changes of volume; negative where it folds."""
        a, b, c = np.ascontiguousarray(self.jacobian(points).transpose(1, 2, 0))
        return (a * np.cross(b, c, axis=0)).sum(axis=0)

    def compiled(self) -> _kernel.Box:
        """The box in the form of the compiled loops."""
        return _kernel.Box(self.origin, self._local_by_point, self.control_points)

    def matrix_gradient(self, points: ArrayLike) -> Array:
        """Derivatives of `matrix` by the world points, (n, (l+1)(m+1)(n+1), 3)."""
        local = self.local(points)
        plain = [bernstein.basis(local[:, a], d) for a, d in enumerate(self.degrees)]
        derivatives = [bernstein.basis_derivative(local[:, a], d) for a, d in enumerate(self.degrees)]
        along = [bernstein.products([derivatives[a] if a == axis else plain[a] for a in range(3)]) for axis in range(3)]
        return np.stack(along, axis=2) @ self._local_by_point

    @property
    def _local_by_point(self) -> Array:
        """d (s, t, u) / d point, (3, 3)."""
        return self.edges / (self.edges**2).sum(axis=1, keepdims=True)

    def undeform(self, points: ArrayLike) -> Array:
        """The points (n, 3) before deformation: the inverse of `deform`, by damped Newton steps.

        Starts from the nearest of a grid of deformed points. Beyond the box the polynomials soon fold, so a preimage
        inside it is preferred to one outside.

        Raises:
            PointsError: points without a preimage in or near the box.
        """
        target = check_points(points)
        result = np.empty_like(target)
        with np.errstate(over="ignore", invalid="ignore"):  # points far beyond any box overflow, and are refused
            for start in range(0, len(target), bernstein.CHUNK):
                part = slice(start, start + bernstein.CHUNK)
                result[part] = self._invert(target[part])
            missed = self._grade(result, target) == MISSED
        if missed.any():
            first = int(missed.argmax())
            raise PointsError(
                f"undeform: {int(missed.sum())} of {len(target)} points have no preimage near the box, the first at "
                f"index {first} ({target[first]}); expected points inside the deformed box"
            )
        return result

    @property
    def _size(self) -> float:
        return float(np.linalg.norm(self.edges))

    def _invert(self, target: Array) -> Array:
        """The best of several Newton runs; grids beyond the box only for points without any preimage so far."""
        best, grade = target.copy(), np.full(len(target), MISSED)
        for margin, solved in ((0.0, INSIDE), (MARGIN, OUTSIDE)):
            for start in self._starts(target, margin):
                left = np.flatnonzero(grade > solved)
                if not len(left):
                    break
                trial = self._newton(target[left], start[left])
                found = self._grade(trial, target[left])
                better = found <= grade[left]
                best[left[better]], grade[left[better]] = trial[better], found[better]
        return best

    def _grade(self, preimages: Array, target: Array) -> Array:
        """The grade of each preimage: INSIDE the box, exact but OUTSIDE by less than its side, or MISSED."""
        outside = np.abs(self.local(preimages) - 0.5).max(axis=1) - 0.5
        exact = np.linalg.norm(self.deform(preimages) - target, axis=1) <= ACCEPT_TOLERANCE * self._size
        return np.where(exact & (outside < 1), np.where(outside < ON_SIDE, INSIDE, OUTSIDE), MISSED)

    def _starts(self, target: Array, margin: float) -> Array:
        """The nodes of a grid, wider than the box by a margin, with images nearest to each target, (STARTS, n, 3)."""
        steps = np.linspace(-margin, 1 + margin, NODES)
        grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        nodes = self.origin + grid @ self.edges
        nearest = cKDTree(self.deform(nodes)).query(target, k=STARTS)[1]
        return nodes[nearest.T]

    def _newton(self, target: Array, start: Array) -> Array:
        """The preimages (n, 3) that damped Newton steps x - (df / dx)^-1 (f(x) - target) reach from their starts."""
        point = start.copy()
        error = self.deform(point) - target
        damping = np.ones(len(target))
        for _ in range(NEWTON_STEPS):
            active = np.flatnonzero(np.linalg.norm(error, axis=1) > NEWTON_TOLERANCE * self._size)
            active = active[damping[active] > LEAST_DAMPING]
            if not len(active):
                break
            # Only points that have not converged are evaluated again.
            jacobian = self.jacobian(point[active])
            step = _solve_each(jacobian, error[active])
            trial = point[active] - damping[active, None] * step
            moved = self.deform(trial) - target[active]
            better = np.linalg.norm(moved, axis=1) < np.linalg.norm(error[active], axis=1)
            good, bad = active[better], active[~better]
            point[good], error[good] = trial[better], moved[better]
            damping[good], damping[bad] = np.minimum(1, 2 * damping[good]), damping[bad] / 4
        return point

    def elevate(self, degrees: tuple[int, int, int]) -> ControlBox:
        """The same deformation with more control points, exactly.

        Args:
            degrees: the new (l, m, n), none below the present ones.

        Raises:
            OptionError: a degree would have to go down.
        """
        if any(high < low for low, high in zip(self.degrees, degrees)):
            raise OptionError(f"degrees={degrees}: expected none below the present {self.degrees}")
        elevated = self.control_points
        for axis, (low, high) in enumerate(zip(self.degrees, degrees)):
            elevated = bernstein.along(axis, bernstein.elevation(low, high), elevated)
        return replace(self, control_points=elevated)


def outer_box(superquadrics: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> ControlBox:
    """The undeformed box around the largest of several surfaces."""
    return ControlBox.around(max(superquadrics.values(), key=_box_volume), shape)


def common_box(superquadrics: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> ControlBox:
    """The undeformed box of the largest surface, enlarged to contain the others."""
    outer = max(superquadrics.values(), key=_box_volume)
    box = ControlBox.around(outer, shape)
    if len(superquadrics) == 1:
        return box
    corner = outer.to_local(box.origin[None])[0]
    grids = [outer.to_local(s.grid(12)[0]) for s in superquadrics.values()]
    # In the frame of the largest surface, whose centre is the middle of its own box.
    low = np.minimum(corner, np.concatenate(grids).min(axis=0))
    high = np.maximum(-corner, np.concatenate(grids).max(axis=0))
    edges = (high - low)[:, None] * outer.rotation.T
    return ControlBox.undeformed(outer.to_world(low[None])[0], edges, shape)


def _box_volume(superquadric: Superquadric) -> float:
    return float(np.abs(np.linalg.det(ControlBox.around(superquadric, (2, 2, 2)).edges)))


def _check_edges(edges: Array) -> None:
    lengths = np.sqrt((edges**2).sum(axis=1))
    if not (lengths > 1 / LARGEST).all():
        raise OptionError(f"edges: expected three edges that are not zero, found lengths {lengths.tolist()}")
    unit = edges / lengths[:, None]
    # the Gram matrix of unit edges has the cosines of their angles off the diagonal
    cosines = np.abs(unit @ unit.T - np.eye(3))
    if not cosines.max() <= SKEW:
        angle = float(np.degrees(np.arccos(min(1.0, cosines.max()))))
        raise OptionError(
            f"edges: expected three edges at right angles, found two at {angle:.6g} degrees; "
            "a sheared box has no local coordinates by projection"
        )


@lru_cache(maxsize=16)
def _lattice(counts: tuple[int, int, int]) -> Array:
    """Even positions in the unit cube, (*counts, 3); cached, for every iteration of a fit compares with them."""
    steps = [np.linspace(0, 1, count) for count in counts]
    lattice = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
    lattice.setflags(write=False)
    return lattice


def _solve_each(matrices: Array, right: Array) -> Array:
    """Solve (n, 3, 3) x = (n, 3) by least squares with a small damping, so that a singular one moves little."""
    transposed = matrices.transpose(0, 2, 1)
    gram = transposed @ matrices
    # At a fold the Jacobian is singular, and the step is limited instead of infinite.
    gram = gram + 1e-14 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.linalg.solve(gram, transposed @ right[:, :, None])[:, :, 0]
