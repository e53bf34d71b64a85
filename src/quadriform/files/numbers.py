"""Numbers from the words of a text, and what single precision does to them."""

from collections.abc import Iterable, Sequence

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.points import Array

SINGLE = 1e-5
"""Coordinates may move by this share of the extent where a format stores single precision."""
MAY_BE_CUT = "it may be cut; add a line end if it is not"


def to_number(word: str) -> float | None:
    """The number that a word is, "nan" and "inf" among them; None for 1_000, 1,5 and all others."""
    try:
        return None if "_" in word else float(word)  # Python reads 1_000 as a number; a file must not
    except ValueError:
        return None


def floats(words: Iterable[str] | Iterable[bytes], where: str) -> Array:
    """Return the words as float64, (n,), by the rules of `to_number`.

    Raises:
        FileFormatError: a word is no number.
    """
    texts = [word if isinstance(word, str) else word.decode("ascii", "backslashreplace") for word in words]
    values = [to_number(text) for text in texts]
    if None in values:
        raise FileFormatError(f"{where}: expected a number, found {texts[values.index(None)][:60]!r}")
    return np.array(values, dtype=np.float64)


def count_of(word: str, where: str) -> int:
    """The number of things that a header declares.

    Raises:
        FileFormatError: no decimal digits.
    """
    if not (word.isascii() and word.isdigit()):
        raise FileFormatError(f"{where}: expected a whole number, found {word[:60]!r}")
    return int(word)


def whole(values: Array, where: str) -> np.ndarray:
    """Return whole numbers as int64.

    Raises:
        FileFormatError: others, or numbers above 2^53.
    """
    if not (np.isfinite(values).all() and np.array_equal(values, np.round(values)) and np.all(np.abs(values) < 2**53)):
        raise FileFormatError(f"{where}: expected whole numbers, found others")
    return values.astype(np.int64)


def check_last_number(words: Sequence[str], where: str) -> None:
    """Refuse a number at the end of a text without a line end that may be cut.

    Args:
        words: the numbers of one column, row after row; the last one has no line end.
        where: how the error names the line.

    Raises:
        FileFormatError: it has fewer digits behind the point than all others, which have equally many.
    """
    digits = [len(word.partition(".")[2]) for word in words]
    if len(digits) > 2 and len(set(digits[:-1])) == 1 and digits[-1] < digits[0]:
        raise FileFormatError(
            f"{where}: the line has no end, and its last number has fewer digits than in all other rows: {MAY_BE_CUT}"
        )


def check_last_index(index: int, largest: int, where: str) -> None:
    """Refuse an index at the end of a text without a line end that may be the beginning of a longer one.

    One more digit makes at least ten times the index: where that is above the largest index, no digit can be missing.

    Raises:
        FileFormatError: ten times the index is not above the largest.
    """
    if 0 < 10 * index <= largest:
        raise FileFormatError(
            f"{where}: the last line has no end, and more digits may follow its last number {index}, for there are "
            f"indices up to {largest}: {MAY_BE_CUT}"
        )


def moved_by_single_precision(points: Array) -> float:
    """The largest change of a coordinate by rounding to single precision; infinite where it overflows."""
    with np.errstate(over="ignore"):
        return float(np.abs(points.astype(np.float32) - points).max(initial=0.0))


def fits_single_precision(points: Array) -> bool:
    """Whether points (n, 3) keep their form in single precision."""
    return bool(moved_by_single_precision(points) <= SINGLE * np.ptp(points, axis=0).max())
