"""The covariance of a robust superquadric beyond linear least squares: flat likelihoods, the size, and a bias.

The likelihood is flatter than its linearisation where points are neither inliers nor outliers, and around edges. The
preference for smaller bodies moves the solution. And noise with a direction, as along the rays of a scanner, displaces
points across the normal too: the derivatives there depend on the distances, and the solution is biased.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import evenly_chosen
from quadriform.fitting.superquadric.candidates import AXES, HOLE, POWERS, SHIFT, Candidates
from quadriform.fitting.superquadric.diagnostics import UNDETERMINED
from quadriform.fitting.superquadric.levenberg_marquardt import EXPONENT_SPREAD, Descent, distances
from quadriform.points import Array
from quadriform.shapes.superellipse import quiet

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


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
    """Largest displacement across the normal over that along it: rays that graze the surface measure no distance."""
    flat: float = 1e-3
    """Least variance of the noise in a direction over the largest: less is rounding."""


OPEN = CovarianceSettings()


@quiet
def remaining_covariance(descent: Descent) -> Array:
    """Covariance (p, p) of one candidate's parameters at the end of its descent, in the order of `Determined`."""
    index = evenly_chosen(descent.points, OPEN.points)
    sample = _at(descent, descent.candidates, index)
    total = descent.weights.sum() / sample.weights.sum()
    estimated = np.flatnonzero(~descent.fixed)
    information = total * _linear(sample)[np.ix_(estimated, estimated)]
    values, vectors = np.linalg.eigh(information)
    known = values > values[-1] / UNDETERMINED**2
    white = vectors[:, known] / np.sqrt(values[known])
    curvature, axes = np.linalg.eigh(white.T @ (total * _curvature(sample))[np.ix_(estimated, estimated)] @ white)
    # the variance is not below that of linear least squares: a sample cannot show that
    roots = white @ axes / np.sqrt(np.clip(curvature, OPEN.flattest, 1))
    # a term with gradient g moves the minimum by (inverse curvature) g; its square counts as a variance
    gradients = total * np.stack([_by_size(sample)[0], _by_direction_of_noise(sample)])[:, estimated]
    unknown = vectors[:, ~known] / np.sqrt(np.maximum(values[~known], 1e-16 * values[-1]))
    every = np.concatenate([roots, unknown, roots @ (roots.T @ gradients.T)], axis=1)
    covariance = np.zeros((len(descent.fixed), len(descent.fixed)))
    covariance[np.ix_(estimated, estimated)] = every @ every.T
    return _natural(descent.candidates, covariance)


def _at(descent: Descent, candidates: Candidates, index: NDArray[np.int64]) -> Descent:
    """The mixture of a descent of one candidate with other candidates, at some of its points."""
    arrays = (descent.points, descent.weights, descent.log_odds, descent.noise)
    points, weights, log_odds, noise = (each[index] for each in arrays)
    mixture = descent.mixture.take(np.zeros(len(candidates), dtype=np.int64))
    penalty = None if descent.penalty is None else descent.penalty.scaled(weights.sum() / descent.weights.sum())
    known = descent.least_sigma, descent.size, penalty
    return Descent(candidates, points, weights, mixture, descent.longest, descent.fixed, log_odds, noise, *known)


def _linear(sample: Descent) -> Array:
    """Information (p, p) of least squares and of the prior on the exponents."""
    weighted = sample.derivatives[0] * (sample.weights * sample.inliers[0])
    information = weighted @ sample.derivatives[0].T / sample.mixture.sigma[0] ** 2
    if sample.penalty is not None:
        information += sample.penalty(sample.candidates, sample.mixture).matrix[0] / sample.mixture.sigma[0] ** 2
    return information + np.diag(np.isin(np.arange(len(information)), np.r_[POWERS]) / EXPONENT_SPREAD**2)


def _curvature(sample: Descent) -> Array:
    """Second derivatives (p, p) of the robust loss, by differences of the first."""
    sigma, count = sample.mixture.sigma[0], len(sample.fixed)
    steps = OPEN.step * sigma / np.maximum(np.sqrt((sample.derivatives[0] ** 2).mean(axis=1)), 1e-300)
    steps = np.minimum(steps, OPEN.step)
    # central differences of the gradient: a step forwards and one backwards for each parameter, all at once
    moved = sample.candidates.take(np.zeros(2 * count, dtype=np.int64))
    moved = moved.moved(np.concatenate([np.diag(steps), -np.diag(steps)]), sample.longest)
    gradient = _gradient(_at(sample, moved, np.arange(len(sample.points))))
    second = (gradient[:count] - gradient[count:]) / (2 * steps[:, None])
    return (second + second.T) / 2


def _gradient(sample: Descent) -> Array:
    """Derivatives (M, p) of the loss at each candidate."""
    weighted = sample.weights * sample.inliers * sample.distances
    gradient = (sample.derivatives @ weighted[:, :, None])[..., 0] / sample.mixture.sigma[:, None] ** 2
    gradient[:, POWERS] += (sample.candidates.exponents - 1) / EXPONENT_SPREAD**2
    if sample.penalty is not None:
        gradient += sample.penalty(sample.candidates, sample.mixture).gradient / sample.mixture.sigma[:, None] ** 2
    return gradient + _by_size(sample)


def _by_size(sample: Descent) -> Array:
    """Derivatives (M, p) of the penalty on the size."""
    found = np.zeros((len(sample.candidates), len(sample.fixed)))
    found[:, AXES] = sample.extent().derivatives(sample.candidates)
    return found


def _by_direction_of_noise(sample: Descent) -> Array:
    """Derivatives (p,) of the loss with points moved back to the surface along the direction of their noise."""
    weights, offsets = sample.weights * sample.inliers[0], sample.distances[0] * sample.noise
    normals = -sample.derivatives[0, SHIFT] * sample.noise  # (3, n), in the body's own frame
    # given its distance along n, the expected displacement of a point with covariance C is along C n
    towards = _covariance_of_noise(normals, offsets**2, weights) @ normals
    across = towards / (normals * towards).sum(axis=0) - normals
    across *= np.minimum(1, OPEN.oblique / np.maximum(np.linalg.norm(across, axis=0), 1e-300))
    back = sample.points - (sample.candidates.rotations[0] @ (offsets * across)).T
    changed = distances(sample.candidates, back)[1][0] / sample.noise - sample.derivatives[0]
    return changed @ (weights * sample.distances[0]) / sample.mixture.sigma[0] ** 2


def _covariance_of_noise(normals: Array, squares: Array, weights: Array) -> Array:
    """The covariance (3, 3) whose variances along normals (3, n) are nearest to the squared distances (n,)."""
    # n' C n = sum over the six entries of C, those off the diagonal twice: linear least squares in C
    columns = np.stack([(2 - (i == j)) * normals[i] * normals[j] for i, j in PAIRS], axis=1)
    roots = np.sqrt(weights)
    found = np.linalg.lstsq(columns * roots[:, None], squares * roots, rcond=OPEN.flat)[0]
    covariance = np.zeros((3, 3))
    for value, (i, j) in zip(found, PAIRS):
        covariance[i, j] = covariance[j, i] = value
    values, axes = np.linalg.eigh(covariance)
    return (axes * np.maximum(values, OPEN.flat * values[-1])) @ axes.T


def _natural(candidate: Candidates, covariance: Array) -> Array:
    """The covariance of semi-axes instead of their logarithms, of the shift along the world's axes, of the hole."""
    change = np.eye(len(covariance))
    change[AXES, AXES] *= np.exp(candidate.log_axes[0])
    change[SHIFT, SHIFT] = candidate.rotations[0]
    change[HOLE, HOLE] *= np.exp(candidate.log_holes[0])
    return change @ covariance @ change.T
