"""A prior of shape in coordinates of its control points in which the freedom outside of the modes is isotropic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from quadriform.points import Array
from quadriform.shapes.prior import ShapePrior, rigidity


@dataclass(frozen=True)
class PriorCoordinates:
    """The coordinates y = L' (u - m) of displacements u (k, 3), with L the Cholesky factor of B + G (`ShapePrior`).

    With the freedom phi the covariance of y is phi I + kappa Z Z', with a column of Z for each mode, and infinite along
    the columns of R, rigid motions of the mean shape. Its inverse is

        (1 / phi) (I - U diag(w) U'),    w = 1 for rigid motions, rho s^2 / (1 + rho s^2) for others,  rho = kappa / phi

    where U (3 k, q) are orthonormal: first those that span R, then the left singular vectors of Z without its part
    along R, of singular values s.

    Attributes:
        mean: (k, 3), m.
        root: (k, k), L.
        basis: (k, k), L'^-1: the displacements are m + basis @ y.
        directions: (3 k, q), U.
        n_rigid: number of the first of these, six, or seven with changes of size.
        squares: (q - n_rigid,), s^2 of the others, descending.
    """

    mean: Array
    root: Array
    basis: Array
    directions: Array
    n_rigid: int
    squares: Array

    @classmethod
    def of(cls, prior: ShapePrior) -> PriorCoordinates:
        """Of a prior."""
        root: Array = np.linalg.cholesky(rigidity(prior.box, prior.metric)).astype(np.float64)
        basis: Array = solve_triangular(root, np.eye(len(root)), lower=True, trans="T")
        rigid = _columns(root, rigid_motions(prior))
        along, _ = np.linalg.qr(rigid)
        modes = _columns(root, np.sqrt(prior.variances)[:, None, None] * prior.modes)
        across = modes - along @ (along.T @ modes)
        directions, singular, _ = np.linalg.svd(across, full_matrices=False)
        return cls(prior.mean, root, basis, np.hstack([along, directions]), rigid.shape[1], singular**2)

    def weights(self, ratio: float) -> Array:
        """The weights w (q,) of the directions at a ratio rho."""
        relative = ratio * self.squares
        return np.concatenate([np.ones(self.n_rigid), relative / (1 + relative)])

    def of_displacement(self, displacement: Array) -> Array:
        """The coordinates y (3 k,) of displacements (k, 3)."""
        return np.asarray((self.root.T @ (displacement.reshape(-1, 3) - self.mean)).ravel(), dtype=np.float64)

    def displacement(self, coordinates: Array) -> Array:
        """The displacements (k, 3) of coordinates y (3 k,)."""
        return np.asarray(self.mean + self.basis @ coordinates.reshape(-1, 3), dtype=np.float64)


def rigid_motions(prior: ShapePrior) -> Array:
    """Displacements (6 or 7, k, 3) of the control points of the mean shape by shifts, rotations, and a change of size.

    An affine motion of the control points is that of the whole space inside the box.
    """
    points = prior.box.control_points.reshape(-1, 3) + prior.mean
    points = points - points.mean(axis=0)
    shifts = np.broadcast_to(np.eye(3)[:, None], (3, len(points), 3))
    rotations = np.cross(np.eye(3)[:, None], points[None])
    size = points[None] if prior.any_size else np.empty((0, len(points), 3))
    return np.concatenate([shifts, rotations, size])


def _columns(root: Array, displacements: Array) -> Array:
    """The coordinates (3 k, n) of displacements (n, k, 3) from the mean."""
    return np.asarray((root.T @ displacements).reshape(len(displacements), -1).T, dtype=np.float64)
