"""Which superquadric the refinement starts from: the evidence decides after a short refinement of each."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from quadriform.fitting.neighbourhood import crowded
from quadriform.fitting.robust_superquadric import fit_robust
from quadriform.fitting.sampling import outwards
from quadriform.fitting.superquadric_fit import least_criterion
from quadriform.points import Array
from quadriform.shapes.superquadric import Superquadric

PAPER_POINTS = 1000
INSIDE = 0.9
"""A surface lies inside another when this share of its points does."""
LONGEST = 2.0
"""A semi-axis above this many extents of the data is a runaway, and no start."""


def candidates(
    clouds: Mapping[str, Array], robust: Mapping[str, Superquadric], kind: str
) -> list[dict[str, Superquadric]]:
    """Starts for all surfaces: the robust fit, the plain ellipsoid, and the paper's fit where it holds.

    A shape that is no superquadric has no best one: the robust fit may follow half of it as if the rest were strangers,
    the plain fits average over all of it.

    Args:
        clouds: name -> (n, 3) points, centred and scaled.
        robust: name -> robust fit, likewise.
        kind: of superquadric; only for ellipsoids there is more than the robust fit.
    """
    if kind != "ellipsoid":
        return [dict(robust)]
    dense = {name: cloud[crowded(cloud)] for name, cloud in clouds.items()}
    found = [dict(robust), {name: _ellipsoid(cloud) for name, cloud in dense.items()}]
    plain = {name: least_criterion(_some(cloud), kind) for name, cloud in dense.items()}
    if all(surface.semi_axes.max() <= LONGEST * np.ptp(dense[name], axis=0).max() for name, surface in plain.items()):
        found.append(plain)
    return [nested(surfaces, clouds) for surfaces in found]


def nested(surfaces: dict[str, Superquadric], clouds: Mapping[str, Array]) -> dict[str, Superquadric]:
    """Each surface that lies inside the largest one as a smaller copy of it, so that the two cannot cross.

    Own fits to open data run together where nobody measured, and no smooth map could part them again. F is of degree
    one: its mean over the inner points is the size of the copy.
    """
    outer = max(surfaces, key=lambda name: surfaces[name].volume())
    result = {}
    for name, surface in surfaces.items():
        levels = surfaces[outer].implicit(clouds[name])
        inside = name != outer and np.quantile(levels, INSIDE) < 1
        result[name] = _smaller(surfaces[outer], float(levels.mean())) if inside else surface
    return result


def _smaller(surface: Superquadric, share: float) -> Superquadric:
    return replace(surface, semi_axes=share * surface.semi_axes)


def _ellipsoid(points: Array) -> Superquadric:
    return fit_robust(points, "ellipsoid", np.ones(len(points)), {"exponents": (1.0, 1.0)}).superquadric


def _some(points: Array) -> Array:
    """About a thousand points, spread over their distances to the centre."""
    order = outwards(points - points.mean(axis=0))
    return points[order[np.linspace(0, len(order) - 1, min(PAPER_POINTS, len(order))).astype(int)]]
