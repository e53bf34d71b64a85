"""Which points belong to the surface: a mixture of inliers and outliers, estimated by expectation maximisation (EM).

With r the inlier ratio, sigma the standard deviation of inliers, D the depth and o the log odds of a point by what is
known besides its distance d, the density of the distance is

    p(d) = e^o r N(d; 0, sigma^2) + (1 - r) / D

and the probability to be an inlier the first term over p. Lengths are in RMS radii of the cloud.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array

DEPTH = 2.0
"""Outliers are uniform over this depth, in RMS radii of the cloud: about its diameter."""
LEAST_SIGMA = 1e-9
"""Noise-free data would drive sigma to zero; below this distances are rounding."""
LEAST_RATIO, LARGEST_RATIO = 0.02, 0.999
"""Limits of the inlier ratio: within them both kinds of points have finite log densities."""
ANNEALED_RATIO = 0.6
"""The inlier ratio during annealing, before it can be estimated: most points, but not all."""
PRIOR_INLIERS, PRIOR_POINTS = 1.0, 1.5
"""Points that are added when the ratio is estimated, 1.5 of which 1 is an inlier: a weak prior, so that few points do
not make the ratio 0 or 1."""
LEAST_FREEDOM = 0.2
"""Least degrees of freedom of sigma as a fraction of the inliers: a few points met exactly must not look noise-free."""
FEWEST = 10
"""Least number of points, or sum of probabilities, of which a mean is taken."""
ANNEALING, LEAST_ANNEALED = 0.75, 0.02
"""An annealing step takes sigma down to this fraction of itself, but not below this fraction of the candidate's
size."""


@dataclass(frozen=True)
class Mixture:
    """The mixture of M candidates.

    Attributes:
        inlier_ratio: (M,), in (0, 1).
        sigma: (M,) standard deviation of the inliers' distances.
    """

    inlier_ratio: Array
    sigma: Array

    def take(self, index: NDArray[np.int64]) -> "Mixture":
        """The mixtures of the chosen candidates."""
        return Mixture(self.inlier_ratio[index], self.sigma[index])

    def joined(self, others: "Mixture") -> "Mixture":
        """The mixtures of these candidates and of others."""
        return Mixture(np.append(self.inlier_ratio, others.inlier_ratio), np.append(self.sigma, others.sigma))

    def coordinates(self) -> Array:
        """Logit of the inlier ratio and logarithm of sigma, (2,), of one candidate: coordinates without bounds."""
        return np.array([np.log(self.inlier_ratio[0] / (1 - self.inlier_ratio[0])), np.log(self.sigma[0])])

    @classmethod
    def at(cls, coordinates: Array) -> "Mixture":
        """The mixture of such coordinates (2,)."""
        inlier_ratio = np.clip(1 / (1 + np.exp(-coordinates[:1])), LEAST_RATIO, LARGEST_RATIO)
        return cls(inlier_ratio, np.maximum(np.exp(coordinates[1:]), LEAST_SIGMA))

    def densities(self, distances: Array, log_odds: Array | float = 0.0) -> tuple[Array, Array]:
        """Probability to be an inlier and log density of distances (M, m), both (M, m).

        Args:
            distances: (M, m).
            log_odds: (m,), to be an inlier, that something else than the distance gives.
        """
        sigma = self.sigma[:, None]
        # log of ratio x normal density of the distance, and of (1 - ratio) x uniform density over the depth
        inlier = (
            np.log(self.inlier_ratio / (np.sqrt(2 * np.pi) * self.sigma))[:, None]
            - (distances / sigma) ** 2 / 2
            + log_odds
        )
        outlier = np.log((1 - self.inlier_ratio) / DEPTH)[:, None]
        difference = inlier - outlier
        # log(exp(a) + exp(b)) without overflow
        both = np.log1p(np.exp(-np.abs(difference)))
        total = np.maximum(inlier, outlier) + both
        return np.exp(inlier - total), total


def estimated(distances: Array, inliers: Array, weights: Array, n_parameters: int) -> Mixture:
    """Inlier ratio and sigma by one EM step; sigma with the degrees of freedom that the parameters leave.

    With the inliers' weights w_i, their sum W, the sum V of all weights and p parameters these are
    sigma^2 = sum_i w_i d_i^2 / (W - p) and r = (W + 1) / (V + 1.5).
    """
    weighted = weights * inliers
    count, total = (weighted.sum(axis=1), np.broadcast_to(weights, inliers.shape).sum(axis=1))
    freedom = np.maximum(count - n_parameters, LEAST_FREEDOM * count)
    sigma = np.sqrt((weighted * distances**2).sum(axis=1) / np.maximum(freedom, 1e-300))
    inlier_ratio = np.clip((count + PRIOR_INLIERS) / (total + PRIOR_POINTS), LEAST_RATIO, LARGEST_RATIO)
    return Mixture(inlier_ratio, np.maximum(sigma, LEAST_SIGMA))


def all_inliers(distances: Array, weights: Array) -> Mixture:
    """The mixture with nearly all weighted points as inliers and their RMS distance as sigma."""
    total = np.broadcast_to(weights, distances.shape).sum(axis=1)
    sigma = np.sqrt((weights * distances**2).sum(axis=1) / total)
    return Mixture(np.full(len(sigma), LARGEST_RATIO), np.maximum(sigma, LEAST_SIGMA))


def annealed(mixture: Mixture, sizes: Array) -> Mixture:
    """The mixture with a smaller sigma, which is not estimated.

    An estimated sigma stays large for a surface that lies between two bodies. As sigma is lowered the points of the
    farther body become outliers, and the surface moves to the nearer one.

    Args:
        mixture: of M candidates.
        sizes: (M,) of the candidates at the start.
    """
    return Mixture(np.full(len(sizes), ANNEALED_RATIO), np.maximum(mixture.sigma * ANNEALING, LEAST_ANNEALED * sizes))


def density_log_odds(neighbour_distance: Array, inliers: Array) -> Array:
    """Log odds (n,) of each point to be an inlier by how near its neighbours are: outliers are isolated.

    They are those of linear discriminant analysis of two classes: the log of the neighbour distance x is normal, with
    the mean a for inliers, b for outliers and the common variance v, so that the log odds are
    (b - a) / v ((a + b) / 2 - x). Only their negative part is taken, for an outlier beside the surface has neighbours
    too, and zero where inliers are not denser (b < a), or either class has too few points.

    Without them a surface in a region without data would bend to single outliers there, which its likelihood counts as
    inliers.

    Args:
        neighbour_distance: (n,) distance of each point to its ninth neighbour.
        inliers: (n,) probabilities.
    """
    outliers = 1 - inliers
    if outliers.sum() < FEWEST or inliers.sum() < FEWEST:
        return np.zeros(len(neighbour_distance))
    distance = np.log(np.maximum(neighbour_distance, 1e-300))
    near, far = (distance @ inliers) / inliers.sum(), (distance @ outliers) / outliers.sum()
    # one variance for both kinds: with two the odds would rise again far from both means
    variance = (inliers @ (distance - near) ** 2 + outliers @ (distance - far) ** 2) / len(distance)
    return np.minimum(max(far - near, 0.0) / variance * ((near + far) / 2 - distance), 0)
