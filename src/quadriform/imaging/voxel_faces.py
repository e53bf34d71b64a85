"""Faces of voxels: their areas, those where the image cuts an object, and those between the tissues of a ventricle."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array

Tissue = NDArray[np.int8]
"""(i, j, k), each voxel one of the following."""
BACKGROUND, WALL, CAVITY = 0, 1, 2
ENCLOSED = 0.5
"""Least fraction of the surface of a ventricle's cavity that is wall; a hollow with less is a dent."""


def face_area_vectors(world_from_voxel: Array) -> Array:
    """Return the area vectors of the three faces of a voxel, rows (3, 3), each towards the next voxel of its axis."""
    a, b, c = world_from_voxel[:3, :3].T
    areas = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    # cross products point against the axes of a left-handed grid
    return areas * np.sign(np.linalg.det(world_from_voxel[:3, :3]))


def border_cut_text(inside: NDArray[Any], world_from_voxel: Array) -> str:
    """Return a sentence with the faces of the image that an object touches; empty when it touches none.

    Args:
        inside: (i, j, k) bool, the object.
        world_from_voxel: (4, 4), for the areas of the voxels' faces.
    """
    faces, cut, total = [], 0.0, 0.0
    for axis, area in enumerate(np.linalg.norm(face_area_vectors(world_from_voxel), axis=1)):
        ends = {f"{end} {'ijk'[axis]}": int(inside.take(at, axis).sum()) for end, at in (("first", 0), ("last", -1))}
        faces += [f"{name} ({count} voxels)" for name, count in ends.items() if count]
        cut += area * sum(ends.values())
        total += area * (sum(ends.values()) + int(np.count_nonzero(np.diff(inside, axis=axis))))
    return f"the image cuts the object at {', '.join(faces)}: {cut / total:.1%} of its surface" if faces else ""


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
