"""Points of a fitted surface with the area around each, and their standard deviations by that of the control points."""

from dataclasses import dataclass

import numpy as np

from quadriform.points import Array, lengths, unit_vectors
from quadriform.shapes.mesh import Mesh, split_quads
from quadriform.shapes.model import DeformableModel

RESOLUTION = 8
"""Of the mesh on which the standard deviation of a surface is taken, which is smooth."""


@dataclass(frozen=True)
class Elements:
    """Parts of one surface of a model, a point for each.

    Attributes:
        origins: (m, 3), on the undeformed surface.
        points: (m, 3), on the surface.
        normals: (m, 3), unit.
        areas: (m,), zero where no data is expected.
    """

    origins: Array
    points: Array
    normals: Array
    areas: Array

    @classmethod
    def of(cls, model: DeformableModel, name: str, half_space: tuple[Array, Array] | None) -> "Elements":
        """The elements of a surface, given by name; `half_space` (point, direction) is where no data is expected."""
        origins, quads = model.surfaces[name].grid(RESOLUTION)
        mesh = Mesh(model.box.deform(origins), split_quads(quads, origins))
        vectors = np.zeros_like(origins)  # a triangle is shared among its corners
        np.add.at(vectors, mesh.faces.ravel(), np.repeat(mesh.area_vectors() / 3, 3, axis=0))
        areas = lengths(vectors)
        if half_space is not None:
            areas[(mesh.vertices - half_space[0]) @ half_space[1] > 0] = 0.0
        return cls(origins, mesh.vertices, unit_vectors(vectors), areas)

    def variances(self, model: DeformableModel, covariance: Array) -> Array:
        """Variances (m,) along the normals by the covariance C (3 k, 3 k) of the control points: b' C b, b = B n."""
        rows = model.box.matrix(self.origins)[:, :, None] * self.normals[:, None, :]
        rows = rows.reshape(len(self.origins), -1)
        return np.asarray(np.einsum("ij,ij->i", rows @ covariance, rows))
