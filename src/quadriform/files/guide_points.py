"""Contour points of the heart as biv-me writes them: GPFile text, a file for each frame, and the planes of the slices.

Reference: https://github.com/UOA-Heart-Mechanics-Research/biv-me
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, InputError, PointsError, choose
from quadriform.files.numbers import to_number
from quadriform.files.reading import PathLike, first_bytes, quoted, read_bytes, utf8_text
from quadriform.points import Array
from quadriform.words import short_repr

Slices = NDArray[np.int64]

COLUMNS = ("x", "y", "z", "contour type", "slice", "weight", "time frame")
"""In the order of files without a header."""
SLICE_NAMES = ("slice", "sliceid", "frameid")
"""What the column of slices, and the field of a SliceInfoFile, is called; frameID is the number of an image."""
SURFACES = {"endo": "LV_ENDOCARDIAL", "epi": "LV_EPICARDIAL"}
"""From our surfaces to the contour types, behind SAX_ for short-axis slices and LAX_ for long-axis ones."""
FILE_NAME = re.compile(r".*GPFile.*\.txt", re.IGNORECASE)
MIN_MITRAL_POINTS = 3
"""As many span a plane."""
BEGINNING = 4096
"""Bytes of a file that show whether it holds guide points."""


@dataclass(frozen=True)
class _Row:
    kind: str
    point: tuple[float, ...]
    slice: int
    weight: float
    time: str
    """As it is written; empty where there is no such column."""


@dataclass(frozen=True, repr=False)
class GuidePoints:
    """Contour points of one frame.

    Attributes:
        points: from the contour type, as in the file, to its points (n, 3), LPS mm, in the order of the file.
        slices: from the contour type to the number of the slice of each point, (n,).
        weights: from the contour type to the weight of each point, (n,).
        frame: its number: that of the file's name, or of the column of time where a file holds several.
    """

    __repr__ = short_repr

    points: Mapping[str, Array]
    slices: Mapping[str, Slices]
    weights: Mapping[str, Array]
    frame: int

    def surface(self, name: str) -> tuple[Array, Slices]:
        """Points (n, 3), LPS mm, and slice numbers (n,) of the left ventricle's short-axis, then long-axis contours.

        Points of weight 0 are left out.

        Args:
            name: "endo" or "epi".

        Raises:
            OptionError: another name.
            PointsError: the file has no such contour.
        """
        contour = SURFACES[choose(name, tuple(SURFACES), "surface")]
        if not self.has(name):
            raise PointsError(f"frame {self.frame}: no points of {contour}; found {', '.join(sorted(self.points))}")
        # Short-axis contours come first, so that slice numbers and points correspond.
        kinds = [kind for kind in (f"SAX_{contour}", f"LAX_{contour}") if kind in self.points]
        counts = np.concatenate([self.weights[kind] for kind in kinds]) > 0
        return (
            np.concatenate([self.points[kind] for kind in kinds])[counts],
            np.concatenate([self.slices[kind] for kind in kinds])[counts],
        )

    def has(self, name: str) -> bool:
        """Whether there are points of a weight above 0 on the surface "endo" or "epi"."""
        return any((self.weights.get(f"{axis}_{SURFACES[name]}", np.empty(0)) > 0).any() for axis in ("SAX", "LAX"))

    @property
    def has_any(self) -> bool:
        """Whether there are such points on any of the surfaces."""
        return any(map(self.has, SURFACES))

    @property
    def mitral(self) -> Array:
        """Points (n, 3) of the mitral ring; n may be 0."""
        return self._of("MITRAL_VALVE")

    @property
    def rv_inserts(self) -> Array:
        """Points (n, 3) where the right ventricle's wall meets the left's; n may be 0."""
        return self._of("RV_INSERT")

    @property
    def apex(self) -> Array:
        """Points (n, 3) of the apex; n may be 0."""
        return self._of("APEX_POINT")

    def _of(self, kind: str) -> Array:
        return self.points.get(kind, np.empty((0, 3)))


def is_guide_points(path: Path) -> bool:
    """Whether a file holds contour points of the heart, by its name or by its first lines."""
    if path.suffix.lower() != ".txt" or not path.is_file():
        return False
    if FILE_NAME.fullmatch(path.name):
        return True
    text = first_bytes(path, BEGINNING).decode("utf-8-sig", errors="replace")
    first = next((line for line in text.splitlines() if line.strip()), "")
    fields = fields_of(first)
    return "contourtype" in map(plain, fields) or (
        len(fields) == len(COLUMNS) and re.fullmatch(r"[A-Z][A-Z_]+", fields[3]) is not None
    )


def read_guide_points(path: PathLike, frame: int | None = None) -> GuidePoints:
    """The contour points of one frame of a GPFile: x y z, contour type, slice, weight and time in columns.

    A header names the columns; without one they are in this order. Fields stand between tabs, or between blanks.

    Args:
        path: the file, as GPFile_000.txt.
        frame: which one, where the file holds several.

    Raises:
        InputError: the file is missing or cannot be read, or holds several frames and none is chosen, or not that one.
        FileFormatError: not such a file; with the line, what was expected and what was found.
        FileLimitError: beyond the budget.
    """
    frames = _read_frames(Path(path))
    numbers = [found.frame for found in frames]
    if frame is None and len(frames) == 1:
        return frames[0]
    if frame not in numbers:
        raise InputError(
            f"{quoted(path)}: holds the time frame{'s'[: len(numbers) > 1]} {', '.join(map(str, numbers))}; "
            f"{'choose one' if frame is None else f'there is no frame {frame}'}, or follow them all as a motion"
        )
    return frames[numbers.index(frame)]


def read_guide_point_frames(source: PathLike | Sequence[PathLike]) -> list[GuidePoints]:
    """The frames of a folder of GPFiles, of one GPFile or of a list of them, in the order of their numbers.

    A frame without a file is not in the list: the numbers of the others are their times.

    Raises:
        InputError: as `guide_point_files`, or a frame is there twice.
        FileFormatError, FileLimitError: as `read_guide_points`.
    """
    sources = [source] if isinstance(source, str | os.PathLike) else list(source)
    single = len(sources) == 1 and not Path(sources[0]).is_file()
    files = guide_point_files(sources[0]) if single else [Path(one) for one in sources]
    found = [(frame.frame, file, frame) for file in files for frame in _read_frames(file)]
    found.sort(key=lambda each: each[0])
    for (number, file, _), (other, second, _) in pairwise(found):
        if number == other:
            raise InputError(f"frame {number} is in two files, {quoted(file)} and {quoted(second)}; expected it once")
    return [frame for _, _, frame in found]


def guide_point_files(folder: PathLike) -> list[Path]:
    """The GPFiles of a folder, in the order of their frames.

    Raises:
        InputError: no folder, no such file, or the same frame in several files.
    """
    if not Path(folder).is_dir():
        raise InputError(f"{quoted(folder)}: expected a folder of files GPFile_NNN.txt")
    files = sorted((_number_of(file) or 0, file) for file in Path(folder).iterdir() if FILE_NAME.fullmatch(file.name))
    if not files:
        raise InputError(f"{quoted(folder)}: no files GPFile_NNN.txt in this folder")
    frames = [frame for frame, _ in files]
    if twice := sorted({file.name for frame, file in files if frames.count(frame) > 1}):
        raise InputError(f"{quoted(folder)}: the same frame in several files: {', '.join(twice)}")
    return [file for _, file in files]


# --- lines ---------------------------------------------------------------------------------------------------------


def lines_of(data: bytes, where: str, split: Callable[[str], list[str]]) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and fields, blank lines left out."""
    for number, line in enumerate(utf8_text(data, where).splitlines(), 1):
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
    number = to_number(word)
    return number is not None and math.isfinite(number)


def _rows(path: Path) -> list[_Row]:
    where = quoted(path)
    lines = list(lines_of(read_bytes(path), where, fields_of))
    columns: Sequence[str] = COLUMNS
    if lines and not all(is_number(field) for field in lines[0][1][:3]):
        columns = _header(lines[0][1], f"{where}, line {lines[0][0]}")
        lines = lines[1:]
    if not lines:
        raise FileFormatError(f"{where}: no points in it; expected {' | '.join(COLUMNS)} in each line")
    return [_row(fields, columns, f"{where}, line {number}") for number, fields in lines]


def _header(fields: list[str], where: str) -> list[str]:
    """Which of our columns each field names."""
    known = {plain(name): name for name in COLUMNS} | dict.fromkeys(SLICE_NAMES, "slice")
    found = [known.get(plain(field), "") for field in fields]
    needed = set(COLUMNS) - {"time frame"}
    if "" in found or len(set(found)) < len(found) or not needed <= set(found):
        raise FileFormatError(
            f"{where}: expected the columns {' | '.join(COLUMNS)} (the slice may be called sliceID or frameID), "
            f"found {fields}"
        )
    return found


def _row(fields: list[str], columns: Sequence[str], where: str) -> _Row:
    if len(fields) != len(columns):
        raise FileFormatError(f"{where}: expected {len(columns)} fields, found {len(fields)}")
    cell = dict(zip(columns, fields))
    kind, weight, time = cell["contour type"], number_in(cell["weight"], where), cell.get("time frame", "")
    if not kind or is_number(kind):
        raise FileFormatError(f"{where}: expected a contour type, found {kind!r}")
    if weight < 0:
        raise FileFormatError(f"{where}: expected a weight of 0 or more, found {cell['weight']!r}")
    if time:
        number_in(time, where, whole=True)
    point = tuple(number_in(cell[name], where) for name in "xyz")
    return _Row(kind, point, int(number_in(cell["slice"], where, whole=True)), weight, time)


# --- frames ------------------------------------------------------------------------------------------------------


def _read_frames(path: Path) -> list[GuidePoints]:
    """The frames of one file, in the order of their numbers.

    1. One time, or none: one frame.
    2. Several times, and a contour of one slice is there at two of them: a frame for each time. Refused where times are
       written in two forms, 1 and 1.0, since biv-me itself writes 1.0 in all rows of some slices, whatever their frame.
    3. Several times, no such contour, and the file's name ends with a number or times are written in two forms: one
       frame, as biv-me reads it.
    4. Several times, no such contour, no number in the name, and one form: a frame for each time.

    The number of a single frame is that of the name, else the most common time, else 0.
    """
    rows, number = _rows(path), _number_of(path)
    times = Counter(int(float(row.time)) for row in rows if row.time)
    again, forms = _drawn_again(rows), _time_forms(rows)
    if len(times) < 2 or (not again and (number is not None or len(forms) > 1)):
        common = times.most_common(1)[0][0] if times else 0
        return [_frame(rows, common if number is None else number)]
    if len(forms) > 1:
        found = "; ".join(f"as {form} in the slices {', '.join(map(str, sorted(at)))}" for form, at in forms.items())
        raise FileFormatError(
            f"{quoted(path)}: holds several time frames, and their numbers are written in {len(forms)} forms "
            f"({found}): it is not clear of which frame each row is; expected one file for each frame, or one form"
        )
    return [_frame([row for row in rows if int(float(row.time)) == time], time) for time in sorted(times)]


def _drawn_again(rows: Sequence[_Row]) -> bool:
    """Whether a contour of one slice is there at several times."""
    seen: dict[tuple[str, int], int] = {}
    times = ((row.kind, row.slice, int(float(row.time or "0"))) for row in rows)
    return any(seen.setdefault((kind, number), time) != time for kind, number, time in times)


def _time_forms(rows: Sequence[_Row]) -> dict[str, set[int]]:
    """From how times are written to the slices where they are."""
    forms = defaultdict(set)
    for row in rows:
        forms["1.0" if "." in row.time else "1" if row.time else "nothing"].add(row.slice)
    return forms


def _frame(rows: Sequence[_Row], number: int) -> GuidePoints:
    by_kind: dict[str, list[_Row]] = defaultdict(list)
    for row in rows:
        by_kind[row.kind].append(row)
    return GuidePoints(
        {kind: np.array([row.point for row in found]) for kind, found in by_kind.items()},
        {kind: np.array([row.slice for row in found], dtype=np.int64) for kind, found in by_kind.items()},
        {kind: np.array([row.weight for row in found]) for kind, found in by_kind.items()},
        number,
    )


def _number_of(path: Path) -> int | None:
    """The number at the end of a file's name."""
    found = re.search(r"([0-9]+)$", path.stem)
    return int(found[1]) if found else None
