"""How much of the sphere of directions around a superquadric has points."""

import numpy as np
from scipy.spatial import cKDTree

from quadriform.points import Array
from quadriform.shapes import pose
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.superquadric import Superquadric

PER_CELL = 8
"""Points that an even cloud would have in each cell, so that empty ones mean something."""
ENOUGH = 0.85


HalfSpace = tuple[Array, Array]


def covered_share(superquadric: Superquadric, points: Array, beyond: HalfSpace | None = None) -> float:
    """Share in [0, 1] of even cells of the sphere, seen from the centre in units of the semi-axes, that have points.

    Cells whose surface point lies in the half-space `beyond` (point, direction), where no data is expected, do not
    count.
    """
    resolution = int(np.clip(np.sqrt(len(points) / PER_CELL / 6), 2, 8)) // 2 * 2
    cells, _ = sphere_grid(resolution)
    scaled = pose.to_local(points, superquadric.rotation, superquadric.translation) / superquadric.semi_axes
    directions = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-300)
    seen = np.zeros(len(cells), dtype=bool)
    seen[cKDTree(cells).query(directions)[1]] = True
    if beyond is not None:
        at, direction = beyond
        seen = seen[(superquadric.surface(cells) - at) @ direction <= 0]
    return float(seen.mean()) if len(seen) else 0.0


def coverage_warning(superquadric: Superquadric, points: Array, beyond: HalfSpace | None = None) -> str:
    """A sentence when points cover too little of a superellipsoid, else an empty one."""
    if superquadric.kind != "ellipsoid":
        return ""
    share = covered_share(superquadric, points, beyond)
    if share >= ENOUGH:
        return ""
    return f"points cover {100 * share:.0f} % of the directions from the centre; the rest is the model's guess"
