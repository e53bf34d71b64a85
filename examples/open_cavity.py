"""A cavity that is open at its base.

The plane where the data ends is given; volumes stop there, and the missing cap is not taken for a poor fit.
"""

import numpy as np

import quadriform as qf

body = qf.Superquadric(
    semi_axes=np.array([28.0, 26.0, 45.0]), exponents=np.array([1.0, 1.0])
)
points = qf.examples.noisy(body.mesh(12).vertices, sigma=0.5)
open_cloud = points[points[:, 2] < 25]

base = (
    np.array([0.0, 0.0, 25.0]),
    np.array([0.0, 0.0, 1.0]),
)  # a point, and the direction to the missing side
fit = qf.fit(open_cloud, base=base)
print(fit.status, dict(fit.warnings), f"RMS {fit.rms:.2f}")
