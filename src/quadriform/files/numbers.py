"""Numbers from the words of a text."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.points import Array

SINGLE = 1e-5
"""Coordinates may move by this share of the extent where a format stores single precision."""


def floats(words: Iterable[str] | Iterable[bytes], where: str) -> Array:
    """Return the words as float64, (n,); "nan" and "inf" are numbers here, 1_000 and 1,5 are not.

    Raises:
        FileFormatError: a word is no number.
    """
    given: list[Any] = list(words)
    try:
        values = np.array(list(map(float, given)), dtype=np.float64)
    except ValueError as error:
        wrong = next(word for word in given if not _is_number(word))
        raise FileFormatError(f"{where}: expected a number, found {_shown(wrong)!r}") from error
    separator: Any = b"_" if given and isinstance(given[0], bytes) else "_"
    for word in given:
        if separator in word:  # Python takes it for a separator of thousands
            raise FileFormatError(f"{where}: expected a number, found {_shown(word)!r}")
    return values


def _is_number(word: str | bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def whole(values: Array, where: str) -> np.ndarray:
    """Return whole numbers as int64.

    Raises:
        FileFormatError: others, or numbers above 2^53.
    """
    if not (np.isfinite(values).all() and np.array_equal(values, np.round(values)) and np.all(np.abs(values) < 2**53)):
        raise FileFormatError(f"{where}: expected whole numbers, found others")
    return values.astype(np.int64)


def _shown(word: str | bytes) -> str:
    return (word if isinstance(word, str) else word.decode("latin-1"))[:60]


def moved_by_single_precision(points: Array) -> float:
    """The largest change of a coordinate by rounding to single precision; infinite where it overflows."""
    with np.errstate(over="ignore"):
        return float(np.abs(points.astype(np.float32) - points).max(initial=0.0))


def fits_single_precision(points: Array) -> bool:
    """Whether points (n, 3) keep their form in single precision."""
    return bool(moved_by_single_precision(points) <= SINGLE * np.ptp(points, axis=0).max())
