"""A mask to a model.

The isosurface of a mask between its voxels, in millimetres of the world, and a smooth closed model of it.
"""

import numpy as np

import quadriform as qf

i, j, k = np.indices((40, 32, 16))
mask = ((i - 20) / 14) ** 2 + ((j - 16) / 10) ** 2 + ((k - 8) / 5) ** 2 + 0.02 * (
    i - 20
) <= 1
world_from_voxel = np.diag([1.5, 1.5, 3.0, 1.0])
volume = qf.Volume(mask.astype(np.uint8), world_from_voxel)

cloud = qf.points_from_image(volume, select=qf.Labels((1,)))
fit = qf.fit(cloud.points, noise=cloud.noise, unit="mm", space="LPS")
voxels = mask.sum() * 1.5 * 1.5 * 3.0
print(
    fit.status,
    dict(fit.warnings),
    f"volume {fit.model.volume() / 1000:.1f} ml, of the voxels {voxels / 1000:.1f} ml",
)
