"""A value from a document together with its path, so that every refusal names the field."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

import numpy as np

from quadriform.errors import FileFormatError, OptionError
from quadriform.points import Array
from quadriform.words import plain

Built = TypeVar("Built")


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
        raise FileFormatError(f"{self._location}: expected {expected}, found {found or _short(self.value)}")

    def build(self, make: Callable[..., Built], *values: Any, **named: Any) -> Built:
        """What is made of values of this field; where these do not go together, the refusal names the field."""
        try:
            return make(*values, **named)
        except OptionError as error:
            raise FileFormatError(f"{self._location}: {error}") from error

    @property
    def _location(self) -> str:
        """File and field, as messages begin."""
        return f"{self.where}, field {self.path}" if self.path else self.where

    def member(self, name: str) -> "Field":
        """A member of an object; refused when it is missing."""
        if name not in self._object():
            self._at(name, None).refuse("a value", "none: the field is missing")
        return self._at(name, self.value[name])

    def only(self, names: tuple[str, ...]) -> None:
        """Refuse anything but an object, and one with other members than `names`."""
        if unknown := [plain(name)[:80] for name in self._object() if name not in names]:
            self._at(unknown[0], None).refuse(f"only the fields {', '.join(names)}", "this unknown one")

    def _at(self, name: str, value: Any) -> "Field":
        return Field(value, f"{self.path}.{name}" if self.path else name, self.where)

    def _object(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            self.refuse("an object with named fields")
        return self.value

    def items(self) -> list["Field"]:
        """The members of a list."""
        if not isinstance(self.value, list):
            self.refuse("a list")
        return [Field(item, f"{self.path}[{i}]", self.where) for i, item in enumerate(self.value)]

    def optional(self, name: str) -> "Field":
        """A member of an object that was checked, whose value is None where it is missing."""
        return self._at(name, self.value.get(name))

    def members(self) -> dict[str, "Field"]:
        """All members of an object by their names; none where the value is None."""
        members = {} if self.value is None else self._object()
        return {name: self._at(plain(name)[:80], item) for name, item in members.items()}

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
