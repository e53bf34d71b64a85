"""Digits that coordinates had already lost when they came: far from the origin, or in a short type.

A short type is recognised from the type itself, and from the values, because readers and lists give double precision
whatever the source had.
"""

import numpy as np

from quadriform.errors import WarningKind, Warnings
from quadriform.points import Array

LEAST, LEAST_SHORT = 1e-9, 1e-5
"""Smallest steps between neighbouring coordinates that are reported, of a double and of a shorter type, relative to
half the cloud's diagonal."""
FAR, COARSE = 100, 1e-3
"""A cloud this many half-diagonals from the origin, on a decimal grid this coarse, was written with too few digits."""
ENOUGH = 10_000
"""Points whose values tell the type they had."""


def precision(given: object, points: Array) -> Warnings:
    """PRECISION_LOSS when the step between neighbouring values of the largest coordinate is coarse beside the cloud.

    Args:
        given: as the caller gave them, whose type counts: an array, a NumPy type, or anything else, which is judged by
            its values.
        points: (n, 3), the same as float64.
    """
    kind = given if isinstance(given, np.dtype) else getattr(given, "dtype", None)
    if isinstance(kind, np.dtype) and kind.kind != "f":
        return {}
    largest = max(abs(float(points.min())), abs(float(points.max())))
    with np.errstate(over="ignore"):  # a cloud of that size is refused for it
        half = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
    if not 0 < half < np.inf:
        return {}
    name, step, least = _step(kind, points[:: max(1, len(points) // ENOUGH)], largest, half)
    share = step / half
    if share <= least:
        return {}
    text = (
        f"neighbouring {name} numbers at {largest:.3g} are {step:.1e} apart, {share:.0e} of half the cloud's "
        "diagonal; subtract an offset before they are stored"
    )
    return {WarningKind.PRECISION_LOSS: text}


def _step(kind: object, points: Array, largest: float, half: float) -> tuple[str, float, float]:
    """Name of the numbers, their step at the largest coordinate, and the smallest share that is reported."""
    with np.errstate(over="ignore"):
        if isinstance(kind, np.dtype) and kind.itemsize < 8:
            return kind.name, float(np.spacing(kind.type(largest))), LEAST_SHORT
        single = float(np.spacing(np.float32(largest)))
        if _are_single(points) and not _decimal_grid(points, 2 * single):  # on a coarser grid single precision is exact
            return "float32", single, LEAST_SHORT
    if largest > FAR * half and (grid := _decimal_grid(points, COARSE * half)):
        return "decimal", grid, COARSE
    return "float64", float(np.spacing(largest)), LEAST


def _are_single(points: Array) -> bool:
    """Whether all coordinates are numbers of single precision, or the shortest texts of such."""
    single = points.astype(np.float32)
    other = points != single
    if not other.any():
        return True
    values, texts = points[other], np.float64(single[other].astype(str))
    return bool((values == texts).all())


def _decimal_grid(points: Array, least: float) -> float:
    """The largest power of ten, not below `least`, that all coordinates are multiples of; 0 where there is none."""
    if not 1e-300 < least < 1e300:
        return 0.0
    grid, found = float(10.0 ** np.ceil(np.log10(least))), 0.0
    while points.any() and _are_multiples(points, grid):
        grid, found = 10 * grid, grid
    return found


def _are_multiples(points: Array, grid: float) -> bool:
    steps = points / grid
    rounding = 1e-6 + 4 * np.finfo(np.float64).eps * np.abs(steps)
    return bool((np.abs(steps - np.round(steps)) < rounding).all())
