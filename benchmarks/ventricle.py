"""A synthetic left ventricle for the benchmarks: half an ellipsoid with a flat base and two bumps, 100 mm long."""

import numpy as np

from quadriform.shapes.directions import sphere_grid


def ventricle(resolution: int = 32) -> np.ndarray:
    """Points (6 n^2 + 2, 3) in mm on its surface, without noise."""
    u, _ = sphere_grid(resolution)
    height = np.where(u[:, 2] < 0, 70 * u[:, 2], 30 * u[:, 2])
    p = np.column_stack([33 * u[:, 0], 30 * u[:, 1], np.minimum(height, 18 + 0.2 * height)])
    for centre, push, width in (((24, 8, -10), (5, 1.5, 0), 12.0), ((-18, -18, -35), (3, 3, 0), 11.0)):
        p = p + np.exp(-((p - centre) ** 2).sum(1) / (2 * width**2))[:, None] * np.array(push)
    return p
