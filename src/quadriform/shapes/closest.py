"""Closest points on a deformed superquadric: foot points that slide along the surface until they are nearest.

A foot point is kept as its origin on the undeformed superquadric. A slide is a step in the tangent plane there and the
projection back onto the surface, so there is no chart and no pole. `starts.py` says where to begin, so that the
nearest of several local minima is found.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.starts import Index, Net
from quadriform.shapes.superquadric import Superquadric

SLIDES = 60
SETTLED = 1e-8
"""A foot point rests after a Newton step below this share of the box's diagonal: what is left is its square."""
SURE = 1e-6
"""Steps below this share are taken unasked: the distance that they gain is lost in rounding."""
DIFFERENCE = 1e-6
"""Share of the diagonal over which normals are differenced for the curvature."""
LONGEST = 0.2
"""Longest step, as a share of the diagonal."""
KICK = 0.01
"""Least step, as a share of the diagonal, down from a ridge, where the slope may vanish."""
SHALLOW = 0.3
"""Below this curvature of the squared distance (1 on a plane) a second minimum may be hidden within a cell."""


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
    """The globally nearest points to (n, 3) targets.

    Every vertex of a net whose cell could hold the nearest point, and that is nearer than its neighbours, is slid to
    rest; where the minimum found is shallow (near a focal point) a second look is taken on both sides of it.
    """
    net = Net.of(superquadric, box)
    owner, vertex = net.starts(targets)
    slid = _slide(superquadric, box, targets[owner], net.origins[vertex])
    best = _nearest(owner, targets[owner], slid.points)
    origins, points = slid.origins[best], slid.points[best]
    flat = np.flatnonzero(slid.least[best] < SHALLOW)
    if len(flat):
        reach = net.cell[vertex[best[flat]]]
        shifts = slid.weak[best[flat]] * reach[:, None]
        owner = np.tile(flat, 4)
        again = superquadric.project(origins[owner] + np.concatenate([k * shifts for k in (-2, -1, 1, 2)]))
        second = _slide(superquadric, box, targets[owner], again)
        both = np.concatenate([flat, owner])
        choice = _nearest(both, targets[both], np.concatenate([points[flat], second.points]))
        origins[flat] = np.concatenate([origins[flat], second.origins])[choice]
        points[flat] = box.deform(origins[flat])
    return _finish(superquadric, box, targets, origins, points)


def settle(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, slides: int) -> Array:
    """Slide given origins (n, 3) a few times towards their targets (n, 3); what is left is for the next call.

    As if the surface were flat (Gauss and Newton): what a slide leaves of the way is distance times curvature,
    little for data near the surface. No foot point gets worse.
    """
    origins = origins.copy()
    points = box.deform(origins)
    damping = np.full(len(origins), 1e-9)
    for _ in range(slides):
        gap = targets - points
        trial = superquadric.project(origins + _flat_step(superquadric, box, origins, gap, damping))
        there = box.deform(trial)
        closer = ((targets - there) ** 2).sum(axis=1) <= (gap**2).sum(axis=1)
        origins[closer], points[closer] = trial[closer], there[closer]
        damping = np.where(closer, 0.1 * damping, np.maximum(10 * damping, 1.0))
    return origins


def _flat_step(superquadric: Superquadric, box: ControlBox, origins: Array, gap: Array, damping: Array) -> Array:
    """Steps (n, 3) of origins in their tangent planes to where the deformed planes are nearest to the targets."""
    frame = tangent_frames(superquadric, origins)
    tangents = box.jacobian(origins) @ frame
    one, other = tangents[:, :, 0], tangents[:, :, 1]
    a, b, c = (np.einsum("ni,ni->n", u, v) for u, v in ((one, one), (one, other), (other, other)))
    slack = (damping + 1e-12) * (a + c) + 1e-300
    a, c = a + slack, c + slack
    pull, push = np.einsum("ni,ni->n", one, gap), np.einsum("ni,ni->n", other, gap)
    area = a * c - b * b
    steps = np.stack([(c * pull - b * push) / area, (a * push - b * pull) / area], axis=1)
    move = np.einsum("nia,na->ni", frame, steps)
    reach = LONGEST * float(np.linalg.norm(box.edges))
    return move * np.minimum(1, reach / np.maximum(np.linalg.norm(move, axis=1), 1e-300))[:, None]


@dataclass(frozen=True)
class _Slid:
    """Where the origins came to rest: least curvature of half the squared distance, and its undeformed direction."""

    origins: Array
    points: Array
    least: Array
    weak: Array


@dataclass(frozen=True)
class _Step:
    """A step of the origins (n, 3), the gain in squared distance that it promises, and the curvatures as in _Slid."""

    move: Array
    promised: Array
    least: Array
    weak: Array


def _slide(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array) -> _Slid:
    """Damped Newton steps on |target - X|^2 over the two tangent coordinates.

    A step that would lead away is refused and shortened, so a foot point never gets worse.
    """
    origins = origins.copy()
    points = box.deform(origins)
    damping, least, weak = np.full(len(origins), 1e-6), np.ones(len(origins)), np.zeros_like(origins)
    active = np.arange(len(origins))
    reach = float(np.linalg.norm(box.edges))
    for _ in range(SLIDES):
        gap = targets[active] - points[active]
        step = _newton_step(superquadric, box, origins[active], gap, damping[active], reach)
        least[active], weak[active] = step.least, step.weak
        trial = superquadric.project(origins[active] + step.move)
        way = box.deform(trial) - points[active]
        gained = np.einsum("ij,ij->i", way, 2 * gap - way)
        length = np.linalg.norm(step.move, axis=1)
        closer = (gained > 0) | (length < SURE * reach)
        good = active[closer]
        origins[good], points[good] = trial[closer], points[good] + way[closer]
        poor = gained < 0.25 * step.promised
        damping[active] = np.where(poor, 10 * np.maximum(damping[active], 1e-2), 0.1 * damping[active])
        active = active[(length > SETTLED * reach) & (damping[active] < 1e8)]
        if not len(active):
            break
    return _Slid(origins, box.deform(origins), least, weak)


def _newton_step(
    superquadric: Superquadric, box: ControlBox, origins: Array, gap: Array, damping: Array, reach: float
) -> _Step:
    """Step in coordinates in which the deformed tangents are orthonormal: there the Hessian is 1 + distance x shape.

    The shape operator is the difference of normals a little apart. Directions in which the distance is at a maximum
    are followed downhill.
    """
    frame = tangent_frames(superquadric, origins)
    tangents = box.jacobian(origins) @ frame
    gram = np.einsum("nia,nib->nab", tangents, tangents)
    gram += (1e-14 * np.trace(gram, axis1=1, axis2=2) + 1e-300)[:, None, None] * np.eye(2)
    unroll = np.linalg.solve(np.linalg.cholesky(gram), np.broadcast_to(np.eye(2), gram.shape)).transpose(0, 2, 1)
    ways, tangents = frame @ unroll, tangents @ unroll
    normal = _unit(np.cross(tangents[:, :, 0], tangents[:, :, 1]))
    h = DIFFERENCE * reach
    ahead = [surface_normals(superquadric, box, origins + h * ways[:, :, b]) for b in range(2)]
    shape = np.einsum("nia,nib->nab", tangents, (np.stack(ahead, axis=2) - normal[:, :, None]) / h)
    height = np.einsum("ni,ni->n", gap, normal)
    hessian = np.eye(2) + height[:, None, None] * (shape + shape.transpose(0, 2, 1)) / 2
    curvature, axes = np.linalg.eigh(hessian)
    pull = np.einsum("nab,nia,ni->nb", axes, tangents, gap)
    size = np.abs(curvature)
    pushed = np.where(curvature < 0, np.copysign(np.maximum(np.abs(pull), KICK * reach * size), pull), pull)
    along = pushed / (np.maximum(size, 1e-6) + damping[:, None])
    move = np.einsum("nia,nab,nb->ni", ways, axes, along)
    shorter = np.minimum(1, LONGEST * reach / np.maximum(np.linalg.norm(move, axis=1), 1e-300))
    promised = shorter * (along * (2 * pull - shorter[:, None] * curvature * along)).sum(axis=1)
    weak = _unit(np.einsum("nia,na->ni", ways, axes[:, :, 0]))
    return _Step(move * shorter[:, None], promised, curvature[:, 0], weak)


def _nearest(owner: Index, targets: Array, points: Array) -> Index:
    """Index of the nearest point for each owner, in the owners' order; the first of equals."""
    order = np.lexsort((np.linalg.norm(targets - points, axis=1), owner))
    return np.asarray(order[np.unique(owner[order], return_index=True)[1]], dtype=np.int64)


def _finish(superquadric: Superquadric, box: ControlBox, targets: Array, origins: Array, points: Array) -> FootPoints:
    normals = surface_normals(superquadric, box, origins)
    gap = targets - points
    side = np.where(np.einsum("ij,ij->i", gap, normals) < 0, -1.0, 1.0)
    return FootPoints(origins, points, normals, side * np.linalg.norm(gap, axis=1))


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def tangent_frames(superquadric: Superquadric, origins: Array) -> Array:
    """Two unit tangents of the undeformed surface, (n, 3, 2); with the outward normal they are right-handed."""
    normal = _unit(superquadric.gradient(origins))
    helper = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = _unit(np.cross(helper, normal))
    return np.stack([first, np.cross(normal, first)], axis=2)


def surface_normals(superquadric: Superquadric, box: ControlBox, origins: Array) -> Array:
    """Unit outward normals (n, 3) of the deformed surface at the images of its origins."""
    rows = box.jacobian(origins)
    gradient = superquadric.gradient(origins)
    cofactors = [np.cross(rows[:, i - 2], rows[:, i - 1]) for i in range(3)]
    return _unit(np.stack([np.einsum("ni,ni->n", c, gradient) for c in cofactors], axis=1))
