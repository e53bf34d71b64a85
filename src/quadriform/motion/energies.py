"""The energies in space of a cycle: that of a regulariser, and what is asked of any.

An energy of the displacements u (k, 3) of the control points from the undeformed box is quadratic. It is given in
coordinates c with u = B c, with a matrix B (k, k) for each of the three axes, in which its null space is not lost in
rounding: the eigenvectors of a regulariser, or the coordinates of a prior (`fitting/population/coordinates.py`). M is
the matrix of the mean square of u over the box in these coordinates.

The energy of a motion is the mean over time of that of a regulariser, or the mean over the frames of that of a
population, whose pose in each frame is its own. The unknowns p (K, 3 k) are coordinates in the eigenbasis of time
(`cycle_equations.py`), in which the splines at the frames are W (F, K). There the energy of a motion is
p' R p - 2 r' p + c. The marginal likelihood needs the determinants of alpha R + gamma M for each eigenvector in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import eigh

from quadriform.fitting.least_squares.factorisation import spectrum
from quadriform.fitting.least_squares.regularisers import Regulariser, regulariser_matrix
from quadriform.fitting.refinement.point_to_plane import linear_problem_of
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Array
from quadriform.shapes.bernstein import gram, kronecker
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.splines import TimeBasis

ROUNDING = 1e-9
"""Eigenvalues below this fraction of the largest are rounding, and are taken as zero."""


class Energy(Protocol):
    """An energy of a motion in its coordinates."""

    @property
    def basis(self) -> Array:
        """The matrix B (k, k)."""

    @property
    def inverse(self) -> Array:
        """The inverse (k, k) of B."""

    @property
    def mass(self) -> Array:
        """The matrix M (3 k, 3 k)."""

    @property
    def null_dimension(self) -> int:
        """The dimension of the null space at one time."""

    def time_mass(self, basis: TimeBasis, splines_at_frames: Array) -> Array:
        """The matrix (K, K) of the mean over time, or over the frames, of a square."""

    def add(self, matrix: Array, factor: float, splines: Array) -> None:
        """Add `factor` R to the leading block (K 3 k, K 3 k) of a matrix, with W (F, K)."""

    def right(self, splines: Array) -> Array:
        """The right side r (K 3 k,), with W (F, K)."""

    @property
    def constant(self) -> float:
        """The energy c at displacements of zero."""

    def value(self, coordinates: Array, splines: Array) -> float:
        """The energy at p (K, 3 k), with W (F, K)."""

    def log_determinant(self, alpha: float, gamma: float) -> float:
        """The logarithm for one eigenvector in time, without the null space where gamma is zero.

        It is known up to a constant for gamma = 0, and to another one for others.
        """


class InSpace(Protocol):
    """What is known of the shape at any one time."""

    @property
    def first_factor(self) -> float:
        """The factor on the strengths in the first round."""

    def energy(self, boxes: Sequence[ControlBox]) -> Energy:
        """The energy of displacements near the deformed boxes of the frames."""

    def best_strength(
        self, datasets: Sequence[SurfaceData], box: ControlBox, fraction: float, least_sigma: float, near: float | None
    ) -> float:
        """The best strength alpha for the data of one frame, near an earlier one."""


def box_mass(shape: tuple[int, int, int]) -> Array:
    """The matrix (k, k) of the mean square displacement over a box with l x m x n control points."""
    return kronecker(gram(shape[0] - 1), gram(shape[1] - 1), gram(shape[2] - 1))


@dataclass(frozen=True)
class Smoothness:
    """A smooth deformation of the undeformed box.

    Attributes:
        regularity: a regulariser.
        shape: control points along each axis.
        first_factor: the images of one frame in which all begin are near the points already, so that maps need not be
            affine.
    """

    regularity: str | Regulariser
    shape: tuple[int, int, int]
    first_factor: float = 100.0

    @cached_property
    def _energy(self) -> SmoothEnergy:
        return SmoothEnergy.of(regulariser_matrix(self.regularity, self.shape), self.shape)

    def energy(self, boxes: Sequence[ControlBox]) -> Energy:
        """The energy, wherever the boxes are."""
        return self._energy

    def best_strength(
        self, datasets: Sequence[SurfaceData], box: ControlBox, fraction: float, least_sigma: float, near: float | None
    ) -> float:
        """The best strength alpha for the data of one frame, near an earlier one."""
        none = [None] * len(datasets)
        linear = linear_problem_of(datasets, none, box, self.regularity, fraction, least_sigma)
        return linear.best(near).strength


@dataclass(frozen=True)
class SmoothEnergy:
    """The mean over time of the energy of a regulariser, in its orthonormal eigenbasis.

    Attributes:
        basis, inverse, mass: as of `Energy`.
        energies: (3 k,), of the eigenvectors.
        kappa: (k,), the eigenvalues relative to the mass.
    """

    basis: Array
    inverse: Array
    mass: Array
    energies: Array
    kappa: Array
    constant: float = field(default=0.0, init=False)

    @classmethod
    def of(cls, matrix: Array, shape: tuple[int, int, int]) -> SmoothEnergy:
        """Of a regulariser's matrix (k, k), of l x m x n control points."""
        mass, (energies, vectors) = box_mass(shape), spectrum(matrix.tobytes())
        kappa = np.maximum(eigh(matrix, mass, eigvals_only=True), 0)
        kappa = kappa * (kappa > ROUNDING * kappa.max())
        in_basis = np.kron(vectors.T @ mass @ vectors, np.eye(3)).astype(np.float64)
        return cls(vectors, vectors.T, in_basis, np.repeat(energies, 3), kappa)

    @property
    def null_dimension(self) -> int:
        """The dimension of the null space, of all three axes."""
        return 3 * int((self.kappa <= 0).sum())

    def time_mass(self, basis: TimeBasis, splines_at_frames: Array) -> Array:
        """The matrix (K, K) of the mean over time of a square."""
        return basis.mass()

    def add(self, matrix: Array, factor: float, splines: Array) -> None:
        """Add `factor` times the energies to the diagonal."""
        count = splines.shape[1] * len(self.energies)
        index = np.arange(count)
        matrix[index, index] += factor * np.tile(self.energies, splines.shape[1])

    def right(self, splines: Array) -> Array:
        """Zero: the undeformed box has no energy."""
        return np.zeros(splines.shape[1] * len(self.energies))

    def value(self, coordinates: Array, splines: Array) -> float:
        """The energy at p (K, 3 k)."""
        return float(np.sum(coordinates**2 @ self.energies))

    def log_determinant(self, alpha: float, gamma: float) -> float:
        """The logarithm, relative to that of the mass."""
        values = alpha * self.kappa + gamma
        return float(3 * np.log(values[values > 0]).sum())
