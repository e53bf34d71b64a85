"""A prior on the surface beyond a base, where there is no data: the smallest body that explains the data is preferred.

Without data the regulariser alone determines that part, and affine growth has no bending energy. So the height of the
surface above a plane a little beyond the base has a Gaussian prior, weighted by the ratio of the noise to its spread:
for exact data it vanishes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.fitting.result import HalfSpace
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class Closure:
    """The constants of the prior on the surface beyond a base."""

    allowed_height: float = 0.2
    """A surface may reach this height above its base without a cost, in RMS radii of the points: a smooth surface needs
    some height to close, and one that is drawn to the plane bends inwards below it, where there is data."""
    spread: float = 0.1
    """Standard deviation of the height above the allowed one, in RMS radii."""
    cells: int = 12
    """Cells along an edge of the grid of a surface, which has 866 points: dozens of them beyond a base."""


CLOSURE = Closure()


@dataclass(frozen=True)
class BasePrior:
    """A penalty: `weight` times the mean, over the whole surface, of the square of its height above the allowed one.

    Heights are over the plane of the base, in the direction without data; the allowed one is `CLOSURE.allowed_height`.

    Attributes:
        surface: before deformation.
        half_space: beyond the base.
        weight: of the mean.
    """

    surface: Superquadric
    half_space: HalfSpace
    weight: float

    def equations(self, box: ControlBox) -> NormalEquations:
        """Normal equations of the penalty in the displacement of the control points, for points too high at `box`."""
        origins, heights, weights = self._heights(box)
        direction = self.half_space[1]
        metric = (weights * (heights > 0))[:, None, None] * np.outer(direction, direction)
        targets = box.deform(origins) - heights[:, None] * direction
        return Rows(origins, targets, metric).equations(box)

    def cost(self, box: ControlBox) -> float:
        """The value of the penalty at a box."""
        _, heights, weights = self._heights(box)
        return float(weights @ np.maximum(heights, 0) ** 2)

    def _heights(self, box: ControlBox) -> tuple[Array, Array, Array]:
        """Undeformed points (n, 3), and of the deformed ones heights above the allowed one and weights (n,)."""
        at, direction = self.half_space
        grid = self.surface.mesh(CLOSURE.cells)
        moved = box.deform(grid.vertices)
        areas = np.linalg.norm(Mesh(moved, grid.faces).area_vectors(), axis=1)
        # each vertex stands for a third of the triangles around it, so that the mean is one over the area
        fractions = np.bincount(grid.faces.ravel(), np.repeat(areas / areas.sum() / 3, 3), len(moved)).astype(float)
        return grid.vertices, (moved - at) @ direction - CLOSURE.allowed_height, self.weight * fractions


def base_prior(data: SurfaceData, box: ControlBox, total_weight: float) -> list[BasePrior]:
    """The penalty of a surface with a base, at the noise of its data; empty without a base or inliers.

    Args:
        data: of the surface.
        box: deformed.
        total_weight: sum of the weights of the inliers that the data stands for; the prior has this weight at most.
    """
    if data.half_space is None or not data.total_weight:
        return []
    sigma = np.sqrt(np.average(data.standardised_distances(box) ** 2, weights=data.effective_weights))
    # far from the data, before the first rounds, the prior counts no more than the data
    weight = total_weight * min(float(sigma) / CLOSURE.spread, 1.0) ** 2
    return [BasePrior(data.superquadric, data.half_space, weight)]


def base_priors(datasets: Sequence[SurfaceData], box: ControlBox) -> list[BasePrior]:
    """The penalties of all surfaces with a base."""
    return [found for data in datasets for found in base_prior(data, box, data.total_weight)]
