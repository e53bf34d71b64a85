"""A document in two arrays of a .npz: its text, in which a shape stands in the place of each array, and all values."""

import io
import json
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError

TEXT, VALUES = "document", "numbers"
SHAPE = "shape"


def packed(document: dict[str, Any]) -> bytes:
    """The bytes of an archive; a list of values, or of such lists, is an array."""
    values: list[NDArray[np.float64]] = []
    text = json.dumps(_without_arrays(document, values), separators=(",", ":"), allow_nan=False)
    stream = io.BytesIO()
    # Two arrays instead of one for each field: every member of an archive costs a header.
    arrays = {TEXT: np.frombuffer(text.encode(), np.uint8), VALUES: np.concatenate(values)}
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def _without_arrays(value: Any, values: list[NDArray[np.float64]]) -> Any:
    if isinstance(value, dict):
        return {name: _without_arrays(each, values) for name, each in value.items()}
    if isinstance(value, list) and _is_array(value):
        array = np.array(value, dtype=np.float64)
        values.append(array.ravel())
        return {SHAPE: list(array.shape)}
    return [_without_arrays(each, values) for each in value] if isinstance(value, list) else value


def _is_array(values: list[Any]) -> bool:
    """Whether a list holds values, or lists of them."""
    while values and isinstance(values[0], list):
        values = values[0]
    return bool(values) and isinstance(values[0], int | float)


class Unpacking:
    """The arrays put back into their places.

    Args:
        values: (k,), all of them.
        where: name of the file, for messages.
    """

    def __init__(self, values: NDArray[Any], where: str) -> None:
        if values.dtype != np.float64 or values.ndim != 1:
            raise FileFormatError(f"{where}: expected one row of float64 as {VALUES}, found {values.dtype}")
        self.values, self.where, self.taken = values, where, 0

    def document(self, text: Any) -> Any:
        """The whole document.

        Raises:
            FileFormatError: shapes and values do not go together.
        """
        found = self._filled(text)
        if self.taken != len(self.values):
            self._refuse(f"{self.taken} values by the shapes in {TEXT}", str(len(self.values)))
        return found

    def _filled(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._filled(each) for each in value]
        if not isinstance(value, dict):
            return value
        if value.keys() == {SHAPE} and isinstance(value[SHAPE], list):  # a surface may have that name too
            return self._array(value[SHAPE])
        return {name: self._filled(each) for name, each in value.items()}

    def _array(self, shape: list[Any]) -> Any:
        if not all(type(length) is int and length >= 0 for length in shape):
            self._refuse("a list of lengths as a shape", repr(shape)[:60])
        start, self.taken = self.taken, self.taken + prod(shape)
        if self.taken > len(self.values):
            self._refuse(f"at least {self.taken} values", str(len(self.values)))
        return self.values[start : self.taken].reshape(shape).tolist()

    def _refuse(self, expected: str, found: str) -> None:
        raise FileFormatError(f"{self.where}: expected {expected}, found {found}")
