"""Where an object is cut by the edge of its image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array


def face_area_vectors(world_from_voxel: Array) -> Array:
    """Area vectors of a voxel's three sides, rows (3, 3), each towards the next voxel along its axis."""
    a, b, c = world_from_voxel[:3, :3].T
    areas = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    return areas * np.sign(np.linalg.det(world_from_voxel[:3, :3]))


def border_cut(inside: NDArray[Any], world_from_voxel: Array) -> str:
    """Name the faces of the image that an object touches; empty when there are none.

    Args:
        inside: (i, j, k) bool, the object.
        world_from_voxel: (4, 4), for the areas of the voxels' sides.
    """
    side_areas = np.linalg.norm(face_area_vectors(world_from_voxel), axis=1)
    faces, cut, total = [], 0.0, 0.0
    for axis, area in enumerate(side_areas):
        ends = {f"{end} {'ijk'[axis]}": int(inside.take(at, axis).sum()) for end, at in (("first", 0), ("last", -1))}
        faces += [f"{name} ({count} voxels)" for name, count in ends.items() if count]
        cut += area * sum(ends.values())
        total += area * (sum(ends.values()) + int(np.count_nonzero(np.diff(inside, axis=axis))))
    return f"the image cuts the object at {', '.join(faces)}: {cut / total:.1%} of its surface" if faces else ""
