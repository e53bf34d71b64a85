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
"""Points of which the paper's criterion is minimised: its time grows with them, and a start need not be precise."""
LEAST_WALL = 1 / 3
"""Least thickness of the wall between nested superquadrics, as a fraction of the mean thickness of the points' wall."""
LEAST_ENTRY = 0.1
"""Entries of a unit vector below this are skipped, since their sign may be rounding; some entry is always larger."""
GRID = 24
"""Cells along an edge of the grid of an inner surface, whose largest F in the outer one is sought."""
LONGEST = 2.0
"""A fit by the paper's criterion with a semi-axis above this many extents of the data has diverged, and is no start."""


def candidates(
    clouds: Mapping[str, Array], robust_fits: Mapping[str, Superquadric], kind: str
) -> list[dict[str, Superquadric]]:
    """Starts for all surfaces: the robust fits, for kind "ellipsoid" the plain ellipsoids, and maybe the paper's fits.

    The paper's are left out where one of them has diverged or a surface has too few points for its criterion.

    Where the shape is no superquadric, the robust fit may follow one half of it and take the other for outliers; the
    plain fits average over all of it.

    Args:
        clouds: name -> (n, 3) points, centred and scaled.
        robust_fits: name -> robust fit, likewise.
        kind: of all superquadrics; only of "ellipsoid" there are more starts than the robust fit.
    """
    if not KINDS[kind].is_radial:
        return [dict(robust_fits)]
    dense = {name: cloud[dense_points(cloud)] for name, cloud in clouds.items()}
    found = [dict(robust_fits), {name: plain_ellipsoid(cloud, robust_fits[name]) for name, cloud in dense.items()}]
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

    It has diverged where a semi-axis is longer than the largest extent of the data; of a closed body it is half.

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

    Separate fits to open data can touch where there is no data, and no smooth map separates them again. F, the implicit
    function of the outermost surface (P1), is 1 on it and grows in proportion to the distance from its centre: at a
    point, F is the scale of the copy through that point. So the inner points have the scale s, the median of F over
    them divided by that over the outer points, and the mean thickness of the wall is 1 - s. The inner surface comes as
    near as 1 - max F. The wall is too thin where that is below `LEAST_WALL` (1 - s).
    """
    # by the median of squared distances from the centre: a fit may have diverged, and outliers enlarge a mean
    squared_radius = {
        name: float(np.median(((cloud - np.median(cloud, axis=0)) ** 2).sum(axis=1))) for name, cloud in clouds.items()
    }
    outer_name = max(squared_radius, key=squared_radius.__getitem__)
    outer, result = surfaces[outer_name], {}
    for name, surface in surfaces.items():
        inner_level, outer_level = (np.median(outer.implicit(clouds[each])) for each in (name, outer_name))
        scale = float(inner_level / outer_level)
        largest_level = outer.implicit(surface.grid(GRID)[0]).max()
        too_thin = name != outer_name and scale < 1 and 1 - largest_level < LEAST_WALL * (1 - scale)
        result[name] = replace(outer, semi_axes=scale * outer.semi_axes) if too_thin else surface
    return result
