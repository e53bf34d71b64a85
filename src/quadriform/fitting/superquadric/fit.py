"""Fitting a superquadric: the front door, and the paper's way (2.3): criterion P3 by conjugate gradient."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares, minimize

from quadriform.errors import OptionError, WarningKind, Warnings, choose, known_options
from quadriform.fitting.inputs import without_meshes
from quadriform.fitting.mixture import LEAST_SIGMA
from quadriform.fitting.precision import precision
from quadriform.fitting.result import SuperquadricFit
from quadriform.fitting.superquadric.batch import TURN, Candidates, distances
from quadriform.fitting.superquadric.identifiability import determined
from quadriform.fitting.superquadric.initial import start
from quadriform.fitting.superquadric.robust import cut_to, fit_robust, in_world
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import point_set
from quadriform.points import Array, Frame, check_spread, check_weights
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

MAX_ITERATIONS = 1000
GRADIENT_TOLERANCE = 1e-8
"""Of the mean criterion, lengths in units of the cloud's RMS radius."""
UNDETERMINED = 1e4
"""A condition above this is warned of."""
NEAR_BOUND = 1e-3
ROUND = 1e-6
"""Semi-axes nearer to each other than this share of the largest make a body round, about one axis or all."""
TO_THE_LAST_DIGITS = {"method": "lm", "xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "max_nfev": 300}


@known_options
@one_blas_thread
def fit_superquadric(
    points: ArrayLike | Mesh,
    kind: str = "ellipsoid",
    method: str = "robust",
    weights: ArrayLike | None = None,
    fixed: Mapping[str, ArrayLike] | None = None,
) -> SuperquadricFit:
    """Fit a superquadric to points around it.

    Args:
        points: (n, 3), in any unit and frame; at least 11 distinct ones (12 for the toroid), not on one plane. Or a
            triangle mesh, as in `fit`.
        kind: "ellipsoid", "toroid", "hyperboloid1" or "hyperboloid2".
        method: "robust": outliers, missing parts and other bodies are allowed for, nothing has to be set;
            "paper": start from moments (A.3), criterion P3 by conjugate gradient (2.3).
        weights: (n,), >= 0; a point of weight k counts as k points, one of weight 0 is not there.
        fixed: values of "semi_axes", "exponents", "rotation" or "translation" that are held.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    choose(kind, tuple(KINDS), "kind")
    choose(method, ("robust", "paper"), "method")
    given, notes = without_meshes(points, weights)
    checked = point_set(given)
    world, notes = checked.points, notes + checked.notes
    if method == "robust":
        robust = fit_robust(world, kind, check_weights(weights, len(world)), dict(fixed or {}))
        return replace(robust, warnings=precision(checked.number_type, world) | robust.warnings, notes=notes)
    if weights is not None or fixed:
        raise OptionError("method='paper' takes neither weights nor fixed; use method='robust'")
    check_spread(world, needed=12 if kind == "toroid" else 11)
    frame = Frame.of(world)
    found = in_world(fit_paper(frame.to_local(world), kind), frame)
    return replace(found, warnings=precision(checked.number_type, world) | found.warnings, notes=notes)


class _Unbounded:
    """The parameters as free numbers: logarithms of lengths, logits of exponents, turns away from the start.

    Euler angles are counted from the start's axes, so the fit begins far from gimbal lock.
    """

    def __init__(self, first: Superquadric) -> None:
        self.first = replace(first, rotation=np.eye(3))
        self.axes = first.rotation

    def free(self) -> Array:
        """The start as free numbers."""
        p = self.first.parameters.copy()
        p[:3] = np.log(p[:3])
        share = (p[3:5] - EXPONENTS[0]) / (EXPONENTS[1] - EXPONENTS[0])
        p[3:5] = np.log(share / (1 - share))
        p[8:11] = p[8:11] @ self.axes
        p[11:] = np.log(p[11:] - 1)
        return p

    def bound(self, free: Array) -> tuple[Superquadric, Array]:
        """The superquadric in the start's axes, and the derivative of each of its numbers by its free one."""
        p, slope = free.copy(), np.ones(len(free))
        p[:3] = slope[:3] = np.exp(np.clip(free[:3], -50, 50))
        share = 1 / (1 + np.exp(-np.clip(free[3:5], -500, 500)))
        span = EXPONENTS[1] - EXPONENTS[0]
        p[3:5], slope[3:5] = EXPONENTS[0] + span * share, span * share * (1 - share)
        slope[11:] = np.exp(np.clip(free[11:], -30, 30))
        p[11:] = 1 + slope[11:]
        return self.first.with_parameters(p), slope

    def in_place(self, free: Array) -> Superquadric:
        """The superquadric in the frame of the points."""
        found, _ = self.bound(free)
        return replace(
            found,
            rotation=self.axes @ found.rotation,
            translation=self.axes @ found.translation,
        )


def fit_paper(points: Array, kind: str) -> SuperquadricFit:
    """The paper's fit to centred, scaled points (n, 3)."""
    coordinates = _Unbounded(start(points, kind))
    turned = points @ coordinates.axes

    def criterion(free: Array) -> tuple[float, Array]:
        candidate, slope = coordinates.bound(free)
        # Euler angles of the candidate are the free ones themselves, so no gimbal lock can swap them
        value, by_parameter = candidate.parameter_derivatives(turned)
        gap = value - 1
        return float(gap @ gap) / len(gap), 2 * (gap @ by_parameter) * slope / len(gap)  # P3

    history: list[float] = []
    result = minimize(
        criterion,
        coordinates.free(),
        jac=True,
        method="CG",
        callback=lambda intermediate_result: history.append(float(intermediate_result.fun)),
        options={"gtol": GRADIENT_TOLERANCE, "maxiter": MAX_ITERATIONS},
    )
    found = cut_to(coordinates.in_place(result.x), points)
    rank, condition = determinacy(found, points)
    warnings = superquadric_warnings(found, points, rank, condition)
    if result.nit >= MAX_ITERATIONS:
        warnings[WarningKind.MAX_ITERATIONS] = f"the superquadric fit stopped after {result.nit} iterations"
    distance, derivatives = distances(Candidates.of([found]), points)
    noise = max(float(np.sqrt((distance**2).mean())), LEAST_SIGMA)
    free = np.zeros(len(found.parameters), dtype=np.bool_)
    state = determined(Candidates.of([found]), derivatives[0], np.ones(len(points)), noise, free)
    everyone = np.ones(len(points))
    iterations = int(result.nit)
    return SuperquadricFit(
        found,
        warnings,
        rank,
        condition,
        state.covariance,
        everyone,
        noise,
        tuple(history),
        iterations,
    )


def least_criterion(points: Array, kind: str) -> Superquadric:
    """The minimum of P3 from the paper's start, to the last digits, by Levenberg and Marquardt's method.

    Conjugate gradients stop a few digits earlier; a start that other results depend on must be the same for a turned
    cloud. Points (n, 3) centred and scaled.
    """
    coordinates = _Unbounded(start(points, kind))
    turned = points @ coordinates.axes

    def gap(free: Array) -> Array:
        return coordinates.bound(free)[0].implicit(turned) - 1

    def slopes(free: Array) -> Array:
        candidate, slope = coordinates.bound(free)
        return candidate.parameter_derivatives(turned)[1] * slope

    def least(begin: Array, moving: NDArray[np.bool_]) -> Array:
        def whole(part: Array) -> Array:
            every = begin.copy()
            every[moving] = part
            return every

        found = least_squares(
            lambda part: gap(whole(part)),
            begin[moving],
            lambda part: slopes(whole(part))[:, moving],
            **TO_THE_LAST_DIGITS,
        )
        return whole(found.x)

    begin, every = coordinates.free(), np.ones(len(coordinates.free()), dtype=np.bool_)
    if (np.diff(np.sort(coordinates.first.semi_axes)) < ROUND * coordinates.first.semi_axes.max()).any():
        begin = least(begin, ~np.isin(np.arange(len(begin)), np.r_[TURN]))  # turns of round bodies are rounding
    return cut_to(coordinates.in_place(least(begin, every)), points)


def determinacy(found: Superquadric, points: Array) -> tuple[int, float]:
    """Rank and condition of the derivatives of F by the parameters at centred, scaled points.

    Taken in the superquadric's own axes, where Euler angles are small turns: gimbal lock is no lack of data.
    """
    turn = found.rotation
    upright = replace(found, rotation=np.eye(3), translation=found.translation @ turn)
    _, by_parameter = upright.parameter_derivatives(points @ turn)
    singular = np.linalg.svd(by_parameter, compute_uv=False)
    rank = int((singular > 1e-10 * singular[0]).sum())
    return rank, float(singular[0] / max(singular[-1], 1e-300))


def superquadric_warnings(found: Superquadric, points: Array, rank: int, condition: float) -> Warnings:
    """What is to be said of a superquadric fitted to centred, scaled points."""
    warnings: Warnings = {}
    needed = len(found.parameters)
    if rank < needed or condition > UNDETERMINED:
        warnings[WarningKind.ILL_CONDITIONED] = (
            f"the points determine {rank} of {needed} superquadric parameters, condition {condition:.1e}"
        )
    at_bound = (found.exponents < EXPONENTS[0] + NEAR_BOUND) | (found.exponents > EXPONENTS[1] - NEAR_BOUND)
    extent = float(np.ptp(points, axis=0).max())
    too_long = found.semi_axes > 2 * extent
    if at_bound.any() or too_long.any():
        warnings[WarningKind.AT_BOUND] = (
            f"exponents {found.exponents.round(3).tolist()}, longest semi-axis "
            f"{found.semi_axes.max() / extent:.2g} x the extent of the data: the data does not hold them"
        )
    return warnings
