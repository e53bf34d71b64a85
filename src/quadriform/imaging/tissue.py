"""Voxels of a ventricle by tissue: background, wall, cavity; and the surfaces between them."""

import numpy as np
from numpy.typing import NDArray

from quadriform.imaging.border import face_area_vectors
from quadriform.points import Array

Tissue = NDArray[np.int8]
"""(i, j, k), each voxel one of the following."""
BACKGROUND, WALL, CAVITY = 0, 1, 2


def faces_between(tissue: Tissue, one: int, other: int, world_from_voxel: Array) -> tuple[Array, Array]:
    """Return the voxel faces between two tissues: centres (n, 3) and area vectors (n, 3) from `one` to `other`.

    Args:
        tissue: (i, j, k).
        one: a tissue.
        other: another.
        world_from_voxel: (4, 4).
    """
    centres, areas = [], []
    for axis, area in enumerate(face_area_vectors(world_from_voxel)):
        low, high = np.delete(tissue, -1, axis), np.delete(tissue, 0, axis)  # neighbours along the axis
        for first, second, sign in ((one, other, 1.0), (other, one, -1.0)):
            # a face lies half a voxel from the centre of its lower voxel
            voxels = np.argwhere((low == first) & (high == second)) + 0.5 * (np.arange(3) == axis)
            centres.append(voxels @ world_from_voxel[:3, :3].T + world_from_voxel[:3, 3])
            areas.append(np.broadcast_to(sign * area, (len(voxels), 3)))
    return np.concatenate(centres), np.concatenate(areas)


def contact_area(tissue: Tissue, one: int, other: int, world_from_voxel: Array) -> float:
    """Return the area of the voxel faces between two tissues, in squared units of the world."""
    return float(np.linalg.norm(faces_between(tissue, one, other, world_from_voxel)[1], axis=1).sum())


def enclosed_fraction(tissue: Tissue, world_from_voxel: Array) -> float:
    """Return the fraction of the surface of the cavity that touches the wall; 0 without a surface."""
    at_wall, open_ = (contact_area(tissue, CAVITY, other, world_from_voxel) for other in (WALL, BACKGROUND))
    return at_wall / max(at_wall + open_, np.finfo(float).tiny)
