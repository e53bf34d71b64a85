"""Points from files: text tables, NumPy arrays and the vertices of meshes."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from quadriform.columns import Chosen
from quadriform.errors import FileFormatError, OptionError
from quadriform.files.arrays import parse_npy, parse_npz
from quadriform.files.atomic import write_bytes
from quadriform.files.meshes import HEAD, READ_SUFFIXES, parse_mesh
from quadriform.files.metadata import parse_space_and_unit
from quadriform.files.reading import PathLike, quoted, read_bytes, suffix_of, suffix_to_read
from quadriform.files.tables import parse_table, written_table
from quadriform.point_sets import PointSet, point_set
from quadriform.points import Array, check_points

TABLE_SUFFIXES = (".xyz", ".csv", ".txt")
POINT_SUFFIXES = (*TABLE_SUFFIXES, ".npy", ".npz")


def read_points(path: PathLike, columns: Chosen = None) -> Array:
    """The points (n, 3) of a file, in its unit and frame.

    Text (.xyz .csv .txt) is a table with three columns, or whose columns have names; an array (.npy .npz) has three
    columns or fields named x, y and z; a .npz holds one array, or one named `points`; a mesh (.ply .stl .obj .vtp
    .vtk) gives its vertices. Only the names of columns say which they are, see `quadriform.columns`.

    Args:
        path: the file.
        columns: where the names do not say it: names for the columns from left to right, such as "x,y,z,nx,ny,nz";
            where the columns have other names, those of x, y and z, such as "East,North,Height".

    Raises:
        InputError: the file is missing or cannot be read.
        ColumnsError: it is not known which columns are x, y and z.
        OptionError: columns that the file does not have.
        FileFormatError: it is not what its name says, or damaged; text with the line number.
        FileLimitError: it is, or declares to be, beyond the budget.
        PointsError: no points, wrong shape, or not finite values.
    """
    return read_point_set(path, columns).points


def read_point_set(path: PathLike, columns: Chosen = None) -> PointSet:
    """The points of a file, with the unit, the normals and the type of the numbers where it has them.

    Arguments and errors are those of `read_points`.
    """
    suffix = suffix_to_read(path, (*POINT_SUFFIXES, *READ_SUFFIXES), "a file of points")
    data, where = read_bytes(Path(path)), quoted(path)
    if suffix in TABLE_SUFFIXES:
        return parse_table(data, where, columns)
    if suffix == ".npy":
        return point_set(parse_npy(data, where), where, columns)
    if suffix == ".npz":
        return point_set(_only_array(data, where), where, columns)
    # A mesh is left, whose format says which numbers are coordinates.
    if columns is not None:
        raise OptionError(f"{where}: option columns goes with tables and arrays, found a mesh, which names its own")
    return PointSet(parse_mesh(data, suffix, where).vertices, unit=parse_space_and_unit(data[:HEAD])[1])


def write_points(points: ArrayLike, path: PathLike, force: bool = False) -> None:
    """Write points (n, 3) as .xyz or .txt (blanks), .csv (with the header x,y,z,rows), .npy or .npz, all or nothing.

    Text has the fewest digits that give back exactly the same float64. It contains the number of points, which
    `read_points` checks: a .xyz or .txt in its first line, `# points: 40`, a .csv in each row.

    Raises:
        PointsError: not (n, 3), or not finite.
        FileFormatError: another suffix.
        OutputError: the target cannot be written.
    """
    suffix, rows = suffix_of(path, POINT_SUFFIXES, "a file of points"), check_points(points)
    stream = io.BytesIO()
    if suffix == ".npy":
        np.save(stream, rows)
    elif suffix == ".npz":
        np.savez(stream, points=rows)
    else:
        stream.write(written_table(rows, suffix).encode())
    write_bytes(path, stream.getvalue(), force)


def _only_array(data: bytes, where: str) -> np.ndarray:
    arrays = parse_npz(data, where)
    if "points" in arrays:
        return arrays["points"]
    if len(arrays) != 1:
        names = ", ".join(arrays) or "none"
        raise FileFormatError(f"{where}: expected one array, or one named 'points'; found {len(arrays)}: {names}")
    return next(iter(arrays.values()))
