"""The covariance of a robust superquadric by the curvature of its likelihood, and the biases of its solution.

In linear least squares the covariance is the inverse of the information H = sum_i w_i J_i' J_i / sigma^2, J_i (1, p)
the derivatives of distance i by the p parameters and ' the transpose. Three effects make the deviations larger:

- The likelihood is flatter than its linearisation, where points are neither inliers nor outliers, and around edges.
  Its second derivatives K, by differences, take the place of H in the directions where they are smaller.
- The preference for smaller bodies moves the solution.
- Noise with a direction, as along the rays of a scanner, displaces points along the surface too. That moves the
  solution, because the derivatives depend on where the point is.

A term of the loss with the gradient g moves the minimum by K^-1 g; the square of this shift is added as a variance. So
with the two gradients g of the last effects the covariance is K^-1 + sum over both g of K^-1 g g' K^-1.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.fitting.cloud import evenly_chosen
from quadriform.fitting.superquadric.candidates import AXES, HOLE, POWERS, SHIFT, Candidates, distances
from quadriform.fitting.superquadric.diagnostics import UNDETERMINED
from quadriform.fitting.superquadric.levenberg_marquardt import EXPONENT_SPREAD, Descent
from quadriform.points import Array
from quadriform.shapes.superellipse import quiet

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Indices of the six different entries of a symmetric matrix (3, 3)."""


@dataclass(frozen=True)
class CovarianceSettings:
    """The constants of the estimate."""

    points: int = 2000
    """Points of an even sample, enough for standard deviations."""
    step: float = 0.1
    """Step of numerical derivatives: the RMS change of the distances in units of sigma."""
    flattest: float = 0.05
    """Least curvature of the likelihood over that of its linearisation: a sample cannot show less."""
    oblique: float = 3.0
    """Largest displacement along the surface over that across it: rays that graze the surface measure no distance."""
    flat: float = 1e-3
    """Least variance of the noise in a direction over the largest: less is rounding."""


COVARIANCE = CovarianceSettings()


@quiet
def likelihood_covariance(descent: Descent) -> Array:
    """Covariance (p, p) of one candidate's parameters at the end of its descent, in the order of `Identifiability`.

    It is estimated on a sample, and zero for fixed parameters. Directions of parameter space in which the information
    of linear least squares is below 1e-8 of the largest (1 / `UNDETERMINED`, squared) have the inverse of that
    information, a very large variance; where it is rounding, below 1e-16, that of 1e-16 of the largest.
    """
    index = evenly_chosen(descent.points, COVARIANCE.points)
    fraction = descent.weights[index].sum() / descent.weights.sum()
    sample = Descent(descent.problem.take(index, fraction), descent.candidates, descent.mixture)
    total = descent.weights.sum() / sample.weights.sum()
    estimated = np.flatnonzero(~descent.fixed_mask)
    information = total * _linear(sample)[np.ix_(estimated, estimated)]
    values, vectors = np.linalg.eigh(information)
    determined = values > values[-1] / UNDETERMINED**2
    # in coordinates in which the information is the unit matrix, eigenvalues of the curvature are its ratios to H
    white = vectors[:, determined] / np.sqrt(values[determined])
    curvature, axes = np.linalg.eigh(white.T @ (total * _curvature(sample))[np.ix_(estimated, estimated)] @ white)
    # K^-1 = roots roots'; the variance is not below that of linear least squares, for a sample cannot show that
    roots = white @ axes / np.sqrt(np.clip(curvature, COVARIANCE.flattest, 1))
    gradients = total * np.stack([_by_size(sample)[0], _by_direction_of_noise(sample)])[:, estimated]
    weak = vectors[:, ~determined] / np.sqrt(np.maximum(values[~determined], 1e-16 * values[-1]))
    every = np.concatenate([roots, weak, roots @ (roots.T @ gradients.T)], axis=1)
    covariance = np.zeros((len(descent.fixed_mask), len(descent.fixed_mask)))
    covariance[np.ix_(estimated, estimated)] = every @ every.T
    return _of_parameters(descent.candidates, covariance)


def _linear(sample: Descent) -> Array:
    """Information (p, p) of least squares and of the prior on the exponents."""
    weighted = sample.derivatives[0] * (sample.weights * sample.inliers[0])
    information = weighted @ sample.derivatives[0].T / sample.mixture.sigma[0] ** 2
    if (empty := sample.problem.empty) is not None:
        information += empty.penalty(sample.candidates, sample.mixture).matrix[0] / sample.mixture.sigma[0] ** 2
    return information + np.diag(np.isin(np.arange(len(information)), np.r_[POWERS]) / EXPONENT_SPREAD**2)


def _curvature(sample: Descent) -> Array:
    """Second derivatives (p, p) of the robust loss, by differences of the first."""
    sigma, count = sample.mixture.sigma[0], len(sample.fixed_mask)
    steps = COVARIANCE.step * sigma / np.maximum(np.sqrt((sample.derivatives[0] ** 2).mean(axis=1)), 1e-300)
    steps = np.minimum(steps, COVARIANCE.step)
    # central differences of the gradient: a step forwards and one backwards for each parameter, all at once
    candidates, mixture = sample.picked(np.zeros(2 * count, dtype=np.int64))
    moved = candidates.moved(np.concatenate([np.diag(steps), -np.diag(steps)]), sample.problem.longest)
    gradient = _gradient(Descent(sample.problem, moved, mixture))
    second = (gradient[:count] - gradient[count:]) / (2 * steps[:, None])
    return (second + second.T) / 2


def _gradient(sample: Descent) -> Array:
    """Derivatives (M, p) of the loss at each candidate."""
    weighted = sample.weights * sample.inliers * sample.distances
    gradient = (sample.derivatives @ weighted[:, :, None])[..., 0] / sample.mixture.sigma[:, None] ** 2
    gradient[:, POWERS] += (sample.candidates.exponents - 1) / EXPONENT_SPREAD**2
    if (empty := sample.problem.empty) is not None:
        gradient += empty.penalty(sample.candidates, sample.mixture).gradient / sample.mixture.sigma[:, None] ** 2
    return gradient + _by_size(sample)


def _by_size(sample: Descent) -> Array:
    """Derivatives (M, p) of the penalty on the size."""
    found = np.zeros((len(sample.candidates), len(sample.fixed_mask)))
    found[:, AXES] = sample.extent().derivatives(sample.candidates)
    return found


def _by_direction_of_noise(sample: Descent) -> Array:
    """The gradient (p,) of the loss that is due to displacements along the surface, in the body's own frame.

    Given the distance d along the normal n, the expected displacement of a point whose noise has the covariance C is
    d C n / (n' C n); without its part d n along the normal, d (C n / (n' C n) - n) along the surface. The gradient is
    sum_i w_i d_i (change of the derivatives of d_i as the point is moved back by that) / sigma^2.
    """
    relative_noise = sample.problem.relative_noise
    weights, offsets = sample.weights * sample.inliers[0], sample.distances[0] * relative_noise
    normals = -sample.derivatives[0, SHIFT] * relative_noise  # (3, n)
    towards = _covariance_of_noise(normals, offsets**2, weights) @ normals
    along = towards / (normals * towards).sum(axis=0) - normals
    along *= np.minimum(1, COVARIANCE.oblique / np.maximum(np.linalg.norm(along, axis=0), 1e-300))
    back = sample.points - (sample.candidates.rotations[0] @ (offsets * along)).T
    changed = distances(sample.candidates, back)[1][0] / relative_noise - sample.derivatives[0]
    return changed @ (weights * sample.distances[0]) / sample.mixture.sigma[0] ** 2


def _covariance_of_noise(normals: Array, squares: Array, weights: Array) -> Array:
    """The covariance (3, 3) whose variances along normals (3, n) are nearest to the squared distances (n,)."""
    # n' C n = sum over the six entries of C, those off the diagonal twice: linear least squares in C
    columns = np.stack([(2 - (i == j)) * normals[i] * normals[j] for i, j in PAIRS], axis=1)
    roots = np.sqrt(weights)
    found = np.linalg.lstsq(columns * roots[:, None], squares * roots, rcond=COVARIANCE.flat)[0]
    covariance = np.zeros((3, 3))
    for value, (i, j) in zip(found, PAIRS):
        covariance[i, j] = covariance[j, i] = value
    values, axes = np.linalg.eigh(covariance)
    return (axes * np.maximum(values, COVARIANCE.flat * values[-1])) @ axes.T


def _of_parameters(candidate: Candidates, covariance: Array) -> Array:
    """The covariance of semi-axes instead of their logarithms, of the shift along the world's axes, of the hole."""
    change = np.eye(len(covariance))
    change[AXES, AXES] *= np.exp(candidate.log_axes[0])
    change[SHIFT, SHIFT] = candidate.rotations[0]
    change[HOLE, HOLE] *= np.exp(candidate.log_holes[0])
    return change @ covariance @ change.T
