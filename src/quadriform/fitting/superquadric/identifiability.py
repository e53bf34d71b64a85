"""Identifiability of a fitted superquadric: rank, condition and covariance of its parameters."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.superquadric.candidates import AXES, HOLE, POWERS, ROTATION, SHIFT, Candidates, distances
from quadriform.fitting.superquadric.diagnostics import UNDETERMINED
from quadriform.fitting.superquadric.levenberg_marquardt import EXPONENT_SPREAD
from quadriform.fitting.superquadric.problem import PART_OF_PARAMETER, PARTS
from quadriform.points import Array
from quadriform.shapes.superellipse import quiet
from quadriform.shapes.superquadric import Superquadric

SYMMETRIC_ROTATION = 0.2
"""A rotation with a standard deviation above this, in radians, is undetermined: about an axis of symmetry."""
PURE_ROTATION = 0.9
"""Share of rotations in the square of a direction of parameter space above which it only rotates the surface."""
ROUNDING = 1e-14
"""Share of the largest eigenvalue of the information below which an eigenvalue is rounding."""


@dataclass(frozen=True)
class Identifiability:
    """What the derivatives at the solution determine; lengths in RMS radii of the cloud.

    Attributes:
        rank: of the derivatives of the distances by the parameters that were not fixed.
        condition: their largest singular value over the smallest.
        symmetric: whether a rotation of the surface is undetermined.
        weakest: the part of the parameters ("semi-axes", "rotation" ...) that changes most in the directions that are
            determined least, those beyond the condition `UNDETERMINED`, or the one of the smallest singular value.
        covariance: (p, p) in the order a1 a2 a3, e1 e2, three rotations about the object's own axes in radians,
            tx ty tz, hole radius; zero for fixed parameters.
    """

    rank: int
    condition: float
    symmetric: bool
    weakest: str
    covariance: Array


@quiet
def identifiability_of(
    candidate: Candidates, derivatives: Array, weights: Array, sigma: float, fixed: NDArray[np.bool_]
) -> Identifiability:
    """Rank, condition and covariance of one candidate.

    Args:
        candidate: one.
        derivatives: (p, n) of the distances by its internal parameters.
        weights: (n,) weights times inlier probabilities.
        sigma: noise.
        fixed: (p,) mask of the parameters that were not estimated.
    """
    estimated = np.flatnonzero(~fixed)
    rows = (_by_parameters(candidate, derivatives) * np.sqrt(weights))[estimated]
    # by SVD of the derivatives: normal equations would square the condition
    left, singular, _ = np.linalg.svd(rows, full_matrices=False)
    rank = int((singular > 1e-10 * singular[0]).sum())
    weak = left[:, singular < singular[0] / UNDETERMINED]
    rotating = (weak[np.isin(estimated, np.r_[ROTATION])] ** 2).sum(axis=0)
    covariance = np.zeros((len(fixed), len(fixed)))
    covariance[np.ix_(estimated, estimated)] = _inverse(rows @ rows.T / sigma**2, estimated)
    condition = float(singular[0] / max(singular[-1], 1e-300))
    rotation_sigma = np.sqrt(max(np.linalg.eigvalsh(covariance[ROTATION, ROTATION])[-1], 0))
    symmetric = bool((rotating > PURE_ROTATION).any() or rotation_sigma > SYMMETRIC_ROTATION)
    return Identifiability(
        rank, condition, symmetric, _weakest(weak if weak.size else left[:, -1:], estimated), covariance
    )


def _weakest(directions: Array, estimated: NDArray[np.intp]) -> str:
    """The part of the parameters that orthonormal directions (k, m), in the k estimated ones, change most."""
    changes = [(directions[PART_OF_PARAMETER[estimated] == name] ** 2).sum() for name in PARTS]
    return PARTS[int(np.argmax(changes))].replace("semi_axes", "semi-axes").replace("_", " ")


@quiet
def surface_at(found: Superquadric, covariance: Array, points: Array) -> tuple[Array, Array]:
    """Signed distances (n,) of points (n, 3) to a superquadric, and variances (n,) of its surface along them.

    Args:
        found: the superquadric.
        covariance: (p, p) of its parameters, in the order of `Identifiability`.
        points: anywhere near it.
    """
    signed, rows = surface_rows(found, points)
    return signed, np.maximum(np.einsum("in,ij,jn->n", rows, covariance, rows, optimize=True), 0)


@quiet
def surface_rows(found: Superquadric, points: Array) -> tuple[Array, Array]:
    """Signed distances (n,) of points (n, 3) to a superquadric, and their derivatives (p, n) by its parameters."""
    candidate = Candidates.of([found])
    signed, derivatives = distances(candidate, points)
    return signed[0], _by_parameters(candidate, derivatives[0])


def _by_parameters(candidate: Candidates, derivatives: Array) -> Array:
    """Derivatives by the parameters of a superquadric, from those by the internal ones of `Candidates`.

    By semi-axes instead of their logarithms, by the shift along the world's axes instead of the body's, by the hole.
    """
    rows = derivatives.copy()
    rows[AXES] /= np.exp(candidate.log_axes[0])[:, None]
    rows[SHIFT] = candidate.rotations[0] @ rows[SHIFT]
    rows[HOLE] /= np.exp(candidate.log_holes[0, 0])
    return rows


def _inverse(information: Array, estimated: NDArray[np.intp]) -> Array:
    """Inverse of the information with the prior of the exponents.

    A direction that nothing determines has a variance of at least 1, which is that of an RMS radius or a radian,
    however small the noise is.
    """
    information = information + np.diag(np.isin(estimated, np.r_[POWERS]) / EXPONENT_SPREAD**2)
    values, vectors = np.linalg.eigh(information)
    floored = np.maximum(values, 1e-16 * values[-1])
    precision = np.where(values < ROUNDING * values[-1], np.minimum(floored, 1.0), floored)
    return (vectors / precision) @ vectors.T
