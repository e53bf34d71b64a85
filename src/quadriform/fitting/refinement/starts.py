"""Which superquadric the refinement starts from: the evidence decides after a short refinement of each."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from quadriform.fitting.cloud import dense_points, evenly_chosen
from quadriform.fitting.superquadric.fit import fit_robust, plain_ellipsoid
from quadriform.fitting.superquadric.initial import ellipsoid_by_moments
from quadriform.fitting.superquadric.paper import least_squares_p3
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric

PAPER_POINTS = 1000
LEAST_WALL = 1 / 3
"""Least thickness of the wall between nested superquadrics, as a fraction of the mean thickness of the points' wall."""
LEAST_ENTRY = 0.1
"""Entries of a unit vector below this are skipped, since their sign may be rounding; some entry is always larger."""
GRID = 24
LONGEST = 2.0
"""A fit with a semi-axis above this many extents of the data has diverged, and is no start."""


def candidates(
    clouds: Mapping[str, Array], robust: Mapping[str, Superquadric], kind: str
) -> list[dict[str, Superquadric]]:
    """Starts for all surfaces: the robust fit, the plain ellipsoid, and the paper's fit where it has not diverged.

    Where the shape is no superquadric, the robust fit may follow one half of it and take the other for outliers; the
    plain fits average over all of it.

    Args:
        clouds: name -> (n, 3) points, centred and scaled.
        robust: name -> robust fit, likewise.
        kind: of superquadric; only for ellipsoids there is more than the robust fit.
    """
    if not KINDS[kind].is_radial:
        return [dict(robust)]
    dense = {name: cloud[dense_points(cloud)] for name, cloud in clouds.items()}
    found = [dict(robust), {name: plain_ellipsoid(cloud, robust[name]) for name, cloud in dense.items()}]
    # an outlier among few points leaves less than the paper's criterion needs
    if min(map(len, dense.values())) < KINDS[kind].n_parameters:
        return [nested(surfaces, clouds) for surfaces in found]
    plain = {name: least_squares_p3(cloud[evenly_chosen(cloud, PAPER_POINTS)], kind) for name, cloud in dense.items()}
    if all(surface.semi_axes.max() <= LONGEST * np.ptp(dense[name], axis=0).max() for name, surface in plain.items()):
        found.append({name: with_positive_axes(surface) for name, surface in plain.items()})
    return [nested(surfaces, clouds) for surfaces in found]


def with_positive_axes(surface: Superquadric) -> Superquadric:
    """The same surface, its first two axes towards positive coordinates.

    Rotations by 180 degrees about its own axes leave a superellipsoid as it is. Rounding can decide which of them a
    descent ends at, and with it the order of the points of its grid.
    """
    rotation = surface.rotation.copy()
    for axis in (0, 1):
        column = rotation[:, axis]
        if column[np.abs(column) > LEAST_ENTRY][0] < 0:
            rotation[:, [axis, 2]] *= -1
    return replace(surface, rotation=rotation)


def nested_ellipsoids(clouds: Mapping[str, Array]) -> dict[str, Superquadric]:
    """Ellipsoids as the start of all surfaces; by moments (paper A.3) where a fit to open data diverges.

    Args:
        clouds: name -> (n, 3) points, centred and scaled.
    """
    dense = {name: cloud[dense_points(cloud)] for name, cloud in clouds.items()}
    found = dict[str, Superquadric]()
    for name, cloud in dense.items():
        found[name] = fit_robust(cloud, "ellipsoid", np.ones(len(cloud)), {"exponents": (1.0, 1.0)}, None).superquadric
        if found[name].semi_axes.max() > np.ptp(cloud, axis=0).max():
            found[name] = ellipsoid_by_moments(cloud)
    return nested(found, clouds)


def nested(surfaces: dict[str, Superquadric], clouds: Mapping[str, Array]) -> dict[str, Superquadric]:
    """The surfaces; an inner one that leaves too thin a wall to the outermost is replaced by a smaller copy of that.

    Separate fits to open data can touch where there is no data, and no smooth map separates them again. F is of degree
    one: its median over the inner points, in units of that over the outer ones, is the scale of the copy.
    """
    # not by the fits, of which an inner one may have diverged, nor by means, which outliers enlarge
    far = {n: float(np.median(((cloud - np.median(cloud, axis=0)) ** 2).sum(axis=1))) for n, cloud in clouds.items()}
    outer = max(far, key=far.__getitem__)
    result = {}
    for name, surface in surfaces.items():
        # F of the outer surface at the inner points is their size in units of it; the median leaves outliers aside
        level, unit = (np.median(surfaces[outer].implicit(clouds[of])) for of in (name, outer))
        size = float(level / unit)
        nearest = surfaces[outer].implicit(surface.grid(GRID)[0]).max()
        too_thin = name != outer and size < 1 and 1 - nearest < LEAST_WALL * (1 - size)
        result[name] = replace(surfaces[outer], semi_axes=size * surfaces[outer].semi_axes) if too_thin else surface
    return result
