"""Correspondence of data and surface far from convergence: near, and facing the same way."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import first_least
from quadriform.fitting.refinement.point_to_plane import Attraction
from quadriform.fitting.refinement.surface_data import FacingCloud, SurfaceData
from quadriform.points import Array
from quadriform.shapes.closest import surface_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

FACING = 0.4
"""A point that faces the other way counts as if it were this much farther, times the square root of two (RMS radii)."""
MODEL_RESOLUTION = 14


@dataclass(frozen=True)
class Correspondence:
    """A cloud and the model points of a surface, for pairs of them to be sought anew in each round.

    Attributes:
        superquadric: of the surface.
        cloud: n data points.
        origins: (m, 3) model points before deformation.
        tree: of the origins.
    """

    superquadric: Superquadric
    cloud: FacingCloud
    origins: Array
    tree: cKDTree

    @classmethod
    def between(cls, superquadric: Superquadric, cloud: FacingCloud) -> "Correspondence":
        """Of the cloud and an even grid of the surface."""
        origins, _ = superquadric.grid(MODEL_RESOLUTION)
        return cls(superquadric, cloud, origins, cKDTree(origins))

    def costs(self, box: ControlBox) -> Array:
        """Cost (n, m) of bringing each data point and each model point together: |x - y|^2 + FACING^2 trust (1 - cos).

        One product of matrices: few points against few are done before a tree of them stands.
        """
        model, normals = surface_points(self.superquadric, box, self.origins)
        trust = FACING**2 * self.cloud.flatness
        # |x - y|^2 + trust (1 - cos) expanded, so that all pairs are one product of matrices
        by_data = np.concatenate([-2 * self.cloud.points, -trust[:, None] * self.cloud.normals], axis=1)
        costs: Array = by_data @ np.concatenate([model, normals], axis=1).T
        costs += ((self.cloud.points**2).sum(axis=1) + trust)[:, None]
        costs += (model**2).sum(axis=1)
        return costs

    def facing(self, costs: Array) -> Array:
        """For each data point the origin (n, 3) of the best of the model points."""
        return self.origins[first_least(costs)]

    def attraction(self, costs: Array, box: ControlBox, data: SurfaceData) -> Attraction | None:
        """Of model points that no data point chose, each to the data point it would choose: model-to-data.

        Without it a part of the surface that the data has left behind stays in empty space. None where there is no such
        model point, but where no data is expected.

        Args:
            costs: (n, m).
            box: deformed.
            data: of the surface, with foot points.
        """
        origins, targets = self.unclaimed(costs, data.origins)
        if not len(origins):
            return None
        kept = ~data.in_half_space(box.deform(origins))
        weight = float(data.weights.sum()) / len(self.origins)
        return Attraction(origins[kept], targets[kept], weight) if kept.any() else None

    def unclaimed(self, costs: Array, claimed: Array) -> tuple[Array, Array]:
        """Model points that no data point chose, and the data point that each would choose.

        Args:
            costs: (n, m).
            claimed: (n, 3) origins that data points chose.

        Returns:
            Origins (k, 3) of the unclaimed model points and the data points (k, 3) that attract them.
        """
        unclaimed = np.ones(len(self.origins), dtype=bool)
        unclaimed[self.tree.query(claimed)[1]] = False
        return self.origins[unclaimed], self.cloud.points[first_least(costs[:, unclaimed].T)]
