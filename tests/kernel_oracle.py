"""The compiled loops over points written out in NumPy: what tests/shapes/test_kernel.py holds them to."""

import numpy as np

from quadriform.fitting.superquadric.candidates import AXES, HOLE, POWERS, ROTATION, SHIFT
from quadriform.shapes import bernstein
from quadriform.shapes.kinds import KINDS

LONGEST, KICK, SURE, CONVERGED, DIFFERENCE, FLATTEST = 0.2, 0.01, 1e-6, 1e-8, 1e-6, 1e-3


def carried(box, points):
    return box.matrix(points) @ box.control_points.reshape(-1, 3)


def jacobian(box, points):
    return np.einsum("nkj,ki->nij", box.matrix_gradient(points), box.control_points.reshape(-1, 3))


def unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def normals(surface, box, origins):
    rows, gradient = jacobian(box, origins), surface.gradient(origins)
    cofactors = [np.cross(rows[:, i - 2], rows[:, i - 1]) for i in range(3)]
    return unit(np.stack([np.einsum("ni,ni->n", c, gradient) for c in cofactors], axis=1))


def tangent_frames(surface, origins):
    normal = unit(surface.gradient(origins))
    helper = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = unit(np.cross(helper, normal))
    return np.stack([first, np.cross(normal, first)], axis=2)


def update_foot_points(surface, box, targets, origins, steps_allowed):
    origins = origins.copy()
    points, damping = carried(box, origins), np.full(len(origins), 1e-9)
    for _ in range(steps_allowed):
        residual = targets - points
        trial = surface.project(origins + _flat_step(surface, box, origins, residual, damping))
        moved = carried(box, trial)
        closer = ((targets - moved) ** 2).sum(axis=1) <= (residual**2).sum(axis=1)
        origins[closer], points[closer] = trial[closer], moved[closer]
        damping = np.where(closer, 0.1 * damping, np.maximum(10 * damping, 1.0))
    return origins


def _flat_step(surface, box, origins, residual, damping):
    frame = tangent_frames(surface, origins)
    tangents = jacobian(box, origins) @ frame
    gram = np.einsum("nia,nib->nab", tangents, tangents)
    slack = (damping + 1e-12) * np.trace(gram, axis1=1, axis2=2) + 1e-300
    pull = np.einsum("nia,ni->na", tangents, residual)
    steps = np.linalg.solve(gram + slack[:, None, None] * np.eye(2), pull[:, :, None])[:, :, 0]
    move = np.einsum("nia,na->ni", frame, steps)
    reach = LONGEST * np.linalg.norm(box.edges)
    return move * np.minimum(1, reach / np.maximum(np.linalg.norm(move, axis=1), 1e-300))[:, None]


def converge_foot_points(surface, box, targets, origins, steps_allowed):
    """Origins, points, least curvature and its direction."""
    origins, reach = origins.copy(), float(np.linalg.norm(box.edges))
    points = carried(box, origins)
    damping, least, weak = np.full(len(origins), 1e-6), np.ones(len(origins)), np.zeros_like(origins)
    active = np.arange(len(origins))
    for _ in range(steps_allowed):
        residual = targets[active] - points[active]
        move, promised, least[active], weak[active] = _newton_step(
            surface, box, origins[active], residual, damping[active], reach
        )
        trial = surface.project(origins[active] + move)
        way = carried(box, trial) - points[active]
        gained, length = np.einsum("ij,ij->i", way, 2 * residual - way), np.linalg.norm(move, axis=1)
        closer = (gained > 0) | (length < SURE * reach)
        good = active[closer]
        origins[good], points[good] = trial[closer], points[good] + way[closer]
        poor = gained < 0.25 * promised
        damping[active] = np.where(poor, 10 * np.maximum(damping[active], 1e-2), 0.1 * damping[active])
        active = active[(length > CONVERGED * reach) & (damping[active] < 1e8)]
        if not len(active):
            break
    return origins, points, least, weak


def _newton_step(surface, box, origins, residual, damping, reach):
    frame = tangent_frames(surface, origins)
    tangents = jacobian(box, origins) @ frame
    gram = np.einsum("nia,nib->nab", tangents, tangents)
    unroll = np.linalg.solve(np.linalg.cholesky(gram), np.broadcast_to(np.eye(2), gram.shape)).transpose(0, 2, 1)
    ways, tangents = frame @ unroll, tangents @ unroll
    normal, h = unit(np.cross(tangents[:, :, 0], tangents[:, :, 1])), DIFFERENCE * reach
    ahead = np.stack([normals(surface, box, origins + h * ways[:, :, b]) for b in range(2)], axis=2)
    shape = np.einsum("nia,nib->nab", tangents, (ahead - normal[:, :, None]) / h)
    height = np.einsum("ni,ni->n", residual, normal)
    hessian = np.eye(2) + height[:, None, None] * (shape + shape.transpose(0, 2, 1)) / 2
    curvature, axes = np.linalg.eigh(hessian)
    pull, size = np.einsum("nab,nia,ni->nb", axes, tangents, residual), np.abs(curvature)
    pushed = np.where(curvature < 0, np.copysign(np.maximum(np.abs(pull), KICK * reach * size), pull), pull)
    along = pushed / (np.maximum(size, 1e-6) + damping[:, None])
    move = np.einsum("nia,nab,nb->ni", ways, axes, along)
    shorter = np.minimum(1, LONGEST * reach / np.maximum(np.linalg.norm(move, axis=1), 1e-300))
    promised = shorter * (along * (2 * pull - shorter[:, None] * curvature * along)).sum(axis=1)
    return move * shorter[:, None], promised, curvature[:, 0], unit(np.einsum("nia,na->ni", ways, axes[:, :, 0]))


def distances(candidates, points):
    """Of each candidate in turn: (M, m) and (M, n_parameters, m)."""
    found = [_distance(candidates, index, points) for index in range(len(candidates))]
    return np.stack([value for value, _ in found]), np.stack([slopes for _, slopes in found])


def _distance(candidates, index, points):
    rotation, axes = candidates.rotations[index], np.exp(candidates.log_axes[index])
    hole = KINDS[candidates.kind].has_hole * (1 + np.exp(candidates.log_holes[index, 0]))
    local = (points - candidates.translations[index]) @ rotation

    def gradient(x):
        at = KINDS[candidates.kind].derivatives(x / axes, candidates.exponents[index], hole)
        by_local = at.point / axes
        return at, by_local, np.maximum(np.linalg.norm(by_local, axis=1), FLATTEST / axes.max())

    at, by_local, steep = gradient(local)
    distance = (at.value - 1) / steep
    foot = local - (distance / steep)[:, None] * by_local
    at, by_local, steep = gradient(foot)
    slopes, normal = np.empty((candidates.n_parameters, len(points))), by_local / steep[:, None]
    slopes[AXES] = (-foot / axes * at.point / steep[:, None]).T
    slopes[POWERS], slopes[ROTATION], slopes[SHIFT] = (
        (at.exponents / steep[:, None]).T,
        np.cross(normal, foot).T,
        -normal.T,
    )
    if candidates.kind == "toroid":
        slopes[HOLE] = at.hole / steep * (hole - 1)
    return distance, slopes


def combined(factors, coefficients):
    """sum_ijk a_i b_j c_k C_ijk."""
    return bernstein.products(factors) @ coefficients.reshape(-1, coefficients.shape[-1])
