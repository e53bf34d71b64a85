"""A beating heart and its ejection fraction.

All frames are fitted at once, smooth and periodic in time; volumes end at the plane of the base.
"""

import numpy as np

import quadriform as qf
from quadriform.heart.synthetic import SyntheticVentricle

heart, times = SyntheticVentricle(), np.arange(4) / 4
frames = [
    {
        wall: heart.surface_points(wall, time, 80, noise=0.3, seed=k)
        for wall in ("epi", "endo")
    }
    for k, time in enumerate(times)
]

found = qf.track(frames, times=times, period=1.0, box=(4, 4, 4), strength=1e-6)
measures = qf.measure(found.models, times, base=heart.base_plane())
exact = qf.measure(heart.models(times), times, base=heart.base_plane())
print(
    f"ejection fraction {measures['ejection fraction']:.1f} %, true {exact['ejection fraction']:.1f} %",
    dict(found.warnings),
)
