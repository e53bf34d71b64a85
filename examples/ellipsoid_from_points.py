"""An ellipsoid from points.

One superquadric alone: 11 parameters, and a warning where the data does not determine them.
"""

import numpy as np

import quadriform as qf

body = qf.Superquadric(
    semi_axes=np.array([40.0, 30.0, 20.0]), exponents=np.array([1.0, 1.0])
)
points = qf.examples.noisy(body.mesh(12).vertices, sigma=0.5)

found = qf.fit_superquadric(points)
print(found.status, dict(found.warnings))
print(
    "semi-axes",
    np.sort(found.superquadric.semi_axes).round(1),
    "centre",
    found.superquadric.translation.round(2),
)
