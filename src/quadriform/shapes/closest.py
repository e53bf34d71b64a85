"""Closest points on a deformed superquadric: foot points that slide along the surface until they are nearest.

A foot point is kept as its origin on the undeformed superquadric. A slide is a step in the tangent plane there and the
projection back onto the surface, so there is no chart and no pole. `starts.py` says where to begin, so that the
nearest of several local minima is found.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.points import Array
from quadriform.shapes import _kernel
from quadriform.shapes.closest_starts import Index, Net
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.ridges import beside_ridges, has_ridges
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import threads_for
from quadriform.words import short_repr

SLIDES = 60
SHALLOW = 0.3
"""Below this curvature of the squared distance (1 on a plane) a second minimum may be hidden within a cell."""


@dataclass(frozen=True, repr=False)
class FootPoints:
    """The nearest surface point of each of n points.

    Attributes:
        origins: (n, 3), on the undeformed superquadric.
        points: (n, 3), the same after deformation.
        normals: (n, 3), unit, outward.
        signed: (n,), distance of the data, negative inside.
    """

    __repr__ = short_repr

    origins: Array
    points: Array
    normals: Array
    signed: Array


def closest_on(superquadric: Superquadric, box: ControlBox, targets: Array) -> FootPoints:
    """The globally nearest points to (n, 3) targets.

    Every vertex of a net whose cell could hold the nearest point, and that is nearer than its neighbours, is slid to
    rest; where the minimum found is shallow (near a focal point) a second look is taken on both sides of it. Beside the
    edges of exponents above 1 every part of the surface is searched by itself.
    """
    net = Net.of(superquadric, box)
    owner, vertex = net.starts(targets)
    slid = _slide(superquadric, box, targets[owner], net.origins[vertex])
    owners, places = [owner], [slid.origins]
    best = _nearest(owner, targets[owner], slid.points)
    flat = best[slid.least[best] < SHALLOW]
    if len(flat):
        shifts = slid.weak[flat] * net.cell[vertex[flat]][:, None]
        owners.append(np.tile(owner[flat], 4))
        again = np.tile(slid.origins[flat], (4, 1)) + np.concatenate([k * shifts for k in (-2, -1, 1, 2)])
        places.append(_slide(superquadric, box, targets[owners[-1]], superquadric.project(again)).origins)
    if has_ridges(superquadric):
        others, found = beside_ridges(superquadric, box, targets, np.concatenate(owners), np.concatenate(places))
        owners.append(others)
        places.append(found)
    every, origins = np.concatenate(owners), np.concatenate(places)
    points = box.deform(origins)
    best = _nearest(every, targets[every], points)
    return _finish(superquadric, box, targets, origins[best], points[best])


def update_foot_points(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, steps: int
) -> Array:
    """Slide given origins (n, 3) a few times towards their targets (n, 3); what is left is for the next call.

    As if the surface were flat (Gauss and Newton): what a slide leaves of the way is distance times curvature,
    little for data near the surface. No foot point gets worse.
    """
    result = np.array(origins, dtype=np.float64, order="C")
    given, threads = np.ascontiguousarray(targets), threads_for(len(targets))
    _kernel.settle(box.compiled(), superquadric.compiled(), _diagonal(box), given, result, steps, threads)
    return result


@dataclass(frozen=True)
class _Slid:
    """Where the origins came to rest: least curvature of half the squared distance, and its undeformed direction."""

    origins: Array
    points: Array
    least: Array
    weak: Array


def _slide(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array) -> _Slid:
    """Damped Newton steps on |target - X|^2 over the two tangent coordinates, until every foot point rests.

    In coordinates in which the deformed tangents are orthonormal the Hessian is 1 + distance x shape, the shape
    operator being the difference of normals a little apart. Directions in which the distance is at a maximum are
    followed downhill; a step that would lead away is refused and shortened, so a foot point never gets worse.
    """
    moved, points, weak = np.array(origins, order="C"), np.empty_like(origins), np.empty_like(origins)
    least, threads = np.empty(len(origins)), threads_for(len(origins))
    given, diagonal = np.ascontiguousarray(targets), _diagonal(box)
    surface = superquadric.compiled()
    _kernel.slide(box.compiled(), surface, diagonal, given, moved, points, least, weak, SLIDES, threads)
    return _Slid(moved, points, least, weak)


def _diagonal(box: ControlBox) -> float:
    return float(np.linalg.norm(box.edges))


def _nearest(owner: Index, targets: Array, points: Array) -> Index:
    """Index of the nearest point for each owner, in the owners' order; the first of equals."""
    order = np.lexsort((np.linalg.norm(targets - points, axis=1), owner))
    return np.asarray(order[np.unique(owner[order], return_index=True)[1]], dtype=np.int64)


def _finish(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, points: Array) -> FootPoints:
    normals = surface_normals(superquadric, box, origins)
    gap = targets - points
    side = np.where(np.einsum("ij,ij->i", gap, normals) < 0, -1.0, 1.0)
    return FootPoints(origins, points, normals, side * np.linalg.norm(gap, axis=1))


def surface_normals(superquadric: Superquadric, box: ControlBox, origins: Array) -> Array:
    """Unit outward normals (n, 3) of the deformed surface at the images of its origins."""
    return surface_points(superquadric, box, origins)[1]


def surface_points(superquadric: Superquadric, box: ControlBox, origins: Array) -> tuple[Array, Array]:
    """Where the box carries surface points (n, 3), and the unit outward normals (n, 3) of the deformed surface."""
    given = np.ascontiguousarray(origins, dtype=np.float64)
    points, normals = np.empty_like(given), np.empty_like(given)
    _kernel.normals(box.compiled(), superquadric.compiled(), given, points, normals, threads_for(len(given)))
    return points, normals
