"""The open end of a labelled ventricle: the flat end of a stack of slices, or a face of the image."""

import numpy as np

from quadriform.imaging.image_points import slice_axis
from quadriform.imaging.volume import Region, Volume
from quadriform.imaging.voxel_faces import CAVITY, WALL, Tissue, face_area_vectors
from quadriform.points import Array, unit_vectors

End = tuple[int, int]
"""An axis of the image, and which of its ends: 0 the first, -1 the last."""
FACES: tuple[End, ...] = tuple((axis, which) for axis in range(3) for which in (0, -1))


def flat_end(tissue: Tissue, world_from_voxel: Array) -> End | None:
    """Return the end of the slice axis at which the labels of a cavity end flat and open; None where both are rounded.

    The open section of an end is the voxels of the cavity in its outermost slice that no wall covers in the slice after
    it. The end of the larger one is the base: the cavity is narrower at its apex. With a, the ratio of this section to
    the largest section of the cavity, the base is

    - flat where a > sqrt(e), nearer to the 1 of a cylinder, by ratio, than to e;
    - rounded otherwise,

    where e = 1 - (1 - 1/n)^2 is the same ratio of an ellipsoid of n slices, whose outermost one has its middle at
    1 - 1/n of the semi-axis.

    Args:
        tissue: of each voxel.
        world_from_voxel: (4, 4); slices lie across the axis of the largest spacing.
    """
    axis = slice_axis(world_from_voxel)
    across = np.moveaxis(tissue, axis, 0)
    areas = (across == CAVITY).sum(axis=(1, 2))
    first, last = np.flatnonzero(areas)[[0, -1]]
    at_first, at_last = _open_voxels(across, first, first - 1), _open_voxels(across, last, last + 1)
    ellipsoid = 1 - (1 - 1 / int(last - first + 1)) ** 2
    if max(at_first, at_last) <= float(np.sqrt(ellipsoid)) * areas.max():
        return None
    return axis, 0 if at_first >= at_last else -1


def _open_voxels(across: Tissue, at: int, after: int) -> int:
    """The number of voxels of the cavity in a slice that no wall covers in the slice after it."""
    cavity = across[at] == CAVITY
    inside = 0 <= after < len(across)
    return int((cavity & (across[after] != WALL)).sum() if inside else cavity.sum())


def region_up_to(tissue: Tissue, region: Region, end: End) -> Region:
    """Return the part of a region that ends with the labels of the cavity at one end.

    Args:
        tissue: of each voxel of the region.
        region: half-open ranges of voxels of the image.
        end: where it is to end.
    """
    axis, which = end
    labelled = np.flatnonzero(np.moveaxis(tissue == CAVITY, axis, 0).any(axis=(1, 2)))
    start, stop = region[axis]
    side = (start + int(labelled[0]), stop) if which == 0 else (start, start + int(labelled[-1]) + 1)
    i, j, k = (side if number == axis else each for number, each in enumerate(region))
    return i, j, k


def open_face(tissue: Tissue, cropped: Volume, end: End | None, base: tuple[Array, Array] | None) -> End | None:
    """Return the face of the image where a ventricle is open; None where nothing is cut.

    Args:
        tissue: of each voxel.
        cropped: the image, or the region.
        end: of the stack of labels, where it is known.
        base: a plane (point, direction), in whose direction the open face is; without both, the face is that which cuts
            the largest area of the cavity.
    """
    if end is not None:
        return end
    # compared by area, for faces across thick slices are larger
    areas = face_area_vectors(cropped.world_from_voxel)
    if base is not None:
        outward = [unit_vectors(areas[axis]) * (-1 if which == 0 else 1) for axis, which in FACES]
        return FACES[int(np.argmax(outward @ np.asarray(base[1], dtype=np.float64)))]
    cuts = [float((tissue == CAVITY).take(which, axis).sum() * np.linalg.norm(areas[axis])) for axis, which in FACES]
    return FACES[int(np.argmax(cuts))] if max(cuts) > 0 else None


def closed_but_for(face: End | None, tissue: Tissue, cropped: Volume) -> tuple[Tissue, Volume]:
    """Return tissue and image with a layer of background at the other faces that cut it: a surface closes there.

    Args:
        face: the open one.
        tissue: of each voxel.
        cropped: the image, or the region.
    """
    layers = np.zeros((3, 2), dtype=int)  # to add before and behind each axis
    for axis, which in FACES:
        layers[axis, which] = (axis, which) != face and tissue.take(which, axis).any()
    padded, affine = np.pad(tissue, layers), cropped.world_from_voxel.copy()
    affine[:3, 3] -= affine[:3, :3] @ layers[:, 0]
    return padded, Volume(padded, affine, cropped.space, cropped.unit)
