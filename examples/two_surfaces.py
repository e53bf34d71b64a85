"""Two surfaces in one control box.

Both walls of a ventricle share one deformation, which therefore also moves the muscle between them.
"""

import quadriform as qf
from quadriform.heart.synthetic import SyntheticVentricle

heart = SyntheticVentricle()
clouds = {
    wall: heart.surface_points(wall, 0.0, 400, noise=0.5) for wall in ("epi", "endo")
}

fit = qf.fit(clouds, unit="mm")
muscle = fit.model.volume("epi") - fit.model.volume("endo")
print(fit.status, f"{fit.model.n_parameters} parameters, muscle {muscle / 1000:.0f} ml")
