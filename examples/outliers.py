"""Points with outliers.

Each point has a probability of belonging to the surface; the others do not bend the model.
"""

import numpy as np

import quadriform as qf

body = qf.Superquadric(
    semi_axes=np.array([40.0, 30.0, 20.0]), exponents=np.array([1.0, 1.0])
)
clean = qf.examples.noisy(body.mesh(12).vertices, sigma=0.3)
points = qf.examples.with_outliers(clean, ratio=0.15)

fit = qf.fit(points)
print(fit.status, dict(fit.warnings))
print(
    f"{np.sum(fit.inliers < 0.5)} of {len(points)} points are outliers; noise {fit.noise:.2f}"
)
