"""Closest points on a deformed superquadric, by damped Newton steps of foot points along the surface.

A foot point is kept as its origin on the undeformed superquadric. A step lies in the tangent plane there, and is
followed by the projection back onto the surface, so there is no chart and no pole. `closest_starts.py` gives the starts
that lead to the nearest of several local minima.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.points import Array
from quadriform.shapes import _kernel
from quadriform.shapes.closest_starts import CandidateIndex, Index
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.ridges import beside_ridges, has_ridges
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import threads_for
from quadriform.words import short_repr

MAX_STEPS = 60
SHALLOW = 0.3
"""Below this curvature of the squared distance (1 on a plane) a second minimum may be hidden within a cell."""
EQUAL, SAME_POINT = 1e-10, 1e-6
"""Distances are equal, and points are the same, but for rounding: below these shares of the box's diagonal."""
ASYMMETRIC = np.array([1.0, 0.618, 0.271])
"""A direction that no symmetry of a superquadric leaves unchanged."""


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

    The search starts at every vertex of a grid whose cell could contain the nearest point and that is nearer than its
    neighbours. Where the minimum found is shallow (near a focal point), it starts again on both sides of it. Beside the
    edges of exponents above 1 every part of the surface is searched separately.
    """
    candidates = CandidateIndex.of(superquadric, box)
    owner, vertex = candidates.starts(targets)
    found = _converge(superquadric, box, targets[owner], candidates.origins[vertex])
    owners, origins = [owner], [found.origins]
    best = _nearest(superquadric, box, owner, targets[owner], found.points)
    # Near a focal point the distance is flat, and a second minimum may lie within the same cell.
    flat = best[found.least[best] < SHALLOW]
    if len(flat):
        shifts = found.weak[flat] * candidates.cell[vertex[flat]][:, None]
        owners.append(np.tile(owner[flat], 4))
        again = np.tile(found.origins[flat], (4, 1)) + np.concatenate([k * shifts for k in (-2, -1, 1, 2)])
        origins.append(_converge(superquadric, box, targets[owners[-1]], superquadric.project(again)).origins)
    if has_ridges(superquadric):
        # Newton steps in the tangent plane fail where the curvature is infinite.
        others, beside = beside_ridges(superquadric, box, targets, np.concatenate(owners), np.concatenate(origins))
        owners.append(others)
        origins.append(beside)
    every_owner, every_origin = np.concatenate(owners), np.concatenate(origins)
    points = box.deform(every_origin)
    best = _nearest(superquadric, box, every_owner, targets[every_owner], points)
    return _foot_points(superquadric, box, targets, every_origin[best], points[best])


def update_foot_points(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, steps: int
) -> Array:
    """Origins (n, 3) after a few tangential Gauss-Newton steps towards their targets (n, 3); no foot point gets worse.

    A step takes the surface for flat. It leaves a fraction of the way of distance times curvature, which is small for
    data near the surface; the next call goes on from there.
    """
    result = np.array(origins, dtype=np.float64, order="C")
    given, threads = np.ascontiguousarray(targets), threads_for(len(targets))
    _kernel.update_foot_points(box.compiled(), superquadric.compiled(), _diagonal(box), given, result, steps, threads)
    return result


@dataclass(frozen=True)
class _Converged:
    """Foot points at local minima: least curvature of half the squared distance, and its undeformed direction."""

    origins: Array
    points: Array
    least: Array
    weak: Array


def _converge(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array) -> _Converged:
    """The local minima of |target - X|^2 that damped Newton steps over the two tangent coordinates lead to.

    In coordinates in which the deformed tangents are orthonormal the Hessian is 1 + distance x shape, the shape
    operator being the difference of two nearby normals. Directions in which the distance is at a maximum are
    followed downhill; a step that would lead away is rejected and shortened, so a foot point never gets worse.
    """
    moved, points, weak = np.array(origins, order="C"), np.empty_like(origins), np.empty_like(origins)
    least, threads = np.empty(len(origins)), threads_for(len(origins))
    given, diagonal = np.ascontiguousarray(targets), _diagonal(box)
    surface = superquadric.compiled()
    _kernel.converge_foot_points(
        box.compiled(), surface, diagonal, given, moved, points, least, weak, MAX_STEPS, threads
    )
    return _Converged(moved, points, least, weak)


def _diagonal(box: ControlBox) -> float:
    return float(np.linalg.norm(box.edges))


def _nearest(superquadric: Superquadric, box: ControlBox, owner: Index, targets: Array, points: Array) -> Index:
    """Index of the nearest point for each owner, in the owners' order.

    A target on a plane of symmetry, such as a voxel on the edge of a cube, has two or more nearest points. Rounding
    does not choose among these: the one farthest along a direction of the superquadric's frame is taken.
    """
    distance, along = np.linalg.norm(targets - points, axis=1), points @ (superquadric.rotation @ ASYMMETRIC)
    tied = distance <= _extreme(np.minimum, owner, distance) + EQUAL * _diagonal(box)
    along = np.where(tied, along, -np.inf)
    same = along >= _extreme(np.maximum, owner, along) - SAME_POINT * _diagonal(box)
    order = np.lexsort((np.where(same, distance, np.inf), owner))
    return np.asarray(order[np.unique(owner[order], return_index=True)[1]], dtype=np.int64)


def _extreme(least_or_most: np.ufunc, owner: Index, values: Array) -> Array:
    """The least or the largest of the values (n,) of each one's owner, (n,)."""
    found = np.empty(owner.max(initial=-1) + 1)
    found[owner] = values
    least_or_most.at(found, owner, values)
    return np.asarray(found[owner])


def _foot_points(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, points: Array
) -> FootPoints:
    normals = surface_normals(superquadric, box, origins)
    offset = targets - points
    # A point on the surface has no side; it counts as outside, with distance zero.
    side = np.where(np.einsum("ij,ij->i", offset, normals) < 0, -1.0, 1.0)
    return FootPoints(origins, points, normals, side * np.linalg.norm(offset, axis=1))


def surface_normals(superquadric: Superquadric, box: ControlBox, origins: Array) -> Array:
    """Unit outward normals (n, 3) of the deformed surface at the images of its origins."""
    return surface_points(superquadric, box, origins)[1]


def surface_points(superquadric: Superquadric, box: ControlBox, origins: Array) -> tuple[Array, Array]:
    """Surface points (n, 3) after deformation, and the unit outward normals (n, 3) there."""
    given = np.ascontiguousarray(origins, dtype=np.float64)
    points, normals = np.empty_like(given), np.empty_like(given)
    _kernel.normals(box.compiled(), superquadric.compiled(), given, points, normals, threads_for(len(given)))
    return points, normals
