"""The list of subjects: a CSV with one row each, checked as a whole before any fit, read a row at a time."""

import csv
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.errors import FileFormatError, InputError, OptionError, choose
from quadriform.files.reading import check_readable, quoted
from quadriform.fitting.options import METHODS, TANGENT_REGULARITIES, check_box, check_strength
from quadriform.imaging.labels import parse_surface
from quadriform.imaging.nifti_forms import AFFINES
from quadriform.words import numbers

if TYPE_CHECKING:
    from quadriform.imaging.ventricle_files import LabelledHeart

ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""Names of folders that are valid on all systems."""
STRATEGIES = ("cycle", "previous")
"""Strategies of `track` that give one moving model."""
READING = ("affine", "columns", "heart")
"""Options that go to the readers of files."""
YES_NO = {"yes": True, "no": False}
Surface = tuple[str, str]
"""Its name, and label:1+2, preset:acdc, or files."""


@dataclass(frozen=True)
class Row:
    """One subject.

    Attributes:
        number: position in the list, from 0.
        id: its name; not part of the repr.
        input: files, patterns or a folder, relative to the folder of the list.
        surfaces: by name, in the order of the row; empty where the files name them or there is one.
        options: of reading and of fit or track, those of the whole cohort included.
    """

    number: int
    id: str = field(repr=False)
    input: tuple[str, ...] = field(repr=False)
    surfaces: tuple[Surface, ...] = field(repr=False)
    options: tuple[tuple[str, Any], ...]

    @property
    def reading(self) -> dict[str, Any]:
        """Options of reading: the transform of NIfTI headers, columns of tables and arrays, labels of a ventricle."""
        given = dict(self.options)
        return {name: given.get(name) for name in READING}


@dataclass(frozen=True)
class Manifest:
    """A list that was checked.

    Attributes:
        path: of the CSV.
        subjects: number of subjects.
        sha256: of the ids in their order.
        box: control points along each axis, the same for all.
        defaults: options of the whole cohort.
    """

    path: Path
    subjects: int
    sha256: str
    box: tuple[int, int, int]
    defaults: Mapping[str, Any]

    @property
    def folder(self) -> Path:
        """The folder to which the paths of the rows are relative."""
        return self.path.absolute().parent

    def rows(self) -> Iterator[Row]:
        """Return the subjects in order, read one at a time."""
        for number, (_, cells) in enumerate(_lines(self.path)):
            yield _row(number, cells, self.defaults)


# --- options ------------------------------------------------------------------------------------------------------


def _yes_no(text: str) -> bool:
    return YES_NO[choose(text, tuple(YES_NO), "yes or no")]


def _strength(text: str) -> float | str:
    value: float | str = text
    with suppress(ValueError):
        value = float(text)
    check_strength(value)
    return value


def _period(text: str) -> float | str | None:
    if text in ("auto", "none"):
        return "auto" if text == "auto" else None
    value = float(text)
    if not 0 < value < float("inf"):
        raise OptionError("expected a time above 0, auto or none")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise OptionError("expected a whole number above 0")
    return int(text)


def _heart(text: str) -> "LabelledHeart":
    from quadriform.imaging.ventricle_files import labelled_heart

    return labelled_heart(_parts(text))


OPTIONS: dict[str, Callable[[str], Any]] = {
    "box": lambda text: check_box(numbers(text, 3, "box")),
    "strength": _strength,
    "regularity": lambda text: choose(text, (*TANGENT_REGULARITIES, "svd", "springs-paper"), "regularity"),
    "robust": _yes_no,
    "method": lambda text: choose(text, METHODS, "method"),
    "iterations": _count,
    "strategy": lambda text: choose(text, STRATEGIES, "strategy"),
    "period": _period,
    "shift_slices": _yes_no,
    "affine": lambda text: choose(text, AFFINES, "affine"),
    "columns": str,
    "heart": _heart,
}
"""Name of an option, which is a column of the list -> parser of its cells."""
COLUMNS = ("id", "input", "surface", *OPTIONS)


def option(name: str, text: str) -> Any:
    """Return the value of an option from its text.

    Raises:
        OptionError: an unknown name, or an invalid value.
    """
    choose(name, tuple(OPTIONS), "option")
    try:
        return OPTIONS[name](text)
    except ValueError as error:  # OptionError is a ValueError
        raise OptionError(f"{name}={text!r}: {error}") from error


# --- rows --------------------------------------------------------------------------------------------------------


def read_manifest(
    path: Path,
    defaults: Mapping[str, Any],
    box: tuple[int, int, int] = (5, 5, 5),
    check: Callable[[Mapping[str, Any]], None] = lambda _options: None,
) -> Manifest:
    """Return the list of subjects after a check of all rows.

    Args:
        path: a CSV in UTF-8, with a header row: id, input and, where needed, surface and options by name.
        defaults: options for rows without their own.
        box: control points along each axis where no option names them.
        check: raises an OptionError for options of a row that cannot be.

    Raises:
        InputError: faulty rows, each with its line number.
        FileFormatError: no such table.
    """
    faults: list[str] = []
    seen: dict[str, int] = {}
    digest = hashlib.sha256()
    common = None
    for number, (line, cells) in enumerate(_lines(path)):
        try:
            row = _row(number, cells, defaults)
            _check_id(row.id, line, seen)
            check(dict(row.options))
            common = _common(dict(row.options).get("box", box), common)
            digest.update(f"{row.id}\n".encode())
        except (OptionError, InputError) as error:
            faults.append(f"line {line}: {error}")
    if faults:
        raise InputError(f"{quoted(path)}: {len(faults)} faulty rows, nothing was fitted: {'; '.join(faults)}")
    if common is None:
        raise FileFormatError(f"{quoted(path)}: expected a row for each subject under the header, found none")
    return Manifest(path, len(seen), digest.hexdigest(), common, dict(defaults))


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells by column."""
    check_readable(path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            header = [name.strip() for name in next(reader, [])]
            _check_header(header, path)
            for cells in reader:
                if any(cell.strip() for cell in cells):
                    yield reader.line_num, _by_column(header, cells)
    except (csv.Error, UnicodeDecodeError) as error:
        raise FileFormatError(f"{quoted(path)}: expected a CSV table in UTF-8: {error}") from error
    except OSError as error:
        raise InputError(f"{quoted(path)}: cannot be read: {error.strerror}") from error


def _check_header(header: list[str], path: Path) -> None:
    where = f"{quoted(path)}, header"
    if len(set(header)) < len(header):
        raise FileFormatError(f"{where}: a column occurs twice: {', '.join(header)}")
    unknown = [name for name in header if name not in COLUMNS]
    if unknown or "id" not in header:
        found = f"the unknown {', '.join(map(repr, unknown))}" if unknown else "none called id"
        raise FileFormatError(f"{where}: expected columns of {', '.join(COLUMNS)}, between commas; found {found}")


def _by_column(header: list[str], cells: list[str]) -> dict[str, str]:
    if len(cells) != len(header):  # reported with the other faulty rows
        return {"": f"expected {len(header)} cells, found {len(cells)}"}
    return {name: cell.strip() for name, cell in zip(header, cells)}


def _row(number: int, cells: Mapping[str, str], defaults: Mapping[str, Any]) -> Row:
    if "" in cells:
        raise InputError(cells[""])
    surfaces = tuple(_surface(text) for text in _parts(cells.get("surface", "")))
    names = [name for name, _ in surfaces]
    if len(set(names)) < len(names):
        raise InputError("surface: expected each name once")
    files = [name for name, rule in surfaces if not is_label(rule)]
    given = _parts(cells.get("input", ""))
    if bool(given) == bool(files) or (files and len(files) < len(surfaces)):
        raise InputError("expected files either as input, or for every surface as NAME=FILES")
    own = {name: option(name, cells[name]) for name in OPTIONS if cells.get(name)}
    options = dict(defaults) | own
    if "heart" in options and (surfaces or "columns" in options):
        raise InputError(f"heart and {'surface' if surfaces else 'columns'} exclude each other; give one")
    return Row(number, cells["id"], given, surfaces, tuple(sorted(options.items())))


def _parts(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(";") if part.strip())


def _surface(text: str) -> Surface:
    name, _, rule = text.partition("=")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name) or not rule:
        raise InputError("surface: expected NAME=label:1+2, NAME=preset:acdc or NAME=FILES, ';' between several")
    if is_label(rule):
        parse_surface(text)
    return name, rule


def is_label(rule: str) -> bool:
    """Return whether the rule of a surface names labels of an image, not files."""
    return rule.startswith(("label:", "preset:"))


def _check_id(name: str, line: int, seen: dict[str, int]) -> None:
    if not ID.fullmatch(name):
        raise InputError("id: expected letters, digits, '.', '_' and '-', the first a letter or digit")
    before = seen.setdefault(name.casefold(), line)
    if before != line:
        raise InputError(f"id: the same as in line {before}")


def _common(box: tuple[int, int, int], first: tuple[int, int, int] | None) -> tuple[int, int, int]:
    if first is not None and box != first:
        raise InputError(f"box {box}: expected {first} as in the rows before, for all results are in one store")
    return box
