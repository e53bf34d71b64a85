"""Where an object is cut by the edge of its image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array


def border_cut(inside: NDArray[Any], world_from_voxel: Array) -> str:
    """Name the faces of the image that an object touches; empty when there are none.

    Args:
        inside: (i, j, k) bool, the object.
        world_from_voxel: (4, 4), for the areas of the voxels' sides.
    """
    a, b, c = world_from_voxel[:3, :3].T
    side_areas = [float(np.linalg.norm(np.cross(*pair))) for pair in ((b, c), (c, a), (a, b))]
    faces, cut, total = [], 0.0, 0.0
    for axis, area in enumerate(side_areas):
        ends = {f"{end} {'ijk'[axis]}": int(inside.take(at, axis).sum()) for end, at in (("first", 0), ("last", -1))}
        faces += [f"{name} ({count} voxels)" for name, count in ends.items() if count]
        cut += area * sum(ends.values())
        total += area * (sum(ends.values()) + int(np.count_nonzero(np.diff(inside, axis=axis))))
    return f"the image cuts the object at {', '.join(faces)}: {cut / total:.1%} of its surface" if faces else ""
