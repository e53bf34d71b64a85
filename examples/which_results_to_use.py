"""Which results to use.

The status of a fit: "ok"; "warned", usable where the warnings allow; "unreliable", not to be used.
"""

import numpy as np

import quadriform as qf

body = qf.Superquadric(
    semi_axes=np.array([40.0, 30.0, 20.0]), exponents=np.array([1.0, 1.0])
)
whole = qf.examples.noisy(body.mesh(12).vertices, sigma=0.3)
towards_camera = whole / body.semi_axes**2 @ np.array([0.5, 0.3, 0.8]) > 0
clouds = {
    "whole body": whole,
    "one side of it": whole[towards_camera],
    "two bodies": np.concatenate([whole, whole + np.array([120, 0, 0])]),
}

fits = {name: qf.fit(cloud, box=(3, 3, 3)) for name, cloud in clouds.items()}
for name, fit in fits.items():
    print(f"{name}: {fit.status}, data supports {fit.supported:.0%} of the area")
    for kind, text in fit.warnings.items():
        print(f"    {kind}: {text}")
