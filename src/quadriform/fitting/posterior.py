"""The posterior of a single fit, as samples of the control points of a box with more of them.

A sample has the errors that `Fit.uncertainty` counts: noise and missing data by the posterior of the enriched box; its
distance from the fitted one, the bias; and, where there is no data, errors of the superquadric and the distance between
it and its refinement. The latter two are one sample of the superquadric and one sign for the whole part without data:
its errors are correlated over all of it, and do not cancel in a volume as independent ones would. They are
displacements of the surface along its normal, to which control points are fitted, as smooth as the fit itself; beside
data they fade within the distance that the control points resolve.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from quadriform.fitting.elements import Elements
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.posterior import SAMPLES, SEED, Posterior

LEAST_DIAGONAL = 1e-9
"""Added to the diagonal, relative to its largest entry: displacements that no normal shows become zero."""


class Extrapolation(Protocol):
    """What is known of a surface without data."""

    def variances(self, points: Array) -> Array:
        """Variances (n,) at points (n, 3) of the surface, zero where there is data nearby."""

    def deviations(self, points: Array, normal: Array, signs: Array) -> Array:
        """Samples (n, m) of the error along the normal at points (m, 3), from random numbers (n, p) and signs (n,)."""


def posterior_of(
    model: DeformableModel, enriched: EnrichedBox, extrapolations: Mapping[str, Extrapolation]
) -> Posterior:
    """The posterior of the control points of a fit.

    Args:
        model: the fitted one, in the unit of the data, and in any coordinates of the world.
        enriched: the same data with more control points.
        extrapolations: surface -> what is known of it without data.
    """
    rng, size = np.random.default_rng(SEED), enriched.box.control_points.size
    deviations = enriched.samples(rng.normal(size=(SAMPLES, size)), _signs(rng))
    rotation = enriched.rotation_to(model.box)
    errors = [_errors(model, name, rotation, each, rng) for name, each in extrapolations.items()]
    if errors:
        deviations += _control_points(enriched, *map(np.concatenate, zip(*errors)))
    shape = enriched.box.control_points.shape
    return Posterior(deviations.reshape(SAMPLES, *shape), enriched.source).rotated(rotation)


def _signs(rng: np.random.Generator) -> Array:
    """As many +1 as -1 (n,), in random order."""
    return rng.permutation(np.resize([1.0, -1.0], SAMPLES))


def _errors(
    model: DeformableModel, name: str, rotation: Array, known: Extrapolation, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Origins (m, 3), normals (m, 3) in the coordinates of the data, areas (m,), and errors (m, n) of a surface."""
    elements = Elements.of(model, name, None)
    normal = rng.normal(size=(SAMPLES, len(model.surfaces[name].parameters)))
    errors = known.deviations(elements.points @ rotation, normal, _signs(rng))
    return model.box.local(elements.origins), elements.normals @ rotation, elements.areas, errors.T


def _control_points(enriched: EnrichedBox, local: Array, normals: Array, areas: Array, errors: Array) -> Array:
    """Displacements (n, 3 k) of control points that move surface points along their normals by errors (m, n)."""
    origins = enriched.box.origin + local @ enriched.box.edges
    rows = (enriched.box.matrix(origins)[:, :, None] * normals[:, None, :]).reshape(len(origins), -1)
    weights = areas / areas.sum()
    matrix = rows.T @ (weights[:, None] * rows) + enriched.strength * np.kron(enriched.regulariser, np.eye(3))
    diagonal = np.arange(len(matrix))
    matrix[diagonal, diagonal] += LEAST_DIAGONAL * matrix.max()
    found: Array = cho_solve(cho_factor(matrix, lower=True), rows.T @ (weights[:, None] * errors))
    return found.T
