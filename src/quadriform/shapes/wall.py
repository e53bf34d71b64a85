"""The wall between two surfaces of a model as hexahedra, made by mapping a regular grid through the control box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import InputError, OptionError
from quadriform.points import Array, check_points, unit_vectors
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import short_repr

HALVINGS = 60
"""Where a ray leaves the outer surface is halved so often: to the last bits."""
CORNERS = np.array([[i, j, k] for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=np.float64)
"""The corners of a cell in VTK's order."""


@dataclass(frozen=True, repr=False)
class HexMesh:
    """Hexahedra in space.

    Attributes:
        vertices: (n, 3), in the unit of the model.
        cells: (m, 8), indices into `vertices`: a side towards the cavity, counter-clockwise seen from outside, then
            the one opposite; VTK's order.
        axes: (m, 3, 3), for each cell the unit vectors radial (outward), circumferential and longitudinal (towards
            the base), at right angles to each other.
        depth: (m,), of the cells' middles, from 0 at the inner to 1 at the outer surface.
    """

    __repr__ = short_repr

    vertices: Array
    cells: NDArray[np.int64]
    axes: Array
    depth: Array

    def jacobians(self) -> Array:
        """Determinants (m, 8) of each cell's trilinear map from the unit cube at its corners; positive: unfolded."""
        return self._determinants(CORNERS)

    def volumes(self) -> Array:
        """Volumes of the cells (m,), in cubed units, by two Gauss points along each axis: exact."""
        # A trilinear determinant is quadratic in each coordinate, which two Gauss points integrate exactly.
        low = 0.5 - 0.5 / np.sqrt(3)
        return self._determinants(np.where(CORNERS > 0, 1 - low, low)).mean(axis=1)

    def _determinants(self, points: Array) -> Array:
        """Determinants (m, q) of each cell's trilinear map at points (q, 3) of the unit cube."""
        return np.linalg.det(np.einsum("qcd,mcx->mqxd", _derivatives(points), self.vertices[self.cells]))


def wall_mesh(
    model: DeformableModel,
    inner: str = "endo",
    outer: str = "epi",
    *,
    layers: int = 4,
    resolution: int = 12,
    long_axis: ArrayLike | None = None,
) -> HexMesh:
    """The hexahedra that fill the space between two superellipsoids of a model.

    The grid is laid out before deformation: rays from the centre of the inner surface, each divided into equal parts
    between the two surfaces. The control box deforms its vertices, so that the same cell is the same piece of wall in
    every state of a moving model.

    Args:
        model: with both surfaces.
        inner: name of the inner surface.
        outer: name of the outer surface.
        layers: cells across the wall.
        resolution: cells along an edge of the surface's grid, as in `Superquadric.mesh`; 6 n^2 cells a layer.
        long_axis: (3,) from apex to base, in the world; None is the inner surface's longest semi-axis after
            deformation, away from the end that is farther from the middle of its mesh.

    Raises:
        OptionError: a name is unknown, a surface is no superellipsoid, the inner one is not inside the outer one, or
            a number is out of range.
        InputError: cells are folded.
    """
    for name, value in (("layers", layers), ("resolution", resolution)):
        if not isinstance(value, int) or value < 1:
            raise OptionError(f"option {name}={value!r}; expected a whole number >= 1")
    start, quads = model.superquadric(inner).grid(resolution)
    stop = _opposite(model, inner, outer, start)
    depths = np.linspace(0, 1, layers + 1)[:, None, None]
    vertices = model.deform((start + depths * (stop - start)).reshape(-1, 3))
    floors = [np.concatenate([quads + k * len(start), quads + (k + 1) * len(start)], axis=1) for k in range(layers)]
    cells = np.concatenate(floors)
    axis = (
        _long_axis(model, inner)
        if long_axis is None
        else unit_vectors(check_points(np.reshape(long_axis, (1, -1)), "long_axis"))[0]
    )
    depth = np.repeat((np.arange(layers) + 0.5) / layers, len(quads))
    mesh = HexMesh(vertices, cells, _axes(vertices[cells], axis), depth)
    _check_unfolded(mesh, inner, outer)
    return mesh


def _opposite(model: DeformableModel, inner: str, outer: str, start: Array) -> Array:
    """Points (n, 3) where the rays from the inner centre through its surface points leave the outer surface."""
    small, large = model.superquadric(inner), model.superquadric(outer)
    for name, surface in ((inner, small), (outer, large)):
        if not surface.is_radial:
            raise OptionError(f"surface {name!r}: expected a superellipsoid, found kind={surface.kind!r}")
    outside = large.implicit(start) >= 1
    if outside.any():
        raise OptionError(
            f"{inner!r} lies outside {outer!r} at {int(outside.sum())} of {len(start)} points; expected the inner "
            "surface first; are the names swapped?"
        )
    rays = start - small.translation
    return small.translation + exits(large, small.translation, rays)[:, None] * rays


def exits(surface: Superquadric, centre: Array, rays: Array) -> Array:
    """Distances (n,) along rays (n, 3), in lengths of each, from a centre (3,) inside a superellipsoid to its surface.

    By halving: with exponents up to 2 it is convex, and a ray is inside up to there. A pinched one, with an exponent
    above 2, may be left several times by a ray that starts beside its centre; the result is then one of these exits.
    """
    farthest = np.linalg.norm(surface.translation - centre) + np.linalg.norm(surface.semi_axes)
    low, high = np.zeros(len(rays)), farthest / np.linalg.norm(rays, axis=1)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = surface.implicit(centre + middle[:, None] * rays) < 1
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return (low + high) / 2


def _long_axis(model: DeformableModel, inner: str) -> Array:
    superquadric = model.superquadric(inner)
    longest = superquadric.semi_axes.argmax()
    step = superquadric.semi_axes[longest] * superquadric.rotation[:, longest]
    ends = model.deform(superquadric.translation + np.stack([-step, step]))
    middle = model.mesh(inner, 8).vertices.mean(axis=0)
    apex, base = ends[np.argsort(-np.linalg.norm(ends - middle, axis=1), kind="stable")]
    return unit_vectors(base - apex)


def _axes(corners: Array, axis: Array) -> Array:
    """Radial: the normal of a cell's layer in its middle; circumferential: around the axis; longitudinal: the rest."""
    along = np.einsum("cd,mcx->mdx", _derivatives(np.full((1, 3), 0.5))[0], corners)
    radial = unit_vectors(np.cross(along[:, 0], along[:, 1]))
    # On the axis the circumferential direction is undefined; any perpendicular one is taken.
    around = np.cross(axis, radial)
    on_axis = np.linalg.norm(around, axis=1) < 1e-9
    around[on_axis] = np.cross(np.eye(3)[np.abs(radial[on_axis]).argmin(axis=1)], radial[on_axis])
    around = unit_vectors(around)
    return np.stack([radial, around, np.cross(radial, around)], axis=1)


def _derivatives(points: Array) -> Array:
    """Derivatives (q, 8, 3) of the trilinear weights of a cell's corners at points (q, 3) of the unit cube."""
    factors = np.where(CORNERS > 0, points[:, None], 1 - points[:, None])
    signs = np.where(CORNERS > 0, 1.0, -1.0)
    return signs * np.roll(factors, -1, axis=2) * np.roll(factors, -2, axis=2)


def _check_unfolded(mesh: HexMesh, inner: str, outer: str) -> None:
    lowest = mesh.jacobians().min(axis=1)
    folded = lowest <= 0
    if folded.any():
        where = mesh.vertices[mesh.cells[lowest.argmin()]].mean(axis=0)
        raise InputError(
            f"{int(folded.sum())} of {len(folded)} cells between {inner!r} and {outer!r} are folded, the worst at "
            f"{np.round(where, 3).tolist()}; try a higher resolution, or fit the model with a larger strength"
        )
