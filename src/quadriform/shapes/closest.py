"""Closest points on a deformed superquadric: foot points that slide along the surface until they are nearest.

A foot point is kept as its origin on the undeformed superquadric. A slide is a step in the tangent plane there and the
projection back onto the surface, so there is no chart and no pole.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

START_RESOLUTION = 24
SLIDES = 40
SETTLED = 1e-12
"""A foot point rests when its step is below this share of the box's diagonal."""


@dataclass(frozen=True)
class FootPoints:
    """The nearest surface point of each of n points.

    Attributes:
        origins: (n, 3), on the undeformed superquadric.
        points: (n, 3), the same after deformation.
        normals: (n, 3), unit, outward.
        signed: (n,), distance of the data, negative inside.
    """

    origins: Array
    points: Array
    normals: Array
    signed: Array


def closest_on(superquadric: Superquadric, box: ControlBox, targets: Array) -> FootPoints:
    """Foot points of (n, 3) targets: started at the nearest vertex of a mesh, then slid until they rest."""
    vertices, _ = superquadric.grid(START_RESOLUTION)
    nearest = cKDTree(box.deform(vertices)).query(targets)[1]
    return settle(superquadric, box, targets, vertices[nearest])


def settle(
    superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, slides: int = SLIDES
) -> FootPoints:
    """Slide given origins (n, 3) towards their targets, at most `slides` times.

    Each slide is a damped Gauss-Newton step on |target - X|^2 over the two tangent coordinates; a step that would lead
    away is refused and shortened, so a foot point never gets worse. Damping grows where a step brings less than it
    promised: for far targets the surface bends away, and plain steps would swing to and fro.
    """
    origins = origins.copy()
    points = box.deform(origins)
    damping = np.full(len(origins), 1e-3)
    active = np.arange(len(origins))
    reach = float(np.linalg.norm(box.edges))
    for _ in range(slides):
        gap = targets[active] - points[active]
        step, promised = _tangent_step(superquadric, box, origins[active], gap, damping[active])
        step *= np.minimum(1, 0.2 * reach / np.maximum(np.linalg.norm(step, axis=1), 1e-300))[:, None]
        trial = superquadric.project(origins[active] + step)
        moved = box.deform(trial)
        gained = _squared(gap) - _squared(targets[active] - moved)
        closer = gained > 0
        good = active[closer]
        origins[good], points[good] = trial[closer], moved[closer]
        damping[active] *= np.where(gained > 0.75 * promised, 0.1, np.where(gained > 0.4 * promised, 1, 5))
        resting = np.linalg.norm(step, axis=1) < SETTLED * reach
        active = active[~resting & (damping[active] < 1e6)]
        if not len(active):
            break
    return _finish(superquadric, box, targets, origins, points)


def _finish(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, points: Array) -> FootPoints:
    normals = surface_normals(superquadric, box, origins)
    gap = targets - points
    side = np.where(np.einsum("ij,ij->i", gap, normals) < 0, -1.0, 1.0)
    return FootPoints(origins, points, normals, side * np.sqrt(_squared(gap)))


def _squared(vectors: Array) -> Array:
    return np.einsum("ij,ij->i", vectors, vectors)


def tangent_frames(superquadric: Superquadric, origins: Array) -> Array:
    """Two unit tangents of the undeformed surface, (n, 3, 2); with the outward normal they are right-handed."""
    normal = superquadric.gradient(origins)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    helper = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(helper, normal)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    return np.stack([first, np.cross(normal, first)], axis=2)


def surface_normals(superquadric: Superquadric, box: ControlBox, origins: Array) -> Array:
    """Unit outward normals (n, 3) of the deformed surface at the images of its origins."""
    tangents = box.jacobian(origins) @ tangent_frames(superquadric, origins)
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def _tangent_step(
    superquadric: Superquadric, box: ControlBox, origins: Array, gap: Array, damping: Array
) -> tuple[Array, Array]:
    """Levenberg-damped Gauss-Newton step (n, 3) of the origins in their tangent planes, and the gain it promises."""
    frame = tangent_frames(superquadric, origins)
    tangents = box.jacobian(origins) @ frame
    gram = np.einsum("nia,nib->nab", tangents, tangents)
    held = gram + ((damping + 1e-12) * np.trace(gram, axis1=1, axis2=2))[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
    pull = np.einsum("nia,ni->na", tangents, gap)
    step = np.linalg.solve(held, pull[:, :, None])[:, :, 0]
    promised = 2 * np.einsum("na,na->n", step, pull) - np.einsum("na,nab,nb->n", step, gram, step)
    return np.einsum("nia,na->ni", frame, step), promised
