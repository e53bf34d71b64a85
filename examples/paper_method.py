"""The method of the paper.

Bardinet, Cohen and Ayache 1998 as printed, beside the default, on the points of its Fig. 6.
"""

import quadriform as qf

points = qf.examples.crossing_superquadrics(resolution=10)
for method in ("paper", "tangent"):
    fit = qf.fit(points, method=method)
    print(
        f"{method}: superquadric {fit.superquadric_rms:.2f} mm, model {fit.rms:.2f} mm"
    )
