"""What is known of the noise of a measurement: covariances of the points, as a metric and as a lower bound."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from quadriform.fitting.cloud import Centred, Neighbourhood
from quadriform.points import Array
from quadriform.words import first_of

LEAST_VARIANCE = 0.01
"""Variance along any normal, as a fraction of the sum over all three axes: a tenth of the standard deviation."""
LONG = 0.9
"""Quantile of the errors of points by which the distance of their samples is known."""


@dataclass(frozen=True)
class KnownNoise:
    """What is known of the noise of a measurement, in the centred, scaled frame.

    Attributes:
        relative: name -> (n, 3, 3), covariances of the points divided by the mean variance along their normals.
            Empty where nothing is known: all points are alike.
        least_sigma: the square root of that mean, a lower bound of the estimated noise.
    """

    relative: Mapping[str, Array]
    least_sigma: float

    @classmethod
    def of(cls, covariances: Mapping[str, Array], centred: Centred) -> "KnownNoise":
        """From covariances (n, 3, 3) by name, in the unit of the data, of clouds with copies and weights."""
        distinct = {name: centred.distinct[name].of_distinct(each) for name, each in covariances.items()}
        return cls.of_local({name: each / centred.frame.scale**2 for name, each in distinct.items()}, centred.points)

    @classmethod
    def of_local(cls, covariances: Mapping[str, Array], clouds: Mapping[str, Array]) -> "KnownNoise":
        """From covariances (n, 3, 3) and points (n, 3) by name, both in the centred, scaled frame."""
        if not covariances:
            return cls({}, 0.0)
        reference = mean_variance(covariances, clouds)
        return cls({name: each / reference for name, each in covariances.items()}, float(np.sqrt(reference)))

    def deviations(self, name: str, centred: Centred) -> Array:
        """Relative standard deviations (n,) of a cloud along the normals that neighbours suggest; ones if unknown."""
        points = centred.points[name]
        if name not in self.relative:
            return np.ones(len(points))
        return np.sqrt(variances_along(self.relative[name], Neighbourhood.of(points).normals))


def partial_notes(noise: Mapping[str, Array | None]) -> tuple[str, ...]:
    """A note where the noise of only some clouds, by name, is known, which is then not used; else none."""
    unknown = [repr(name) for name, each in noise.items() if each is None]
    if len(unknown) in (0, len(noise)):
        return ()
    return (
        f"the noise of {len(noise) - len(unknown)} of {len(noise)} clouds is known but not used: without that of "
        f"{first_of(unknown, 3)} it is not known how much their points count beside the others",
    )


def variances_along(covariances: Array, normals: Array) -> Array:
    """Variances (n,) of points with covariances (n, 3, 3) along normals (n, 3), bounded from below.

    A covariance of rank one, of a scan along its ray or of a mask along the edge of a voxel, has none across it; there
    a fraction of all of it remains, for errors of the instrument, of the grid and of the normal itself.
    """
    along = np.einsum("ni,nij,nj->n", normals, covariances, normals)
    return along + LEAST_VARIANCE * np.trace(covariances, axis1=1, axis2=2)


def sampling_step(covariances: Array | None) -> float:
    """The distance at which points with covariances (n, 3, 3) sample their surface; 0 where nothing is known.

    The error along the edge of a voxel is uniform, and its standard deviation the length of the edge over the root of
    12. Across thick slices that is their distance.
    """
    if covariances is None or not len(covariances):
        return 0.0
    largest = np.linalg.eigvalsh(covariances)[:, -1]
    return float(np.sqrt(12 * np.quantile(largest, LONG)))


def mean_variance(covariances: Mapping[str, Array], clouds: Mapping[str, Array]) -> float:
    """The mean variance of points by name, along the normals that neighbours suggest."""
    along = [variances_along(each, Neighbourhood.of(clouds[name]).normals) for name, each in covariances.items()]
    return float(np.concatenate(along).mean())
