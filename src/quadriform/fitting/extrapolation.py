"""Standard deviation of a surface where there is no data, from the superquadric and from its refinement.

The posterior of the control points is that of their displacement from a superquadric that counts as known. Where there
is data, the displacement corrects an error of the superquadric. Where there is none, nothing corrects it: it comes in
addition to the error of the displacement, and its variance is added as that of an independent error. Where the
refinement moved the surface away from the superquadric, the body is no superquadric, and either of the two may be the
better extrapolation: the square of their distance counts as a further variance.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.diagnostics import MOSTLY_SUPPORTED
from quadriform.fitting.elements import Elements
from quadriform.fitting.result import Result, SuperquadricFit
from quadriform.fitting.superquadric.identifiability import surface_at, surface_rows
from quadriform.fitting.support import Support
from quadriform.points import Array, Frame


@dataclass(frozen=True)
class OpenSurface:
    """What is known of a surface where it has no data.

    Attributes:
        start: the superquadric of which it is a refinement.
        feet: (n, 3), the points of the surface nearest to its inliers, in the frame of the superquadric.
        limit: distance from these up to which the surface has data, in the unit of that frame.
        frame: that of the superquadric, within the world.
    """

    start: SuperquadricFit
    feet: Array
    limit: float
    frame: Frame

    def is_open(self, points: Array) -> NDArray[np.bool_]:
        """Which points (m, 3) of the surface have no data near them."""
        return np.asarray(cKDTree(self.feet).query(self.frame.to_local(points))[0] > self.limit)

    def variances(self, points: Array) -> Array:
        """Variances (m,) at points (m, 3) of the surface by the superquadric and its refinement: zero beside data."""
        found, is_open = np.zeros(len(points)), self.is_open(points)
        if is_open.any():
            local = self.frame.to_local(points[is_open])
            distances, variances = surface_at(self.start.superquadric, self.start.covariance, local)
            found[is_open] = self.frame.scale**2 * (variances + distances**2)
        return found

    def deviations(self, points: Array, normal: Array, signs: Array) -> Array:
        """Samples (n, m) of the error of the surface along its normal at points (m, 3), with the same variances.

        Each sample is one other superquadric, so that its errors are correlated over the whole part without data.

        Args:
            points: of the surface.
            normal: (n, p), independent standard normal numbers for the parameters of the superquadric.
            signs: (n,), +1 and -1: to which side the superquadric is the better extrapolation.
        """
        found, is_open = np.zeros((len(signs), len(points))), self.is_open(points)
        if is_open.any():
            signed, rows = surface_rows(self.start.superquadric, self.frame.to_local(points[is_open]))
            values, vectors = np.linalg.eigh(self.start.covariance)
            parameters = (normal * np.sqrt(np.maximum(values, 0))) @ vectors.T
            found[:, is_open] = self.frame.scale * (parameters @ rows + signs[:, None] * signed)
        return found


def open_surfaces(
    result: Result, support: Mapping[str, Support], feet: Mapping[str, Array], frame: Frame
) -> dict[str, OpenSurface]:
    """Name -> what is known of a surface without data.

    None of a surface without inliers, of one whose superquadric was given and not fitted, and of any by a refinement
    that has no covariance of the control points (method="paper").

    Args:
        result: of the refinement.
        support: name -> of the surfaces by their data.
        feet: name -> (n, 3), the points of the surfaces nearest to their inliers.
        frame: of all these.
    """
    return {
        name: OpenSurface(start, feet[name], support[name].limit, frame)
        for name, start in result.starts.items()
        if result.covariance is not None and len(feet[name])
    }


def open_deviations(result: Result, support: Mapping[str, Support], feet: Mapping[str, Array]) -> dict[str, float]:
    """Name -> standard deviation of the part of a surface without data, as RMS over its area.

    Surfaces with data on most of their area have none. Arguments as in `open_surfaces`.
    """
    found, covariance = dict[str, float](), result.covariance
    for name, surface in open_surfaces(result, support, feet, Frame(np.zeros(3), 1.0)).items():
        if support[name].within < MOSTLY_SUPPORTED and covariance is not None:
            elements = Elements.of(result.model, name, result.half_space)
            areas = elements.areas * surface.is_open(elements.points)
            squares = elements.variances(result.model, covariance) + surface.variances(elements.points)
            found[name] = float(np.sqrt(areas @ squares / areas.sum())) if areas.any() else 0.0
    return found
