"""A value from a document together with its path, so that every refusal names the field."""

import math
import re
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.points import Array
from quadriform.words import plain


@dataclass(frozen=True)
class Field:
    """One value of a document made of dicts, lists, numbers and strings.

    Attributes:
        value: what stands there.
        path: where, such as `surfaces[0].semi_axes`; empty for the document itself.
        where: how error messages name the file.
    """

    value: Any
    path: str
    where: str

    def refuse(self, expected: str, found: str | None = None) -> NoReturn:
        """Raise the one error: file, field, what was expected, what was found."""
        what = f", field {self.path}" if self.path else ""
        raise FileFormatError(f"{self.where}{what}: expected {expected}, found {found or _short(self.value)}")

    def member(self, name: str) -> "Field":
        """A member of an object; refused when it is missing."""
        if not isinstance(self.value, dict):
            self.refuse("an object with named fields")
        path = f"{self.path}.{name}" if self.path else name
        if name not in self.value:
            Field(None, path, self.where).refuse("a value", "none: the field is missing")
        return Field(self.value[name], path, self.where)

    def only(self, names: tuple[str, ...]) -> None:
        """Refuse anything but an object, and one with other members than `names`."""
        if not isinstance(self.value, dict):
            self.refuse("an object with named fields")
        unknown = [plain(name) for name in self.value if name not in names]
        if unknown:
            path = f"{self.path}.{unknown[0]}" if self.path else unknown[0]
            Field(None, path[:80], self.where).refuse(f"only the fields {', '.join(names)}", "this unknown one")

    def items(self) -> list["Field"]:
        """The members of a list."""
        if not isinstance(self.value, list):
            self.refuse("a list")
        return [Field(item, f"{self.path}[{i}]", self.where) for i, item in enumerate(self.value)]

    def optional(self, name: str) -> "Field":
        """A member of an object that was checked, whose value is None where it is missing."""
        path = f"{self.path}.{name}" if self.path else name
        return self.member(name) if name in self.value else Field(None, path, self.where)

    def members(self) -> dict[str, "Field"]:
        """All members of an object by their names; none where the value is None."""
        if self.value is None:
            return {}
        if not isinstance(self.value, dict):
            self.refuse("an object with named fields")
        return {name: Field(item, f"{self.path}.{plain(name)[:80]}", self.where) for name, item in self.value.items()}

    def text(self) -> str:
        """A string that UTF-8 can hold."""
        if not isinstance(self.value, str):
            self.refuse("a text")
        if any("\ud800" <= letter <= "\udfff" for letter in self.value):
            self.refuse("a text without halves of surrogate pairs")
        return self.value

    def line(self) -> str:
        """A string on one line, without control characters."""
        if self.text() != plain(self.text()):
            self.refuse("a text on one line without control characters")
        return self.text()

    def matching(self, pattern: re.Pattern[str], expected: str) -> str:
        """A string that a pattern matches as a whole."""
        if not pattern.fullmatch(self.text()):
            self.refuse(expected)
        return self.text()

    def choice(self, choices: tuple[str, ...]) -> str:
        """A string out of a few."""
        if self.value not in choices:
            self.refuse(f"one of {', '.join(map(repr, choices))}")
        return self.text()

    def whole(self) -> int:
        """A whole number."""
        if type(self.value) is not int:
            self.refuse("a whole number")
        return self.value

    def number(self) -> float:
        """A finite number."""
        try:
            value = float(self.value) if type(self.value) in (int, float) else math.nan
        except OverflowError:  # whole numbers have no bound in Python
            value = math.inf
        if not math.isfinite(value):
            self.refuse("a finite number")
        return value

    def numbers(self, shape: tuple[int | None, ...]) -> Array:
        """Nested lists of finite numbers as an array; None in `shape` stands for any length.

        Raises:
            FileFormatError: another shape, ragged, or something that is no finite number.
        """
        if shape[0] is not None and len(self.items()) != shape[0]:
            self.refuse(f"{shape[0]} items", str(len(self.items())))
        if len(shape) == 1:
            return np.array([item.number() for item in self.items()])
        rows = [item.numbers(shape[1:]) for item in self.items()]
        if len({row.shape for row in rows}) != 1:
            self.refuse("rows of one shape", f"shapes {sorted({row.shape for row in rows})}")
        return np.stack(rows)


def _short(value: object) -> str:
    if isinstance(value, dict | list):
        return f"a {'list' if isinstance(value, list) else 'group of fields'} of {len(value)}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
