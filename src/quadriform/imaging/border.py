"""Where an object is cut by the border of its image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array


def face_area_vectors(world_from_voxel: Array) -> Array:
    """Return the area vectors of the three faces of a voxel, rows (3, 3), each towards the next voxel of its axis."""
    a, b, c = world_from_voxel[:3, :3].T
    areas = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    # cross products point against the axes of a left-handed grid
    return areas * np.sign(np.linalg.det(world_from_voxel[:3, :3]))


def border_cut(inside: NDArray[Any], world_from_voxel: Array) -> str:
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
