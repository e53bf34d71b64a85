"""The fitters that the common checks are run on: a superquadric, its refinement, two surfaces in one box, and time."""

from fitter_checks import Fitter
from shapes_made import lumpy, single

import quadriform as qf

SMALL = {"box": (3, 3, 3)}
CLOUD = lumpy(150)
WALLS = {"epi": lumpy(80), "endo": 0.7 * lumpy(80, seed=8)}
BEAT = [lumpy(80, seed=t) * [1 - 0.05 * t, 1 - 0.08 * t, 1] for t in range(3)]


def at_rest(superquadric):
    """The model that it is in a box that is not deformed."""
    return single(superquadric, qf.ControlBox.around(superquadric))


FITTERS = {
    "superquadric": Fitter(
        [CLOUD],
        lambda clouds: qf.fit_superquadric(clouds[0]),
        lambda found: [(at_rest(found.superquadric), "surface")],
        lambda found: [found.inliers],
        1e-6,
    ),
    "refinement": Fitter(
        [CLOUD],
        lambda clouds: qf.fit(clouds[0], **SMALL),
        lambda found: [(found.model, "surface")],
        lambda found: [found.residuals],
    ),
    "two surfaces": Fitter(
        list(WALLS.values()),
        lambda clouds: qf.fit(dict(zip(WALLS, clouds, strict=True)), **SMALL),
        lambda found: [(found.model, name) for name in WALLS],
        lambda found: [found.residuals[name] for name in WALLS],
    ),
    "time": Fitter(
        BEAT,
        lambda clouds: qf.track(clouds, **SMALL),
        lambda found: [(model, "surface") for model in found.models],
        lambda found: [residuals["surface"] for residuals in found.residuals],
        1e-6,
    ),
}
