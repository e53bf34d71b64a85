"""Modes of shape of a cohort.

Models of several subjects in correspondence: their mean, and the directions in which they differ most.
"""

import numpy as np

import quadriform as qf
from quadriform.cohort.statistics import shape_modes

rng = np.random.default_rng(0)
models = []
for _ in range(4):
    axes = np.array([40.0, 30.0, 20.0]) * rng.normal(1, [0.15, 0.05, 0.0])
    body = qf.Superquadric(semi_axes=axes, exponents=np.array([0.8, 1.0]))
    models.append(
        qf.fit(qf.examples.noisy(body.mesh(8).vertices, sigma=0.2), box=(3, 3, 3)).model
    )

found = shape_modes(models, modes=2, box=(3, 3, 3))
print("fraction of the variance:", found.variance_ratios.round(3))
