"""The cavity inside a wall that is open at one side: closed across the opening, and where the opening is."""

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import MaskError
from quadriform.imaging.border import face_area_vectors
from quadriform.imaging.segmentation import Mask
from quadriform.points import Array

Tissue = NDArray[np.int8]
BACKGROUND, WALL, CAVITY = 0, 1, 2
REACH = 1.5
"""Cavity is what lies within so many radii of a ball's core: corners at the mouth, but nothing behind the wall."""
ENCLOSED = 0.5
"""At least this share of a cavity's surface is wall; less is a dent."""


def fill_open_cavity(wall: Mask, world_from_voxel: Array) -> Tissue:
    """Which voxels are background, wall and cavity.

    The cavity is found in what the convex hull adds to the wall: the largest balls there, at least half as wide as
    the widest, all that they cover, and the pockets between them and the wall. So it ends across the opening where
    the hull does, and slits outside the wall are left out. Enclosed holes of the wall count as wall.

    Args:
        wall: (i, j, k) bool.
        world_from_voxel: (4, 4), for distances.

    Raises:
        MaskError: the wall encloses nothing.
    """
    from scipy import ndimage
    from skimage.morphology import convex_hull_image

    hull = convex_hull_image(wall)
    added = hull & ~wall
    depth = _distance(added, world_from_voxel)
    balls, _ = ndimage.label(depth > depth.max() / 2)
    counts = np.bincount(balls.ravel())[1:]
    if not len(counts):
        raise MaskError(f"the wall of {int(wall.sum())} voxels is convex: it has no cavity; try another threshold")
    largest = balls == counts.argmax() + 1
    cavity = added & (_distance(~largest, world_from_voxel) <= REACH * depth.max() / 2)
    tissue = np.where(wall, WALL, BACKGROUND).astype(np.int8)
    tissue[cavity] = CAVITY
    pockets, n = ndimage.label(tissue == BACKGROUND)
    open_ones = np.unique(pockets[~hull])
    at_cavity = np.unique(pockets[ndimage.binary_dilation(cavity)])
    for pocket in np.setdiff1d(np.arange(1, n + 1), open_ones):
        tissue[pockets == pocket] = CAVITY if pocket in at_cavity else WALL
    _check_enclosed(tissue, world_from_voxel)
    return tissue


def faces_between(tissue: Tissue, one: int, other: int, world_from_voxel: Array) -> tuple[Array, Array]:
    """Sides of voxels between two tissues: their middles (n, 3) and area vectors (n, 3) from `one` to `other`."""
    middles, areas = [], []
    for axis, area in enumerate(face_area_vectors(world_from_voxel)):
        low, high = np.delete(tissue, -1, axis), np.delete(tissue, 0, axis)
        for first, second, sign in ((one, other, 1.0), (other, one, -1.0)):
            voxels = np.argwhere((low == first) & (high == second)) + 0.5 * (np.arange(3) == axis)
            middles.append(voxels @ world_from_voxel[:3, :3].T + world_from_voxel[:3, 3])
            areas.append(np.broadcast_to(sign * area, (len(voxels), 3)))
    return np.concatenate(middles), np.concatenate(areas)


def base_of_open_cavity(tissue: Tissue, world_from_voxel: Array) -> tuple[Array, Array]:
    """The plane across the mouth of a hollow, half the thickest wall below it, and the unit direction out of it.

    That much lower the rim, where the inner surface turns into the outer one, is behind the plane.

    Raises:
        MaskError: there is no mouth.
    """
    middles, areas = faces_between(tissue, CAVITY, BACKGROUND, world_from_voxel)
    if not len(areas):
        raise MaskError("the cavity is closed all around: there is no base to cut; use labels instead")
    direction = areas.sum(axis=0)
    direction = direction / np.linalg.norm(direction)
    depth = _distance(tissue == WALL, world_from_voxel)
    return middles.mean(axis=0) - float(depth.max()) * direction, direction


def _check_enclosed(tissue: Tissue, world_from_voxel: Array) -> None:
    areas = [
        np.linalg.norm(faces_between(tissue, CAVITY, other, world_from_voxel)[1], axis=1).sum()
        for other in (WALL, BACKGROUND)
    ]
    share = areas[0] / max(sum(areas), 1e-300)
    if share < ENCLOSED:
        raise MaskError(
            f"no cavity: the largest hollow of the wall is walled by {share:.0%} of its surface, expected at least "
            f"{ENCLOSED:.0%}; choose another threshold or region"
        )


def _distance(mask: Mask, world_from_voxel: Array) -> Array:
    """Distance of each voxel of a mask to the nearest one that is not; along the axes of the grid, however skew."""
    from scipy import ndimage

    spacing = np.linalg.norm(world_from_voxel[:3, :3], axis=0)
    return np.asarray(ndimage.distance_transform_edt(mask, sampling=spacing), dtype=np.float64)
