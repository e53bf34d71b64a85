"""The paper's superquadric fit: criterion P3 by conjugate gradient from the start of A.3 (section 2.3)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from quadriform.fitting.mixture import LEAST_SIGMA
from quadriform.fitting.result import SuperquadricFit
from quadriform.fitting.superquadric.candidates import ROTATION, Candidates, distances
from quadriform.fitting.superquadric.diagnostics import at_bound, not_converged, undetermined
from quadriform.fitting.superquadric.identifiability import identifiability_of
from quadriform.fitting.superquadric.initial import STARTS, cut_to
from quadriform.points import Array
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

MAX_ITERATIONS = 1000
GRADIENT_TOLERANCE = 1e-8
"""Of the mean criterion, lengths in units of the cloud's RMS radius."""
ROUND = 1e-6
"""Semi-axes nearer to each other than this, relative to the largest, make a body round, about one axis or all."""
LARGEST_LOG, LARGEST_LOG_HOLE, LARGEST_LOGIT = 50.0, 30.0, 500.0
"""Unbounded parameters are clipped to these, against overflow: a descent that has diverged stays finite."""
UNCUT = 1e25
"""Height at which a hyperboloid is cut while its parameters are sought: above any of its semi-axes, for a surface of
two sheets may not be cut below its tips, at |x| = a1. It does not change F; the result is cut where the points end."""
TO_THE_LAST_DIGITS = {"method": "lm", "xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "max_nfev": 300}


class _UnboundedParameters:
    """The map from parameters without bounds: logarithms of lengths, logits of exponents, rotations from the start.

    Euler angles are counted from the start's axes, so the fit begins far from gimbal lock.
    """

    def __init__(self, first: Superquadric) -> None:
        self.first = replace(first, rotation=np.eye(3), height=None if first.height is None else UNCUT)
        self.axes = first.rotation

    def start(self) -> Array:
        """The start in unbounded parameters, (11,) or (12,)."""
        p = self.first.parameters.copy()
        p[:3] = np.log(p[:3])
        fraction = (p[3:5] - EXPONENTS[0]) / (EXPONENTS[1] - EXPONENTS[0])
        p[3:5] = np.log(fraction / (1 - fraction))
        p[8:11] = p[8:11] @ self.axes
        p[11:] = np.log(p[11:] - 1)
        return p

    def in_start_axes(self, unbounded: Array) -> tuple[Superquadric, Array]:
        """The superquadric in the start's axes, and the derivative of each parameter by the unbounded one."""
        # lengths exp(x), exponents a + (b - a) / (1 + exp(-x)), hole radius 1 + exp(x); clipped against overflow
        p, derivative = unbounded.copy(), np.ones(len(unbounded))
        p[:3] = derivative[:3] = np.exp(np.clip(unbounded[:3], -LARGEST_LOG, LARGEST_LOG))
        fraction = 1 / (1 + np.exp(-np.clip(unbounded[3:5], -LARGEST_LOGIT, LARGEST_LOGIT)))
        span = EXPONENTS[1] - EXPONENTS[0]
        p[3:5], derivative[3:5] = EXPONENTS[0] + span * fraction, span * fraction * (1 - fraction)
        derivative[11:] = np.exp(np.clip(unbounded[11:], -LARGEST_LOG_HOLE, LARGEST_LOG_HOLE))
        p[11:] = 1 + derivative[11:]
        return self.first.with_parameters(p), derivative

    def superquadric(self, unbounded: Array) -> Superquadric:
        """The superquadric in the frame of the points."""
        found, _ = self.in_start_axes(unbounded)
        return replace(found, rotation=self.axes @ found.rotation, translation=self.axes @ found.translation)


def fit_paper(points: Array, kind: str) -> SuperquadricFit:
    """The paper's fit to centred, scaled points (n, 3)."""
    coordinates = _UnboundedParameters(STARTS[kind](points))
    rotated = points @ coordinates.axes

    def criterion(unbounded: Array) -> tuple[float, Array]:
        """The paper's criterion and its gradient."""
        candidate, derivative = coordinates.in_start_axes(unbounded)
        # Euler angles are unbounded parameters themselves, so no gimbal lock can exchange them
        value, by_parameter = candidate.parameter_derivatives(rotated)
        residual = value - 1
        gradient = 2 * (residual @ by_parameter) * derivative / len(residual)
        return float(residual @ residual) / len(residual), gradient  # P3

    history: list[float] = []
    result = minimize(
        criterion,
        coordinates.start(),
        jac=True,
        method="CG",
        callback=lambda intermediate_result: history.append(float(intermediate_result.fun)),
        options={"gtol": GRADIENT_TOLERANCE, "maxiter": MAX_ITERATIONS},
    )
    found = cut_to(coordinates.superquadric(result.x), points)
    return _with_covariance(found, points, int(result.nit), tuple(history))


def _with_covariance(
    found: Superquadric, points: Array, iterations: int, history: tuple[float, ...]
) -> SuperquadricFit:
    """The fit with its warnings, noise and covariance, of the distances to first order."""
    rank, condition = rank_and_condition(found, points)
    candidates, ones = Candidates.of([found]), np.ones(len(points))
    distance, derivatives = distances(candidates, points)
    noise = max(float(np.sqrt((distance**2).mean())), LEAST_SIGMA)
    state = identifiability_of(candidates, derivatives[0], ones, noise, np.zeros(len(found.parameters), dtype=np.bool_))
    warnings = (
        undetermined(rank, condition, len(found.parameters), state.weakest)
        | at_bound(found, 2 * float(np.ptp(points, axis=0).max()))
        # not by SciPy's `success`: it is also false where a line search finds no lower value, as at a minimum at which
        # the criterion, or its gradient, is rounding
        | not_converged(iterations < MAX_ITERATIONS, iterations)
    )
    return SuperquadricFit(found, warnings, rank, condition, state.covariance, ones, noise, history, iterations)


def least_squares_p3(points: Array, kind: str) -> Superquadric:
    """The minimum of P3 from the paper's start, to the last digits, by Levenberg and Marquardt's method.

    Conjugate gradients stop a few digits earlier; a start that other results depend on must be the same for a rotated
    cloud. The points (n, 3) are centred and scaled.
    """
    coordinates = _UnboundedParameters(STARTS[kind](points))
    rotated = points @ coordinates.axes

    def residual(unbounded: Array) -> Array:
        """F - 1 (n,) at all points."""
        return coordinates.in_start_axes(unbounded)[0].implicit(rotated) - 1

    def jacobian(unbounded: Array) -> Array:
        """Derivatives (n, p) of `residual` by the parameters."""
        candidate, derivative = coordinates.in_start_axes(unbounded)
        return candidate.parameter_derivatives(rotated)[1] * derivative

    def least(begin: Array, moving: NDArray[np.bool_]) -> Array:
        """The parameters of the least squares, of which only some move."""

        def whole(part: Array) -> Array:
            """All parameters, with those that move in their places."""
            every = begin.copy()
            every[moving] = part
            return every

        found = least_squares(
            lambda part: residual(whole(part)),
            begin[moving],
            lambda part: jacobian(whole(part))[:, moving],
            **TO_THE_LAST_DIGITS,
        )
        return whole(found.x)

    begin, every = coordinates.start(), np.ones(len(coordinates.start()), dtype=np.bool_)
    if (np.diff(np.sort(coordinates.first.semi_axes)) < ROUND * coordinates.first.semi_axes.max()).any():
        begin = least(begin, ~np.isin(np.arange(len(begin)), np.r_[ROTATION]))  # rotations of round bodies are rounding
    return cut_to(coordinates.superquadric(least(begin, every)), points)


def rank_and_condition(found: Superquadric, points: Array) -> tuple[int, float]:
    """Rank and condition of the derivatives of F by the parameters at centred, scaled points.

    Taken in the superquadric's own axes, where Euler angles are small rotations: gimbal lock is no lack of data.
    """
    axes = found.rotation
    upright = replace(found, rotation=np.eye(3), translation=found.translation @ axes)
    _, by_parameter = upright.parameter_derivatives(points @ axes)
    # relative to the largest singular value: the frame has no unit
    singular = np.linalg.svd(by_parameter, compute_uv=False)
    rank = int((singular > 1e-10 * singular[0]).sum())
    return rank, float(singular[0] / max(singular[-1], 1e-300))
