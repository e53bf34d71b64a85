"""Triangle meshes in and out. The frame and the unit travel in the header wherever the format has room."""

import os
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError, OutputError
from quadriform.files.atomic import write_bytes
from quadriform.files.legacy_vtk import parse_legacy_vtk
from quadriform.files.metadata import check_marks, parse_marks, parse_record
from quadriform.files.obj import parse_obj
from quadriform.files.ply import parse_ply
from quadriform.files.polygons import Polygons
from quadriform.files.reading import quoted, read_bytes, suffix_of, suffix_to_read
from quadriform.files.stl import parse_stl
from quadriform.files.vtp import encode_vtp, parse_vtp
from quadriform.points import check_points
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.record import ModelRecord

MESH_SUFFIXES = (".ply", ".stl", ".obj", ".vtp")

READERS: dict[str, Callable[[bytes, str], Polygons]] = {
    ".ply": parse_ply,
    ".stl": parse_stl,
    ".obj": parse_obj,
    ".vtp": parse_vtp,
    ".vtk": parse_legacy_vtk,
}
"""From the suffix to the reader: (content of the file, its name in messages) -> polygons."""
READ_SUFFIXES = tuple(READERS)
STL_HEAD = 80
"""Bytes of the header of a binary STL."""
HEAD = 4096
"""Bytes in which the marks stand, when there are any."""
SINGLE = 1e-5
"""Vertices may move by this share of the mesh's extent when a format stores single precision."""


def write_mesh(
    mesh: Mesh,
    path: str | os.PathLike[str],
    space: str = "unknown",
    unit: str = "unknown",
    force: bool = False,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write a mesh as .ply, .stl, .obj or .vtp, all or nothing.

    The comment (.ply, .obj), the header (.stl) or the field data (.vtp) carries `SPACE=` and `UNIT=`. STL
    holds single precision, PLY too unless that would move vertices by more than 1e-5 of the extent (then double
    precision), OBJ nine digits of the extent, VTP the very same numbers.

    Args:
        mesh: the triangles.
        path: where to; its suffix chooses the format.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        force: replace an existing file.
        more: other words that the file carries beside frame and unit, such as `ModelRecord.marks`.

    Raises:
        FileFormatError: another suffix.
        OutputError: the target cannot be written, or single precision would spoil an STL.
    """
    suffix = suffix_of(path, MESH_SUFFIXES, "a mesh")
    write_bytes(path, encode_mesh(mesh, suffix, space, unit, more), force)


def encode_mesh(mesh: Mesh, suffix: str, space: str, unit: str, more: Mapping[str, str] | None = None) -> bytes:
    """The bytes of a mesh file; arguments as for `write_mesh`.

    Raises:
        OptionError: a frame or unit that no file can carry.
        OutputError: single precision would spoil an STL.
    """
    check_marks(space, unit)
    marks = {"SPACE": space, "UNIT": unit} | dict(more or {})
    if suffix == ".vtp":
        return encode_vtp(mesh, marks)
    note = " ".join(f"{name}={value}" for name, value in marks.items())
    if suffix == ".obj":
        return _encode_obj(mesh, note)
    moved = _moved_by_single_precision(mesh)
    fits_single = bool(moved <= SINGLE * np.ptp(mesh.vertices, axis=0).max())
    if suffix == ".ply":
        return _encode_ply(mesh, note, fits_single)
    if not fits_single:
        raise OutputError(
            f".stl stores single precision, which would move vertices by {moved:.3g} so far from the origin; "
            "write .ply, .vtp or .obj instead"
        )
    content: bytes = _to_trimesh(mesh).export(file_type="stl")
    return _head_of_stl(note) + content[STL_HEAD:]


def _head_of_stl(note: str) -> bytes:
    """The header of 80 bytes, with as many whole words of a note, and members of a list, as it has room for."""
    whole = re.match(rf".{{0,{STL_HEAD}}}(?=[ ,]|$)", note)
    return (whole[0] if whole else "").encode().ljust(STL_HEAD)


def _encode_ply(mesh: Mesh, note: str, fits_single: bool) -> bytes:
    """Binary PLY with vertices in single precision where that holds them, else in double precision."""
    number = "float" if fits_single else "double"
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {note}",
        f"element vertex {len(mesh.vertices)}",
        *(f"property {number} {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    faces = np.empty(len(mesh.faces), dtype=[("corners", "u1"), ("index", "<i4", 3)])
    faces["corners"], faces["index"] = 3, mesh.faces
    vertices = mesh.vertices.astype("<f4" if fits_single else "<f8")
    return ("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes()


def _to_trimesh(mesh: Mesh) -> Any:
    import trimesh

    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def _encode_obj(mesh: Mesh, note: str) -> bytes:
    from trimesh.exchange.obj import export_obj

    extent = float(np.ptp(mesh.vertices, axis=0).max()) or 1.0
    digits = max(0, 8 - int(np.floor(np.log10(extent))))  # decimals: metres need more of them than millimetres
    text: str = export_obj(_to_trimesh(mesh), include_normals=False, digits=digits, header=note)
    return (text.rstrip("\n") + "\n").encode()


def _moved_by_single_precision(mesh: Mesh) -> float:
    """The largest change of a coordinate by rounding to single precision; infinite where it overflows."""
    with np.errstate(over="ignore"):
        return float(np.abs(mesh.vertices.astype(np.float32) - mesh.vertices).max(initial=0.0))


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Return the triangles of a .ply, .stl, .obj, .vtp or legacy .vtk file.

    Polygons with more corners are divided into triangles over the same area. Corners of an STL are one vertex where
    they are equal, or, where that leaves the surface open, where they differ by rounding.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not what its name says, damaged, or without triangles.
        FileLimitError: it is, or promises to be, beyond the budget.
        PointsError: vertices that are not finite.
    """
    mesh = read_mesh_or_points(path)
    if len(mesh.faces) == 0:
        found = f"found {len(mesh.vertices)} vertices without any"
        raise FileFormatError(f"{quoted(path)}: expected a mesh with triangles, {found}")
    return mesh


def read_mesh_or_points(path: str | os.PathLike[str]) -> Mesh:
    """The same for points in a mesh format, too: a mesh without triangles."""
    suffix = suffix_to_read(path, READ_SUFFIXES, "a mesh")
    return parse_mesh(read_bytes(path), suffix, quoted(path))


def parse_mesh(data: bytes, suffix: str, where: str) -> Mesh:
    """The vertices and triangles of the content of a mesh file; of points in a mesh format no triangles.

    Raises:
        FileFormatError: not what its suffix says, or damaged.
        FileLimitError: the header promises more than the budget.
        PointsError: vertices that are not finite.
    """
    polygons = READERS[suffix](data, where)
    if len(polygons.vertices) == 0:
        raise FileFormatError(f"{where}: expected vertices x y z, found none")
    check_points(polygons.vertices, where)
    return Mesh(polygons.vertices, polygons.triangles(where))


def read_marks(path: str | os.PathLike[str]) -> tuple[str, str]:
    """Frame and unit ("unknown" where it has none) that a mesh file is marked with.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    return parse_marks(read_bytes(path)[:HEAD])


def read_record(path: str | os.PathLike[str]) -> ModelRecord | None:
    """Status and kinds of warnings of the fit that a mesh file is marked with; None where it is not.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    return parse_record(read_bytes(path)[:HEAD])
