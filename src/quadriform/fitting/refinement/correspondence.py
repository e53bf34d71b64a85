"""Correspondence of data and surface far from convergence, by distance and by direction of the normals."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from quadriform.fitting.cloud import first_least
from quadriform.fitting.refinement.point_to_plane import Attraction
from quadriform.fitting.refinement.surface_data import OrientedCloud, SurfaceData
from quadriform.points import Array
from quadriform.shapes.closest import surface_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

FACING = 0.4
"""Weight of the angle between the normals of a pair, in RMS radii. With opposite normals the squared distance counts as
larger by 2 FACING^2, that of .57 RMS radii: more than the thickness of a thin body, less than its length."""
MODEL_RESOLUTION = 14
"""Cells along an edge of the grid of model points: 1,178 of them, about as many as data points in the coarse stages."""


@dataclass(frozen=True)
class Correspondence:
    """A cloud and the model points of a surface, of which pairs are found anew in each round.

    Attributes:
        superquadric: of the surface.
        cloud: n data points.
        origins: (m, 3) model points before deformation.
        tree: of the origins.
    """

    superquadric: Superquadric
    cloud: OrientedCloud
    origins: Array
    tree: cKDTree

    @classmethod
    def between(cls, superquadric: Superquadric, cloud: OrientedCloud) -> "Correspondence":
        """Of the cloud and an even grid of the surface."""
        origins, _ = superquadric.grid(MODEL_RESOLUTION)
        return cls(superquadric, cloud, origins, cKDTree(origins))

    def costs(self, box: ControlBox) -> Array:
        """Costs (n, m) of all pairs of a data point x and a model point y: |x - y|^2 + FACING^2 f (1 - cos angle).

        The angle is that of their normals, and f the reliability of the normal at x (`OrientedCloud.flatness`). All
        pairs at once are faster here than a tree, since both sets are small.
        """
        model, normals = surface_points(self.superquadric, box, self.origins)
        normal_weight = FACING**2 * self.cloud.flatness
        # |x - y|^2 + normal_weight (1 - cos angle) expanded, so that all pairs are one product of matrices
        by_data = np.concatenate([-2 * self.cloud.points, -normal_weight[:, None] * self.cloud.normals], axis=1)
        costs: Array = by_data @ np.concatenate([model, normals], axis=1).T
        costs += ((self.cloud.points**2).sum(axis=1) + normal_weight)[:, None]
        costs += (model**2).sum(axis=1)
        return costs

    def matched(self, costs: Array) -> Array:
        """The origins (n, 3) of the model points of least cost for each data point."""
        return self.origins[first_least(costs)]

    def attraction(self, costs: Array, box: ControlBox, data: SurfaceData) -> Attraction | None:
        """Attraction of model points that no data point chose to the data points of least cost (model-to-data).

        Without it parts of the surface could remain where there is no data. None where there is no such model point
        outside of the half-space in which no data is expected.

        Args:
            costs: (n, m).
            box: deformed.
            data: of the surface, with foot points.
        """
        origins, targets = self.unmatched(costs, data.origins)
        if not len(origins):
            return None
        kept = ~data.in_half_space(box.deform(origins))
        weight = float(data.weights.sum()) / len(self.origins)
        return Attraction(origins[kept], targets[kept], weight) if kept.any() else None

    def unmatched(self, costs: Array, foot_point_origins: Array) -> tuple[Array, Array]:
        """Origins (k, 3) of model points that no data point chose, and the data points (k, 3) of least cost for them.

        Args:
            costs: (n, m).
            foot_point_origins: (n, 3) of the data points, each of which chooses the model point nearest to its own.
        """
        remaining = np.ones(len(self.origins), dtype=bool)
        remaining[self.tree.query(foot_point_origins)[1]] = False
        return self.origins[remaining], self.cloud.points[first_least(costs[:, remaining].T)]
