"""The isosurface of an image, as a mesh in the world (paper section 5)."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import MaskError, WarningKind, Warnings, choose
from quadriform.imaging.volume import Volume
from quadriform.imaging.voxel_faces import border_cut_text
from quadriform.points import Array, check_number
from quadriform.shapes.mesh import Mesh

Border = Literal["open", "close"]

LEAST_EXCESS = 1e-4
"""The excess of a voxel is its value minus the level. None is smaller in size than this fraction of the largest: else
vertices coincide at voxel centres."""


@dataclass(frozen=True)
class Isosurface:
    """A surface, and which of its vertices are no data.

    Attributes:
        mesh: in the world of the image; faces are counter-clockwise seen from outside.
        on_border: (n,) bool, vertices that close the object where the image cuts it; none for border="open".
        warnings: BORDER_CUT.
    """

    mesh: Mesh
    on_border: NDArray[np.bool_]
    warnings: Warnings


def isosurface(volume: Volume, level: float = 0.5, *, border: Border = "open") -> Isosurface:
    """Return the isosurface of an image by marching cubes; inside is above `level`.

    Vertices lie between voxel centres: exactly halfway for a mask; for a grey image where the values, interpolated
    linearly, equal `level`.

    Args:
        volume: a mask of 0 and 1, or a grey image.
        level: 0.5 for a mask.
        border: where the object leaves the image, "open" ends the surface at the outermost voxel centres;
            "close" closes it half a voxel outside them.

    Raises:
        MaskError: no voxel or every voxel is above the level.
        OptionError: an option is unknown or out of its range.
    """
    choose(border, ("open", "close"), "border")
    excess = volume.values.astype(np.float64) - check_number(level, "level", -np.inf)
    inside = excess > 0
    if not inside.any() or inside.all():
        which = "no voxel is" if not inside.any() else "all voxels are"
        low, high = volume.values.min(), volume.values.max()
        raise MaskError(f"{which} above the level {level:g}; the values run from {low:g} to {high:g}")
    least = LEAST_EXCESS * np.abs(excess).max()
    excess = np.where(inside, np.maximum(excess, least), np.minimum(excess, -least))
    padding = 1 if border == "close" else 0
    vertices, faces = _marching_cubes(_padded(excess) if padding else excess)  # section 5
    voxels = vertices - padding
    on_border: NDArray[np.bool_] = np.any((voxels < 0) | (voxels > np.array(inside.shape) - 1), axis=1)
    # a left-handed grid mirrors the mesh, which reverses the order of its corners
    if np.linalg.det(volume.world_from_voxel[:3, :3]) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    warnings: Warnings = {}
    if cut := border_cut_text(inside, volume.world_from_voxel):
        end = f"closed there by {int(on_border.sum())} vertices" if padding else "left open there"
        warnings[WarningKind.BORDER_CUT] = f"{cut}; {end}"
    return Isosurface(Mesh(volume.points_world(voxels), faces), on_border, warnings)


def edge_noise(volume: Volume, points: Array) -> Array:
    """Covariances (n, 3, 3) of vertices of the surface of a mask, in the square of the unit of the image.

    A vertex lies in the middle of the edge between two voxels; the surface crosses that edge anywhere. So the error is
    uniform along the edge e, with the covariance e e' / 12, and there is none across it. A vertex inside a cube of
    eight voxels, as marching cubes adds where the pattern of a cube is ambiguous, is taken to be on an edge along the
    axis whose coordinate is farthest from a whole number.

    Args:
        volume: the image.
        points: (n, 3), in its world; vertices, or such moved off their edge by less than half a voxel, as
            `ventricle.BELOW_FACE` does.
    """
    voxels = volume.voxels(points)
    # of a vertex the coordinate along its edge is a whole number and a half, the other two are whole
    axis = np.abs(voxels - np.rint(voxels)).argmax(axis=1)
    edges = volume.world_from_voxel[:3, :3].T[axis]
    return edges[:, :, None] * edges[:, None, :] / 12


def grey_of_object(mask: Volume, grey: Volume, level: float) -> Volume:
    """Return the grey image, mirrored at `level` in each voxel where a mask and the level differ about the inside.

    Its isosurface at `level` is that of the grey image, but of the masked object only: other bright objects are moved
    below the level, and voxels that the mask adds above it.
    """
    excess = grey.values.astype(np.float64) - level
    return replace(grey, values=level + np.where(mask.values > 0, np.abs(excess), -np.abs(excess)))


def _padded(excess: Array) -> Array:
    """One more layer on each side, as far below zero as the border is above it: zero is half a voxel outside."""
    padded = -np.abs(np.pad(excess, 1, mode="edge"))
    padded[1:-1, 1:-1, 1:-1] = excess
    return padded


def _marching_cubes(excess: Array) -> tuple[Array, NDArray[np.int64]]:
    from skimage.measure import marching_cubes

    # skimage orders the corners clockwise: its "ascent" gives counter-clockwise faces seen from outside
    vertices, faces, _, _ = marching_cubes(excess, 0.0, gradient_direction="ascent")
    return _in_double(vertices.astype(np.float64), excess), faces.astype(np.int64)


def _in_double(vertices: Array, excess: Array) -> Array:
    """Vertices on edges between two voxels, recomputed in double precision: those of skimage have single precision."""
    below = np.floor(vertices).astype(np.int64)
    between = vertices != below  # a vertex on an edge has one coordinate that is no integer
    on_edge = between.sum(axis=1) == 1  # those inside a cube stay
    axis = between[on_edge].argmax(axis=1)
    start = below[on_edge]
    # zero of the linear interpolation between the ends of the edge
    low, high = excess[tuple(start.T)], excess[tuple((start + np.eye(3, dtype=np.int64)[axis]).T)]
    vertices[on_edge, axis] = start[np.arange(len(start)), axis] + low / (low - high)
    return vertices
