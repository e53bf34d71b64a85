"""Text in and out: numbers and ranges of a command line or table; text that is safe to show; what `repr` shows."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from textwrap import shorten, wrap
from typing import Any
from unicodedata import category

from quadriform.errors import OptionError


def numbers(text: str, count: int, option: str) -> tuple[int, ...]:
    """Whole numbers between commas.

    Raises:
        OptionError: not `count` of them.
    """
    parts = text.split(",")
    try:
        values = tuple(int(part) for part in parts)
    except ValueError:
        values = ()
    if len(values) != count:
        raise OptionError(f"option {option}={text!r}: expected {count} whole numbers between commas")
    return values


def ranges(text: str, option: str) -> tuple[tuple[int, int], ...]:
    """Three voxel ranges i0:i1,j0:j1,k0:k1.

    Raises:
        OptionError: something else.
    """
    try:
        found = tuple((int(low), int(high)) for low, high in (part.split(":") for part in text.split(",")))
    except ValueError:
        found = ()
    if len(found) != 3 or any(not 0 <= low < high for low, high in found):
        raise OptionError(f"option {option}={text!r}: expected i0:i1,j0:j1,k0:k1 with 0 <= i0 < i1 and so on")
    return found


def plain(text: str) -> str:
    """The text on one line that every file and terminal can hold: control characters and lone surrogates as escapes."""
    return "".join(_escaped(letter) if category(letter) in ("Cc", "Cs", "Zl", "Zp") else letter for letter in text)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")


def short_repr(record: Any) -> str:
    """What `repr` of a data class shows, in a few lines: its numbers, and the shapes of its arrays."""
    shown = [f"{field.name}={_shortened(getattr(record, field.name))}" for field in fields(record) if field.repr]
    return "\n".join(wrap(f"{type(record).__name__}({', '.join(shown)})", 110, subsequent_indent="    ", max_lines=6))


def summary(title: str, *lines: str, most: int = 6) -> str:
    """A title and lines below it, empty ones left out; no more than `most` lines, each of 110 letters or fewer."""
    every = [title, *(f"  {line}" for line in lines if line)]
    kept = every if len(every) <= most else [*every[: most - 1], f"  and {len(every) - most + 1} more"]
    return "\n".join(line if len(line) <= 110 else line[:107] + "..." for line in kept)


def first_of(texts: Sequence[str], most: int) -> str:
    """Return the first `most` texts between commas, and the number of the others."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more


def csv_bytes(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """Return a table as CSV in UTF-8; file names that are no UTF-8 are escaped."""
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator="\n").writerows([header, *rows])
    return stream.getvalue().encode("utf-8", "backslashreplace")


def after_number(unit: str) -> str:
    """The unit as it stands behind a number: nothing where it is not known."""
    return "" if unit == "unknown" else f" {unit}"


def listed(values: Iterable[float]) -> str:
    """Numbers of four digits between commas."""
    return ", ".join(f"{value:.4g}" for value in values)


def _shortened(value: Any) -> str:
    if getattr(value, "ndim", 0):
        return f"[{listed(value)}]" if value.ndim == 1 and len(value) <= 4 else f"array {value.shape}"
    if isinstance(value, str):
        return repr(shorten(value, 60)) if not hasattr(value, "name") else repr(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name!r}: {_shortened(each)}" for name, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"{len(value)} items" if len(value) > 4 else f"({', '.join(map(_shortened, value))})"
    if is_dataclass(value):
        return f"{type(value).__name__}(...)"
    return f"{value:.4g}" if isinstance(value, float) else repr(value)
