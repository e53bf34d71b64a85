"""A prior of shape: the mean and covariance of a population, as displacements of the control points of one box."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_solve, lapack

from quadriform.errors import OptionError
from quadriform.points import Array, check_number, fixed_array
from quadriform.shapes.bending import Bending
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel, lines_of
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import after_number, short_repr, summary

SAME = 1e-6
"""Largest deviation of the products of modes from the identity, and of the metric from a symmetric matrix."""


@dataclass(frozen=True, repr=False)
class PriorReport:
    """How well a prior represents its population; distances are RMS over points of the surfaces.

    Attributes:
        leave_one_out: RMS distance of each shape to its projection on the modes of the others, in the unit of the data.
        residual: RMS distance of the points of the shapes to what the control points represent.
        modes_90: number of modes that explain 90 % of the variance.
        modes_95: 95 % of it.
        modes_99: 99 % of it.
        specificity: mean distance of random members of the Gaussian over the modes to the nearest shape.
    """

    __repr__ = short_repr

    leave_one_out: float
    residual: float
    modes_90: int
    modes_95: int
    modes_99: int
    specificity: float

    def __post_init__(self) -> None:
        for name in ("leave_one_out", "residual", "specificity"):
            object.__setattr__(self, name, check_number(getattr(self, name), name, 0, np.finfo(float).max))
        if not 1 <= self.modes_90 <= self.modes_95 <= self.modes_99:
            found = f"{self.modes_90}, {self.modes_95}, {self.modes_99}"
            raise OptionError(f"modes_90, modes_95, modes_99: expected ascending numbers from 1, found {found}")


@dataclass(frozen=True, repr=False)
class ShapePrior:
    """A Gaussian of displacements u (k, 3) of k control points, about the centre of the shape, in one orientation.

    The mean is m and the covariance C + D. C = sum_j v_j f_j f_j^T has the modes f_j of the population and their
    variances v_j. D = freedom (B + G)^-1, the same for each coordinate, is what a shape may differ from all of these:
    B is the bending energy, G the metric, without which affine displacements would cost nothing.

    Attributes:
        surfaces: name -> superquadric before deformation, the same for all members of the population.
        box: undeformed, of k control points.
        mean: (k, 3), displacements of the control points of the mean shape, the last axis of the box running fastest.
        modes: (m, k, 3), orthonormal in the metric: the sum of f_i . G f_j over the coordinates is 1 for i = j, else 0.
        variances: (m,), positive, of the modes: mean square distance over the surface, in squared units.
        metric: (k, k), G: u . G u is the mean square displacement of the points of the surfaces, with a small bending
            energy.
        freedom: positive, in squared units.
        n_models: number of shapes that it was learned from.
        report: how well it represents them.
        any_size: whether sizes were removed, so that a fit estimates one as it does the pose.
        space: the frame of the world coordinates of the models: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".

    Raises:
        OptionError: arrays that do not go together, or are no mean, modes, variances or metric.
    """

    surfaces: dict[str, Superquadric]
    box: ControlBox
    mean: Array
    modes: Array
    variances: Array
    metric: Array
    freedom: float
    n_models: int
    report: PriorReport
    any_size: bool = False
    space: str = "unknown"
    unit: str = "unknown"

    def __repr__(self) -> str:
        counts = " x ".join(map(str, self.box.control_points.shape[:3]))
        error = f"{self.report.leave_one_out:.3g}{after_number(self.unit)}"
        return summary(
            f"ShapePrior: {len(self.modes)} modes of {self.n_models} models, {counts} control points",
            f"leave-one-out error {error}, space {self.space}, unit {self.unit}",
            *lines_of(self.surfaces),
        )

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise OptionError("surfaces: expected at least one named superquadric")
        if not np.abs(self.box.control_points - self.box.rest).max() <= SAME * np.abs(self.box.edges).max():
            raise OptionError("box: expected an undeformed box; deformations are the mean and the modes")
        k, m = self.box.control_points.size // 3, len(self.variances)
        for name, shape in (("mean", (k, 3)), ("modes", (m, k, 3)), ("variances", (m,)), ("metric", (k, k))):
            object.__setattr__(self, name, fixed_array(getattr(self, name), name, shape))
        object.__setattr__(self, "freedom", check_number(self.freedom, "freedom", np.finfo(float).tiny))
        if not (isinstance(self.n_models, int) and self.n_models >= 3):
            raise OptionError(f"n_models={self.n_models!r}: expected three or more")
        if not (m and np.all(self.variances > 0) and np.all(np.diff(self.variances) <= 0)):
            raise OptionError("variances: expected positive numbers in descending order")
        self._check_metric()

    def _check_metric(self) -> None:
        is_symmetric = np.abs(self.metric - self.metric.T).max() <= SAME * np.abs(self.metric).max()
        # a factor exists for positive definite matrices alone; priors are moved often, and eigenvalues take longer
        if not is_symmetric or lapack.dpotrf(self.metric, lower=True)[1]:
            raise OptionError("metric: expected a symmetric, positive definite matrix")
        products = np.tensordot(self._dual(self.modes), self.modes, ((1, 2), (1, 2)))
        if np.abs(products - np.eye(len(self.modes))).max() > SAME:
            raise OptionError("modes: expected modes that are orthonormal in the metric")

    def _dual(self, displacements: Array) -> Array:
        """G u of displacements u (..., k, 3)."""
        return np.asarray(self.metric @ displacements, dtype=np.float64)

    @property
    def deviations(self) -> Array:
        """One standard deviation (m,) of each mode: RMS distance over the surface, in the unit of the data."""
        return np.sqrt(self.variances)

    def transformed(self, scale: float, offset: Array) -> ShapePrior:
        """The same prior after `scale` x + `offset`, as of shapes in another frame or unit."""
        return self.moved(np.eye(3), offset, scale)

    def rotated(self, rotation: Array) -> ShapePrior:
        """The same prior after a rotation (3, 3) about the origin."""
        return self.moved(rotation, np.zeros(3))

    def moved(self, rotation: Array, shift: Array, size: float = 1.0) -> ShapePrior:
        """The same prior after `size` rotation x + `shift`."""
        lengths = {name: size * getattr(self.report, name) for name in ("leave_one_out", "residual", "specificity")}
        surfaces = {name: each.rotated(rotation).transformed(size, shift) for name, each in self.surfaces.items()}
        return replace(
            self,
            surfaces=surfaces,
            box=self.box.rotated(rotation).transformed(size, shift),
            mean=size * self.mean @ rotation.T,
            modes=self.modes @ rotation.T,
            variances=size**2 * self.variances,
            freedom=size**2 * self.freedom,
            report=replace(self.report, **lengths),
        )

    def mean_model(self) -> DeformableModel:
        """The mean shape."""
        return self.model(np.zeros(0))

    def model(self, scores: ArrayLike) -> DeformableModel:
        """The shape of scores (n,), in standard deviations along the first n modes.

        Raises:
            OptionError: more scores than modes, or not finite.
        """
        given = fixed_array(scores, "scores")
        if given.ndim != 1 or len(given) > len(self.modes):
            raise OptionError(f"scores: expected at most {len(self.modes)}, one a mode, found shape {given.shape}")
        moved = self.mean + np.tensordot(given * self.deviations[: len(given)], self.modes[: len(given)], 1)
        control = self.box.control_points + moved.reshape(self.box.control_points.shape)
        return DeformableModel(self.surfaces, self.box.with_control_points(control), self.space, self.unit)

    def scores(self, displacement: ArrayLike) -> Array:
        """The scores (m,), in standard deviations, of displacements (k, 3) of the control points from `box`.

        Raises:
            OptionError: another number of them, or not finite.
        """
        given = fixed_array(displacement, "displacement").reshape(-1, 3)
        if given.shape != self.mean.shape:
            raise OptionError(f"displacement: expected shape {self.mean.shape}, found {np.shape(displacement)}")
        along = np.tensordot(self.modes, self._dual(given - self.mean), ((1, 2), (0, 1)))
        return np.asarray(along / self.deviations, dtype=np.float64)

    def distance(self, displacement: ArrayLike) -> float:
        """The Mahalanobis distance of displacements (k, 3) to the mean over the modes: the length of the scores.

        Its square has the mean m, the number of modes, in the population.
        """
        return float(np.linalg.norm(self.scores(displacement)))

    def precision(self) -> Array:
        """The inverse Q (3 k, 3 k) of the covariance C + D of displacements (k, 3) whose last axis runs fastest.

        With the Cholesky factor L of B + G, D = freedom (L L^T)^-1. In the coordinates L^T u / sqrt(freedom), in which
        D is the identity, C is Z Z^T with as many columns as modes, and (I + Z Z^T)^-1 = I - U diag(s^2 / (1 + s^2))
        U^T by the singular value decomposition Z = U s V^T.
        """
        root = np.linalg.cholesky(rigidity(self.box, self.metric))
        count = self.mean.size
        # modes are columns here, as are their images in coordinates in which D is the identity
        columns = (root.T @ self.modes).reshape(-1, count).T * np.sqrt(self.variances / self.freedom)
        u, singular, _ = np.linalg.svd(columns, full_matrices=False)
        inner = np.eye(count) - (u * (singular**2 / (1 + singular**2))) @ u.T
        factor = np.kron(root, np.eye(3))
        found = factor @ inner @ factor.T / self.freedom
        return np.asarray((found + found.T) / 2, dtype=np.float64)


def rigidity(box: ControlBox, metric: Array) -> Array:
    """The matrix B + G (k, k): the bending energy and the mean square of displacements of k control points."""
    along_s, along_t, along_u = box.control_points.shape[:3]
    return Bending.matrix((along_s, along_t, along_u)) + metric


def freedom_of(error: float, box: ControlBox, metric: Array) -> float:
    """The freedom under which D alone displaces the points of the surfaces by an RMS distance.

    The mean square under D is 3 freedom tr(G (B + G)^-1), for three coordinates.

    Args:
        error: the RMS distance.
        box: undeformed.
        metric: (k, k), G.
    """
    root = np.linalg.cholesky(rigidity(box, metric))
    return float(error**2 / (3 * np.trace(cho_solve((root, True), metric))))
