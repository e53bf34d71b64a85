"""Digits that coordinates had already lost when they came: far from the origin, or in a short type."""

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import WarningKind, Warnings
from quadriform.points import Array

LEAST, LEAST_SHORT = 1e-9, 1e-5
"""Steps between neighbouring numbers of a double, and of a shorter type, worth a word; of half the cloud's diagonal."""


def precision(given: ArrayLike, points: Array) -> Warnings:
    """PRECISION_LOSS when the largest coordinate's last digit is coarse beside the cloud.

    Args:
        given: as the caller gave them, whose type counts.
        points: (n, 3), the same as float64.
    """
    kind = getattr(given, "dtype", np.dtype(np.float64))
    if not isinstance(kind, np.dtype) or kind.kind != "f":
        return {}
    short = kind.itemsize < 8
    largest = max(abs(float(points.min())), abs(float(points.max())))
    with np.errstate(over="ignore"):
        step = float(np.spacing(kind.type(largest) if short else largest))
    share = step / (float(np.linalg.norm(np.ptp(points, axis=0))) / 2)
    if share <= (LEAST_SHORT if short else LEAST):
        return {}
    text = (
        f"neighbouring {kind.name} numbers at {largest:.3g} are {step:.1e} apart, {share:.0e} of half the cloud's "
        "diagonal; subtract an offset before they are stored"
    )
    return {WarningKind.PRECISION_LOSS: text}
