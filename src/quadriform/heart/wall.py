"""The wall by lines of the volumetric map from endocardium to epicardium, straight before deformation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import OptionError
from quadriform.points import Array, unit_vectors
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.mesh import Faces, solid_angles
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.wall import exits

NODES = (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
WEIGHTS = np.polynomial.legendre.leggauss(4)[1] / 2
"""Gauss-Legendre quadrature with four points across the wall, from 0 (endocardium) to 1 (epicardium)."""
LEAST_WALL = 1e-9
"""Of the epicardium's size: a thinner wall is rounding, and has no direction from one surface to the other."""


@dataclass(frozen=True)
class Wall:
    """Lines across the wall, in the undeformed space of all frames.

    A point of a line is centre + s ray, with s from `start` to `stop`; at depth w it is s = start + w (stop - start).

    Attributes:
        centre: (3,), of the endocardial superquadric.
        rays: (n, 3), of length one after each coordinate in the axes of that superquadric is divided by its semi-axis.
        start: (n,), s where the rays leave the endocardium.
        stop: (n,), s where they leave the epicardium.
        cells: (n,), the solid angle about each ray in these coordinates, times the product of the semi-axes: between s
            and s + ds the cell about the ray has the volume cells s^2 ds.
        normals: (2, n, 3), outward unit normals of both surfaces, before deformation.
        quads: (m, 4), neighbours among the rays.
        crossing: (n,), rays on which the epicardium comes first or both surfaces meet; they have no wall.
    """

    centre: Array
    rays: Array
    start: Array
    stop: Array
    cells: Array
    normals: Array
    quads: Faces
    crossing: NDArray[np.bool_]

    @classmethod
    def between(cls, endo: Superquadric, epi: Superquadric, resolution: int = 24) -> "Wall":
        """Return the wall between two superellipsoids, one line for each direction of `sphere_grid`.

        Raises:
            OptionError: the endocardium lies on or outside the epicardium in more than half of the directions, or its
                centre does, as with swapped names.
        """
        directions, quads = sphere_grid(resolution)
        inner = endo.surface(directions)
        rays = (directions * endo.semi_axes) @ endo.rotation.T
        start = np.linalg.norm(inner - endo.translation, axis=1) / np.linalg.norm(rays, axis=1)
        # from s instead of from the surface itself, so that the points lie on the rays to the last digit
        inner = endo.translation + start[:, None] * rays
        crossing = epi.implicit(inner) >= 1 - LEAST_WALL
        if crossing.mean() > 0.5 or epi.implicit(endo.translation[None])[0] >= 1:
            raise OptionError(
                f"surfaces: 'endo' lies on or outside 'epi' in {100 * crossing.mean():.0f} % of its directions; "
                "expected the endocardium inside; are the names swapped?"
            )
        stop = exits(epi, endo.translation, rays)
        cells = np.prod(endo.semi_axes) * _solid_angle(directions, quads)
        outer = endo.translation + stop[:, None] * rays
        normals = np.stack([unit_vectors(endo.gradient(inner)), unit_vectors(epi.gradient(outer))])
        return cls(endo.translation, rays, start, stop, cells, normals, quads, crossing)

    def at(self, depth: float) -> Array:
        """Return material points (n, 3), before deformation, at a depth from 0 (endocardium) to 1 (epicardium)."""
        reach = self.start + depth * (self.stop - self.start)
        return self.centre + reach[:, None] * self.rays

    def normals_at(self, depth: float) -> Array:
        """Return unit normals (n, 3) of the layer at a depth, before deformation, interpolated between the surfaces."""
        return unit_vectors((1 - depth) * self.normals[0] + depth * self.normals[1])

    def thickness(self, box: ControlBox) -> Array:
        """Return the length (n,) of each line after deformation: wall thickness along the volumetric map."""
        # length of the deformed line: integral of |J d| over depth, d the undeformed line
        across = (self.stop - self.start)[:, None] * self.rays
        speeds = [np.einsum("nij,nj->ni", box.jacobian(self.at(depth)), across) for depth in NODES]
        return np.einsum("k,kn->n", WEIGHTS, np.linalg.norm(speeds, axis=2))

    def volumes(self, box: ControlBox) -> Array:
        """Return the deformed volume (n, 4) about each Gauss point; their sum is the volume of the wall."""
        # the integral of cells s^2 det J ds over a line, ds = span dw, by Gauss points in the depth w
        span = self.stop - self.start
        columns = []
        for depth, weight in zip(NODES, WEIGHTS):
            reach = self.start + depth * span
            columns.append(self.cells * reach**2 * span * weight * box.jacobian_determinant(self.at(depth)))
        return np.where(self.crossing[:, None], 0.0, np.stack(columns, axis=1))


def _solid_angle(directions: Array, quads: Faces) -> Array:
    """Solid angle (n,) around each direction: a quarter of each quad it is a corner of."""
    # each quad as two triangles on the unit sphere
    angle = np.zeros(len(directions))
    for corners in ((0, 1, 2), (0, 2, 3)):
        triangle = solid_angles(*(directions[quads[:, k]] for k in corners))
        np.add.at(angle, quads, triangle[:, None] / 4)
    return angle
