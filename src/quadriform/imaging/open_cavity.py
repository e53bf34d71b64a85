"""The cavity inside a wall that is open at one side, and the plane of its opening."""

import numpy as np

from quadriform.errors import MaskError
from quadriform.imaging.segmentation import Mask
from quadriform.imaging.voxel_faces import BACKGROUND, CAVITY, ENCLOSED, WALL, Tissue, enclosed_fraction, faces_between
from quadriform.points import Array
from quadriform.shapes.voxels import voxel_spacing

REACH = 1.5
"""The core is dilated by this many times the distance by which it was eroded: that reaches corners at the opening."""


def fill_open_cavity(wall: Mask, world_from_voxel: Array) -> Tissue:
    """Return which voxels are background, wall and cavity.

    The cavity is a morphological opening of what the convex hull adds to the wall, so it ends across the opening of the
    wall where the hull does, and slits outside the wall are not part of it:

    1. Added are the voxels of the hull that are no wall; R is the largest distance of one to the outside of these.
    2. Erosion by R / 2: the core is the largest connected group of added voxels that are farther than R / 2 from it.
    3. Dilation by 1.5 R / 2: the cavity is the added voxels within this distance from the core.
    4. Pockets, what is left of the added voxels and does not reach the border of the hull: cavity where they touch
       it, else wall, as a hole within the wall.

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
    eroded, _ = ndimage.label(depth > depth.max() / 2)
    counts = np.bincount(eroded.ravel())[1:]
    if not len(counts):
        raise MaskError(f"the wall of {int(wall.sum())} voxels is convex: it has no cavity; try another threshold")
    core = eroded == counts.argmax() + 1
    cavity = added & (_distance(~core, world_from_voxel) <= REACH * depth.max() / 2)
    tissue = np.where(wall, WALL, BACKGROUND).astype(np.int8)
    tissue[cavity] = CAVITY
    _fill_pockets(tissue, hull)
    enclosed = enclosed_fraction(tissue, world_from_voxel)
    if enclosed < ENCLOSED:
        raise MaskError(
            f"no cavity: the largest hollow of the wall is enclosed by {enclosed:.0%} of its surface, expected at "
            f"least {ENCLOSED:.0%}; choose another threshold or region"
        )
    return tissue


def _fill_pockets(tissue: Tissue, hull: Mask) -> None:
    """Assign background inside the hull to the cavity where it touches it, else to the wall; in place."""
    from scipy import ndimage

    pockets, _ = ndimage.label(tissue == BACKGROUND)
    no_pockets = np.unique(pockets[(tissue != BACKGROUND) | ~hull])
    at_cavity = np.unique(pockets[ndimage.binary_dilation(tissue == CAVITY)])
    for pocket in np.setdiff1d(pockets, no_pockets):
        tissue[pockets == pocket] = CAVITY if pocket in at_cavity else WALL


def base_of_open_cavity(tissue: Tissue, world_from_voxel: Array) -> tuple[Array, Array]:
    """Return a plane across the opening: a point (3,), half the thickest wall below it, and the outward direction (3,).

    The rim, where the inner surface continues as the outer one, is cut off by a plane that far below it.

    Raises:
        MaskError: there is no opening.
    """
    centres, areas = faces_between(tissue, CAVITY, BACKGROUND, world_from_voxel)
    if not len(areas):
        raise MaskError("the cavity is closed all around: there is no base to cut; use labels instead")
    direction = areas.sum(axis=0)
    direction = direction / np.linalg.norm(direction)
    depth = _distance(tissue == WALL, world_from_voxel)
    return centres.mean(axis=0) - float(depth.max()) * direction, direction


def _distance(mask: Mask, world_from_voxel: Array) -> Array:
    """Distance of each voxel of a mask to the nearest one outside, along the axes of the grid; a shear is ignored."""
    from scipy import ndimage

    distances = ndimage.distance_transform_edt(mask, sampling=voxel_spacing(world_from_voxel))
    return np.asarray(distances, dtype=np.float64)
