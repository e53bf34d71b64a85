"""The open end of a labelled ventricle: the flat end of a stack of slices, or a face of the image."""

import numpy as np

from quadriform.imaging.image_points import slice_axis
from quadriform.imaging.volume import Region, Volume
from quadriform.imaging.voxel_faces import CAVITY, WALL, Tissue, face_area_vectors
from quadriform.points import Array, unit_vectors

End = tuple[int, int]
"""An axis of the image, and which of its ends: 0 the first, -1 the last."""


def flat_end(tissue: Tissue, world_from_voxel: Array) -> End | None:
    """Return the end of the slice axis at which the labels of a cavity end flat and open; None where both are rounded.

    Of both ends the one of the larger open section is the base: the cavity is narrower at its apex. It is flat where
    that section is nearer to the largest one, by ratio, than the outermost of as many slices through an ellipsoid.

    Args:
        tissue: of each voxel.
        world_from_voxel: (4, 4); slices lie across the axis of the largest spacing.
    """
    axis = slice_axis(world_from_voxel)
    across = np.moveaxis(tissue, axis, 0)
    areas = (across == CAVITY).sum(axis=(1, 2))
    first, last = np.flatnonzero(areas)[[0, -1]]
    opened = {0: _open_voxels(across, first, first - 1), -1: _open_voxels(across, last, last + 1)}
    end = max(opened, key=lambda each: opened[each])
    return (axis, end) if opened[end] > _flat(int(last - first + 1)) * areas.max() else None


def _open_voxels(across: Tissue, at: int, after: int) -> int:
    """The number of voxels of the cavity in a slice that no wall covers in the slice after it."""
    cavity = across[at] == CAVITY
    inside = 0 <= after < len(across)
    return int((cavity & (across[after] != WALL)).sum() if inside else cavity.sum())


def _flat(slices: int) -> float:
    """The geometric mean of 1, of a flat end, and the outermost section of an ellipsoid over its largest one."""
    # the middle of the outermost of n slices is at 1 - 1/n of the semi-axis
    return float(np.sqrt(1 - (1 - 1 / slices) ** 2))


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
    faces = [(axis, which) for axis in range(3) for which in (0, -1)]
    if base is not None:
        outward = [unit_vectors(areas[axis]) * (-1 if which == 0 else 1) for axis, which in faces]
        return faces[int(np.argmax(outward @ np.asarray(base[1], dtype=np.float64)))]
    cuts = [float((tissue == CAVITY).take(which, axis).sum() * np.linalg.norm(areas[axis])) for axis, which in faces]
    return faces[int(np.argmax(cuts))] if max(cuts) > 0 else None


def closed_but_for(face: End | None, tissue: Tissue, cropped: Volume) -> tuple[Tissue, Volume]:
    """Return tissue and image with a layer of background at the other faces that cut it: a surface closes there.

    Args:
        face: the open one.
        tissue: of each voxel.
        cropped: the image, or the region.
    """
    faces = [[(axis, which) for which in (0, -1)] for axis in range(3)]
    layers = [[int(each != face and bool(tissue.take(each[1], each[0]).any())) for each in pair] for pair in faces]
    padded, affine = np.pad(tissue, layers), cropped.world_from_voxel.copy()
    affine[:3, 3] -= affine[:3, :3] @ [first for first, _ in layers]
    return padded, Volume(padded, affine, cropped.space, cropped.unit)
