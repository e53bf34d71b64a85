"""Lines of the text files of biv-me: fields between tabs or blanks, numbers, names of columns in any writing."""

import re
from collections.abc import Callable, Iterator

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.reading import signature

SLICE_NAMES = ("slice", "sliceid", "frameid")
"""What the column of slices, and the field of a SliceInfoFile, is called; frameID is the number of an image."""


def lines_of(data: bytes, where: str, split: Callable[[str], list[str]]) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and fields, blank lines left out."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{where}: expected text in UTF-8, found {signature(data)}") from error
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip():
            yield number, split(line)


def fields_of(line: str) -> list[str]:
    """Between tabs, or between blanks in a line without tabs, where a header's two words of a name are put together."""
    if "\t" in line:
        return [field.strip() for field in line.split("\t")]
    return re.sub(r"(contour|time|slice|frame) (?=type|frame|id)", r"\1_", line, flags=re.IGNORECASE).split()


def plain(name: str) -> str:
    """A column's name without case, blanks and underscores."""
    return re.sub(r"[\s_]", "", name).lower()


def number_in(word: str, where: str, whole: bool = False) -> float:
    """The number that a word is.

    Raises:
        FileFormatError: it is none, or not finite, or not whole where a whole one is asked for.
    """
    if not is_number(word) or (whole and float(word) != int(float(word))):
        raise FileFormatError(f"{where}: expected a {'whole' if whole else 'finite'} number, found {word!r}")
    return float(word)


def is_number(word: str) -> bool:
    """Whether a word is a finite number."""
    try:
        return "_" not in word and bool(np.isfinite(float(word)))  # Python reads 1_000 as a number; a table must not
    except ValueError:
        return False
