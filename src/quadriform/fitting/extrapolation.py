"""Standard deviation of a surface where there is no data, from the superquadric and from its refinement.

The posterior of the control points takes the superquadric as known. Where data ends nothing corrects it, so its own
variance is added. And where the refinement moved the surface, the body is no superquadric, and either of the two may be
the better extrapolation: their squared distance counts as a variance.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.fitting.diagnostics import MOSTLY_SUPPORTED
from quadriform.fitting.elements import Elements
from quadriform.fitting.result import Result, SuperquadricFit
from quadriform.fitting.superquadric.identifiability import surface_at
from quadriform.fitting.support import Support
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel


def open_deviations(result: Result, support: Mapping[str, Support], feet: Mapping[str, Array]) -> dict[str, float]:
    """Name -> standard deviation of the part of a surface without data, as RMS over its area.

    Surfaces with data on most of their area have none.

    Args:
        result: of the refinement.
        support: name -> of the surfaces by their data.
        feet: name -> (n, 3), the points of the surfaces nearest to their inliers.
    """
    covariance, found = result.covariance, dict[str, float]()
    for name, start in result.starts.items():
        if covariance is not None and support[name].within < MOSTLY_SUPPORTED and len(feet[name]):
            elements = Elements.of(result.model, name)
            is_open = cKDTree(feet[name]).query(elements.points)[0] > support[name].limit
            if result.half_space is not None:
                is_open &= (elements.points - result.half_space[0]) @ result.half_space[1] <= 0
            found[name] = _deviation(result.model, elements, covariance, start, is_open)
    return found


def _deviation(
    model: DeformableModel, elements: Elements, covariance: Array, start: SuperquadricFit, is_open: NDArray[np.bool_]
) -> float:
    distances, variances = surface_at(start.superquadric, start.covariance, elements.points)
    squares = elements.variances(model, covariance) + variances + distances**2
    total = float(elements.areas @ is_open)
    return float(np.sqrt((elements.areas * is_open) @ squares / total)) if total else 0.0
