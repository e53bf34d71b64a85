"""The order of files in time, read off the numbers in their names; one rule for folders, lists of files and cohorts."""

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

from quadriform.errors import InputError

NUMBER = re.compile(r"([0-9]+)")
POWER = re.compile(r"[0-9]e[-+][0-9]", re.IGNORECASE)
SHOWN = 3
"""How many names a message lists at either end of a long list."""

Parts = tuple[tuple[str, ...], tuple[int, ...]]
"""The text of a name around its numbers, and the numbers."""


def natural(path: Path | str) -> tuple[tuple[str | int, ...], str]:
    """Sort key in which the numbers of a name count as numbers: frame_2 comes before frame_10."""
    name = str(path)
    pieces = NUMBER.split(name)
    return tuple(int(piece) if at % 2 else piece.casefold() for at, piece in enumerate(pieces)), name


def in_time(files: Sequence[Path], by_hand: bool) -> list[Path]:
    """The files in the order of time.

    Names that differ in one number alone are put in the order of that number, whatever order they are given in: a shell
    lists frame_10 before frame_2. Files without such a number keep the order in which the user gave them.

    Args:
        files: of the frames, one or more each.
        by_hand: whether the user gave the order of `files`; a folder has none.

    Raises:
        InputError: names that follow several patterns, a number twice, or names that differ in several numbers.
    """
    if len(files) < 2:
        return list(files)
    patterns = {_parts(path)[0] for path in files}
    if by_hand and len(patterns) == len(files):
        return list(files)
    if len(patterns) > 1:
        raise InputError(
            f"the order of these files in time is not clear, their names follow {len(patterns)} patterns: "
            f"{names_of(_examples(files))}; expected names that differ in the number of the frame, or each file by name"
        )
    ordered = sorted(files, key=lambda path: _parts(path)[1])
    _check_numbers(ordered)
    return ordered


def frame_numbers(files: Sequence[Path]) -> list[int] | None:
    """The number of each frame by the names; None where the names differ in no number, or in several."""
    parts = [_parts(path) for path in files]
    columns = list(zip(*(numbers for _, numbers in parts)))
    varying = [column for column in columns if len(set(column)) > 1]
    if len({texts for texts, _ in parts}) > 1 or len(varying) != 1:
        return None
    return list(varying[0])


def missing_numbers(numbers: Sequence[int]) -> str:
    """The whole numbers between those of a list, as text such as "1 to 4, 6"; empty where none is missing."""
    absent = [(low + 1, high - 1) for low, high in pairwise(sorted(numbers)) if high - low > 1]
    return ", ".join(f"{low}" if low == high else f"{low} to {high}" for low, high in absent)


def names_of(names: Sequence[object]) -> str:
    """Names in one line, the middle of a long list left out."""
    short = len(names) <= 2 * SHOWN + 1
    shown = names if short else [*names[:SHOWN], "...", *names[-SHOWN:]]
    return ", ".join(str(getattr(name, "name", name)) for name in shown)


def _parts(path: Path) -> Parts:
    """Text and numbers of a path without its suffix; frames may differ in format."""
    name = path.as_posix().casefold()
    if not path.is_dir():
        # A suffix begins with a letter: what follows the point of t1.5 is a decimal.
        name = re.sub(r"(\.nii)?\.[a-z][a-z0-9]*$", "", name)
    pieces = NUMBER.split(name)
    return tuple(pieces[::2]), tuple(map(int, pieces[1::2]))


def _examples(files: Iterable[Path]) -> list[str]:
    """One name of each pattern."""
    found: dict[tuple[str, ...], str] = {}
    for path in files:
        found.setdefault(_parts(path)[0], path.name)
    return list(found.values())


def _check_numbers(files: Sequence[Path]) -> None:
    """Refuse names whose numbers do not give one order."""
    for one, other in pairwise(files):
        if _parts(one)[1] == _parts(other)[1]:
            raise InputError(f"two files for one frame: {str(one)!r} and {str(other)!r}; expected one for each")
    # A second number may rise with the first, as a time of acquisition does.
    columns = [column for column in zip(*(_parts(path)[1] for path in files)) if len(set(column)) > 1]
    if len(columns) > 1 and any(later <= earlier for column in columns for earlier, later in pairwise(column)):
        raise InputError(
            f"the order of these files in time is not clear, their names differ in {len(columns)} numbers: "
            f"{names_of(files)}; expected the frames of one motion, numbered once"
        )
    _check_decimals(files)


def _check_decimals(files: Sequence[Path]) -> None:
    """Refuse numbers that may be no whole ones: decimals where that matters, as in t1.5 and t1.25, and t1e-3."""
    words = [re.findall(r"(?<=[0-9]\.)[0-9]+", path.stem) for path in files]
    if any(len({len(word) for word in column}) > 1 for column in zip(*words)):
        raise InputError(
            f"the order of these files in time is not clear, the numbers behind the point have different lengths: "
            f"{names_of(files)}; expected as many digits in each"
        )
    if all(POWER.search(path.stem) for path in files):
        raise InputError(
            f"the order of these files in time is not clear, their names hold powers of ten: {names_of(files)}; "
            "expected numbers of frames"
        )
