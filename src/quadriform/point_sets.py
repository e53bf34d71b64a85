"""What may be given as points, each checked once: arrays, tables whose columns have names, meshes, several by name."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.columns import MILLIMETRES, Chosen, Columns, chosen_columns, columns_of
from quadriform.errors import ColumnsError, OptionError, PointsError, WarningKind, Warnings, choose
from quadriform.points import Array, by_name, check_noise, check_points, check_spread, for_each
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.mesh_points import mesh_points
from quadriform.shapes.solid import Solid
from quadriform.words import short_repr

ALONE = "surface"
"""The name of the surface when there is only one."""
UNITS = ("mm", "m", "unknown")
"""That models can have."""
UNIT_NORMAL = 1e-3
"""Rows of three numbers whose length is 1 but for this look like normals."""
FINE_STEP, FINE_SHORT_STEP = 1e-9, 1e-5
"""Smallest steps between neighbouring coordinates that are reported, of a double and of a shorter type, relative to
half the cloud's diagonal."""
FAR, COARSE = 100, 1e-3
"""A cloud this many half-diagonals from the origin, on a decimal grid this coarse, was written with too few digits."""
TYPE_POINTS = 10_000
"""Points whose values show the type they had."""


@dataclass(frozen=True, repr=False)
class PointSet:
    """Points and their properties that the source states.

    Attributes:
        points: (n, 3), in `unit`.
        normals: (n, 3), unit, or zero where a point has none; None where there are none. Signs may be arbitrary.
        unit: of the lengths: "mm", "m", another key of `columns.MILLIMETRES`, or "unknown".
        number_type: of the source; None where it is not known.
        notes: what was assumed, one sentence each.
        noise: covariances (n, 3, 3) of the measurement of each point, in the square of `unit`; None where unknown.
        solid: the body whose surface they are, where its inside is known, as that of a mask or a closed mesh; or None.
        factor: by which lengths in the unit in which the points were given become lengths in `unit`.
    """

    __repr__ = short_repr

    points: Array
    normals: Array | None = None
    unit: str = "unknown"
    number_type: np.dtype[Any] | None = None
    notes: tuple[str, ...] = ()
    noise: Array | None = None
    solid: Solid | None = None
    factor: float = 1.0

    def with_noise(self, noise: Any) -> "PointSet":
        """The points with a noise in the unit in which they were given, as `check_noise` takes it."""
        known = check_noise(noise, len(self.points))
        return replace(self, noise=None if known is None else self.factor**2 * known)

    def take(self, kept: NDArray[np.bool_]) -> "PointSet":
        """The points that are `kept` (n,), with what is known of them."""
        normals, noise = (None if each is None else each[kept] for each in (self.normals, self.noise))
        return replace(self, points=self.points[kept], normals=normals, noise=noise)

    def in_metric_unit(self) -> "PointSet":
        """The points in a unit that models can have: metres stay, other lengths become millimetres, with a note."""
        if self.unit in UNITS:
            return self
        note = f"lengths in {self.unit} became mm"
        factor = MILLIMETRES[self.unit]
        noise = None if self.noise is None else factor**2 * self.noise
        solid = None if self.solid is None else self.solid.scaled(factor)
        notes = (*self.notes, note)
        changed = dict(points=factor * self.points, noise=noise, solid=solid, unit="mm", notes=notes, factor=factor)
        return replace(self, **changed)  # type: ignore[arg-type]


One = ArrayLike | Mesh | PointSet
Given = One | Mapping[str, One]


def point_sets(
    points: Any, columns: Chosen = None, normals: Any = None, weights: object = None, noise: Any = None
) -> dict[str, PointSet]:
    """Checked points by name with what is known of them; a single cloud is called "surface".

    Args:
        points: as `point_set` takes them, or several by name.
        columns: of all of them, as `point_set` takes it.
        normals: (n, 3) in place of those of the points, or by name; None leaves these.
        weights: of the points; None where all count the same.
        noise: as `check_noise` takes it, in place of that of the points, or by name; None leaves these.

    Raises:
        PointsError, DegenerateError, OptionError: a cloud cannot be fitted, or there is none.
    """
    given = by_name(points, "points") if isinstance(points, Mapping) else {ALONE: points}
    if not given:
        raise OptionError("points: an empty mapping; expected at least one named cloud")
    single = given.keys() == {ALONE}
    sets = {n: point_set(cloud, "points" if single else f"{n}: points", columns, weights) for n, cloud in given.items()}
    for each in sets.values():
        check_spread(each.points, needed=11)
    _check_walls(sets)
    if noise is not None:
        known = for_each(sets, noise, "noise")
        sets = {n: each.with_noise(known[n]) for n, each in sets.items()}
    if normals is None:
        return sets
    beside = for_each(sets, normals, "normals")
    return {n: replace(each, normals=unit_normals(beside[n], len(each.points))) for n, each in sets.items()}


def _check_walls(sets: Mapping[str, PointSet]) -> None:
    """Refuse two surfaces that are one, as of labels of a wall that has no voxel.

    Raises:
        PointsError: naming both.
    """
    for (one, a), (other, b) in combinations(sets.items(), 2):
        if np.array_equal(a.points, b.points):
            raise PointsError(
                f"the surfaces {one!r} and {other!r} have the same {len(a.points)} points, so there is no wall between "
                "them; where they come from labels, the outer one needs voxels of the wall too, such as epi=label:1+2"
            )


def point_set(given: Any, what: str = "points", columns: Chosen = None, weights: object = None) -> PointSet:
    """The points, with their normals, unit and number type where these are known.

    Args:
        given: (n, 3); or a structured array, or a data frame, whose columns have names; or (n, k) with `columns`; or a
            mesh (ours, or what has `vertices` and `faces` as one of trimesh), of which the points of its surface are
            taken; or a point set as it is.
        what: the name that an error message uses.
        columns: which columns are x, y, z and the normals, as `chosen_columns` takes it.
        weights: of the points; None where all count the same.

    Raises:
        ColumnsError: columns that are not named x, y and z, where `columns` does not define them.
        OptionError: columns that are not there, or weights beside a mesh, whose points are chosen here.
        PointsError: wrong type or shape, no points, masked or not finite values.
    """
    if isinstance(given, PointSet):
        return given
    if hasattr(given, "vertices") and hasattr(given, "faces"):
        if weights is not None:
            raise OptionError("weights: go with points, found a mesh, of which each part of the area counts the same")
        mesh = _mesh(given)
        points, note = mesh_points(mesh)
        notes = () if note is None else (what.removesuffix("points") + note,)
        return replace(point_set(points, what, columns), notes=notes, solid=Solid.of_mesh(mesh))
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


def _mesh(given: Any) -> Mesh:
    vertices, faces = check_points(given.vertices, "mesh, vertices"), np.asarray(given.faces)
    whole = faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind in "iu"
    if not whole or (faces.size and not 0 <= faces.min() <= faces.max() < len(vertices)):
        raise PointsError(
            f"mesh, faces: expected (m, 3) indices of {len(vertices)} vertices, found {faces.dtype} {faces.shape}"
        )
    return Mesh(vertices, faces.astype(np.int64))


def check_width(array: NDArray[Any], what: str) -> None:
    """Refuse more than three columns without names.

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
        """The columns at three positions, (n, 3)."""
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


def common_unit(sets: Mapping[str, PointSet], unit: str | None = None) -> str:
    """The unit of all clouds: that of their columns, or the one given.

    Raises:
        OptionError: several units, or another one than that of the columns.
    """
    found = {each.unit for each in sets.values()}
    if len(found) > 1:
        raise OptionError(f"points: expected one unit for all clouds, found {' and '.join(sorted(found))}")
    own = found.pop()
    if unit is not None and own not in ("unknown", unit):
        raise OptionError(f"option unit={unit!r} contradicts the names of the columns, which are in {own}")
    return choose(unit or own, UNITS, "unit")


def given_factor(sets: Iterable[PointSet]) -> float:
    """The factor by which lengths in the unit in which points were given become lengths in that which they have.

    Raises:
        OptionError: they were given in several units.
    """
    found = {each.factor for each in sets}
    if len(found) > 1:
        raise OptionError("points: expected one unit for all clouds beside an option that is a length, found several")
    return found.pop()


def points_sha256(clouds: Iterable[Array]) -> str:
    """SHA-256 of points as float64 rows, cloud after cloud; a reader of a file gives the file's own instead."""
    found = hashlib.sha256()
    for cloud in clouds:
        found.update(np.ascontiguousarray(cloud).data)
    return found.hexdigest()


def precision_loss(given: object, points: Array) -> Warnings:
    """PRECISION_LOSS where the step between neighbouring values of the largest coordinate is coarse beside the cloud.

    Digits were lost before the points came: far from the origin, or in a short type. A short type is recognised from
    the type itself, and from the values, because readers and lists give double precision whatever the source had.

    Args:
        given: as the caller gave them, whose type counts: an array, a NumPy type, or anything else, which is judged by
            its values.
        points: (n, 3), the same as float64.
    """
    kind = given if isinstance(given, np.dtype) else getattr(given, "dtype", None)
    if isinstance(kind, np.dtype) and kind.kind != "f":
        return {}
    # the step of floating-point numbers is coarsest at the largest of them
    largest = max(abs(float(points.min())), abs(float(points.max())))
    with np.errstate(over="ignore"):  # a cloud of that size is refused for it
        half = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
    if not 0 < half < np.inf:
        return {}
    name, step, least = _step(kind, points[:: max(1, len(points) // TYPE_POINTS)], largest, half)
    if step / half <= least:
        return {}
    text = (
        f"neighbouring {name} values at {largest:.3g} are {step:.1e} apart, {step / half:.0e} of half the cloud's "
        "diagonal; subtract an offset before they are stored"
    )
    return {WarningKind.PRECISION_LOSS: text}


def _step(kind: object, points: Array, largest: float, half: float) -> tuple[str, float, float]:
    """Name of the type, its step at the largest coordinate, and the least step to report over half the diagonal."""
    with np.errstate(over="ignore"):
        if isinstance(kind, np.dtype) and kind.itemsize < 8:
            return kind.name, float(np.spacing(kind.type(largest))), FINE_SHORT_STEP
        single = float(np.spacing(np.float32(largest)))
        if _are_single(points) and not _decimal_grid(points, 2 * single):  # on a coarser grid single precision is exact
            return "float32", single, FINE_SHORT_STEP
    if largest > FAR * half and (grid := _decimal_grid(points, COARSE * half)):
        return "decimal", grid, COARSE
    return "float64", float(np.spacing(largest)), FINE_STEP


def _are_single(points: Array) -> bool:
    """Whether all coordinates are numbers of single precision, or the shortest texts of such."""
    single = points.astype(np.float32)
    other = points != single
    if not other.any():
        return True
    # numbers that came through a text have the shortest decimals of those of single precision
    values, texts = points[other], np.float64(single[other].astype(str))
    return bool((values == texts).all())


def _decimal_grid(points: Array, least: float) -> float:
    """The largest power of ten, not below `least`, that all coordinates are multiples of; 0 where there is none."""
    if not 1e-300 < least < 1e300:
        return 0.0
    # upwards as long as all coordinates are multiples; zeros alone would be so for ever
    grid, found = float(10.0 ** np.ceil(np.log10(least))), 0.0
    while points.any() and _are_multiples(points, grid):
        grid, found = 10 * grid, grid
    return found


def _are_multiples(points: Array, grid: float) -> bool:
    steps = points / grid
    rounding = 1e-6 + 4 * np.finfo(np.float64).eps * np.abs(steps)
    return bool((np.abs(steps - np.round(steps)) < rounding).all())
