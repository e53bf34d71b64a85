"""Points with what is known of them, from whatever holds numbers in columns: arrays, structured arrays, data frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.columns import MILLIMETRES, Chosen, Columns, chosen_columns, columns_of
from quadriform.errors import ColumnsError, PointsError
from quadriform.points import Array, check_points
from quadriform.words import short_repr

UNIT_NORMAL = 1e-3
"""Rows of three numbers whose length is 1 but for this look like normals."""


@dataclass(frozen=True, repr=False)
class PointSet:
    """Points and their properties that the source states.

    Attributes:
        points: (n, 3), in `unit`.
        normals: (n, 3), unit, or zero where a point has none; None where there are none. Signs may be arbitrary.
        unit: of the lengths: "mm", "m", another key of `columns.MILLIMETRES`, or "unknown".
        number_type: of the source; None where it is not known.
        notes: what was assumed, one sentence each.
    """

    __repr__ = short_repr

    points: Array
    normals: Array | None = None
    unit: str = "unknown"
    number_type: np.dtype[Any] | None = None
    notes: tuple[str, ...] = ()

    def in_metric_unit(self) -> "PointSet":
        """The same in a unit that models can have: metres stay, other lengths become millimetres, which is noted."""
        if self.unit in ("mm", "m", "unknown"):
            return self
        note = f"lengths in {self.unit} became mm"
        points = self.points * MILLIMETRES[self.unit]
        return replace(self, points=points, unit="mm", notes=(*self.notes, note))


def point_set(given: Any, what: str = "points", columns: Chosen = None) -> PointSet:
    """The points, with their normals, unit and number type where these are known.

    Args:
        given: (n, 3); or a structured array, or a data frame, whose columns have names; or (n, k) with `columns`; or a
            point set as it is.
        what: the name that an error message uses.
        columns: which columns are x, y, z and the normals, as `chosen_columns` takes it.

    Raises:
        ColumnsError: columns that are not named x, y and z, where `columns` does not define them.
        OptionError: columns that are not there.
        PointsError: wrong type or shape, no points, masked or not finite values.
    """
    if isinstance(given, PointSet):
        return given
    names = column_names(given)
    if names is None and columns is None:
        array = given if isinstance(given, np.ndarray) else _array(given, what)
        check_width(array, what)
        return PointSet(check_points(array, what), number_type=_type(array))
    table = _array(given, what) if names is None else given
    width = len(names) if names is not None else table.shape[1] if table.ndim == 2 else 0
    if names is None and width < 3:
        raise PointsError(f"{what}: expected an array of shape (n, 3) or more columns, found {table.shape}")
    chosen = columns_of(names or [], what) if columns is None else chosen_columns(columns, names, width, what)
    return _picked(table, names, chosen, what)


def check_width(array: NDArray[Any], what: str) -> None:
    """Refuse more than three columns whose names nobody knows.

    Raises:
        ColumnsError: saying what the columns look like, and how to name them.
    """
    if array.ndim == 2 and array.shape[1] > 3 and array.dtype.kind in "iuf" and len(array) != 3:
        raise ColumnsError(
            f"{what}: expected an array of shape (n, 3), found {array.shape}, whose columns have no names"
            + naming_hint(array)
        )


def naming_hint(array: NDArray[Any]) -> str:
    """A hint for columns (n, k) without names: how to name them, and what they look like."""
    how, looks = "x,y,z,...", ""
    if array.shape[1] >= 6 and _are_unit(array[:, -3:]):
        before = ",".join(["x", "y", "z"] + ["_"] * (array.shape[1] - 6))
        how, looks = f"{before},nx,ny,nz", "the last three look like unit normals"
    elif array.shape[1] == 4 and len(array) > 1 and (np.diff(array[:, 0]) == 1).all():
        how, looks = "index,x,y,z", "the first looks like a running number"
    return f"; {looks + ': ' if looks else ''}name them from left to right by --columns {how} (columns= in Python)"


def column_names(given: Any) -> list[str] | None:
    """The names of the columns of a structured array or a data frame, else None; (n, 3) fields are three columns."""
    dtype = getattr(given, "dtype", None)
    if isinstance(dtype, np.dtype) and dtype.names is not None:
        return [name for field in dtype.names for name in _field_names(field, dtype[field])]
    if not hasattr(given, "columns") or not hasattr(given, "__getitem__"):
        return None
    names = list(given.columns)
    numbered = all(isinstance(name, int | np.integer) for name in names)  # what pandas calls columns without names
    return None if numbered else [str(name) for name in names]


def _field_names(field: str, dtype: np.dtype[Any]) -> list[str]:
    return [field] if dtype.subdtype is None else [f"{field}:{k}" for k in range(int(np.prod(dtype.shape)))]


def _picked(table: Any, names: Sequence[str] | None, chosen: Columns, what: str) -> PointSet:
    def taken(positions: tuple[int, int, int]) -> NDArray[Any]:
        columns = [table[:, position] if names is None else _column(table, position, what) for position in positions]
        return np.stack(columns, axis=1)

    points = taken(chosen.points)
    normals = None if chosen.normals is None else unit_normals(taken(chosen.normals), len(points), f"{what}: normals")
    notes = (chosen.note,) if chosen.note else ()
    return PointSet(check_points(points, what), normals, chosen.unit, _type(points), notes)


def _column(table: Any, position: int, what: str) -> NDArray[Any]:
    """One column (n,) of a structured array or a data frame."""
    if isinstance(getattr(table, "dtype", None), np.dtype):
        if np.ndim(table) != 1:
            raise PointsError(f"{what}: expected one row of records, found shape {np.shape(table)}")
        return _flat([np.asarray(table[field]).reshape(len(table), -1) for field in table.dtype.names], position)
    column = np.asarray(table[list(table.columns)[position]])
    if column.ndim != 1 or column.dtype.kind not in "iuf":
        name = str(list(table.columns)[position])
        raise PointsError(f"{what}: expected real numbers in column {name!r}, found type {column.dtype}")
    return column


def _flat(columns: Sequence[NDArray[Any]], position: int) -> NDArray[Any]:
    """The column at a position of fields (n, k) side by side."""
    for column in columns:
        if position < column.shape[1]:
            return column[:, position]
        position -= column.shape[1]
    raise IndexError(position)


def unit_normals(given: ArrayLike, n: int, what: str = "normals") -> Array:
    """Return normals (n, 3) of length 1; zero, which means that a point has none, stays.

    Raises:
        PointsError: another shape, or not finite values.
    """
    normals = check_points(given, what)
    if len(normals) != n:
        raise PointsError(f"{what}: expected one for each of {n} points, found {len(normals)}")
    largest = np.abs(normals).max(axis=1, keepdims=True)  # squares of small numbers would vanish
    scaled = normals / np.where(largest > 0, largest, 1)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(length > 0, length, 1)


def _are_unit(rows: NDArray[Any]) -> bool:
    lengths = np.linalg.norm(rows.astype(np.float64), axis=1)
    return bool(len(rows) and np.median(np.abs(lengths - 1)) < UNIT_NORMAL)


def _array(given: Any, what: str) -> NDArray[Any]:
    try:
        return given if isinstance(given, np.ma.MaskedArray) else np.asarray(given)
    except ValueError as error:
        raise PointsError(f"{what}: rows of unequal length; expected (n, 3)") from error


def _type(array: NDArray[Any]) -> np.dtype[Any] | None:
    """The type of the numbers, where it adds to their values; that of lists and readers does not."""
    return array.dtype if array.dtype.kind in "iuf" and array.dtype != np.float64 else None
