"""Numbers from the words of a text."""

from collections.abc import Iterable

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.points import Array


def floats(words: Iterable[str] | Iterable[bytes], where: str) -> Array:
    """Return the words as float64, (n,); "nan" and "inf" are numbers here, 1_000 and 1,5 are not.

    Raises:
        FileFormatError: a word is no number.
    """
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError as error:
            raise FileFormatError(f"{where}: expected a number, found {_shown(word)!r}") from error
        if ("_" if isinstance(word, str) else b"_") in word:  # type: ignore[operator]  # separates thousands in Python
            raise FileFormatError(f"{where}: expected a number, found {_shown(word)!r}")
    return np.array(values, dtype=np.float64)


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
