"""Reading and writing of triangle meshes, with frame and unit in the header where the format allows it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from quadriform.errors import FileFormatError
from quadriform.files.atomic import write_bytes
from quadriform.files.legacy_vtk import parse_legacy_vtk
from quadriform.files.metadata import check_space_and_unit, parse_record, parse_space_and_unit
from quadriform.files.obj import encode_obj, parse_obj
from quadriform.files.ply import encode_ply, parse_ply
from quadriform.files.polygons import Polygons
from quadriform.files.reading import PathLike, quoted, read_bytes, suffix_of, suffix_to_read
from quadriform.files.stl import encode_stl, parse_stl
from quadriform.files.vtk_xml import encode_vtp, parse_vtp
from quadriform.points import check_points
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.record import ModelRecord

HEAD = 4096
"""Bytes at the start of a file that contain its metadata, if there is any."""


@dataclass(frozen=True)
class MeshFormat:
    """A format of meshes: polygons are read, and triangles written.

    Attributes:
        suffix: in lower case, with its dot.
        parse: (content of a file, its name in messages) -> polygons. It raises `FileFormatError` for a content
            that is not of this format.
        encode: (mesh, metadata by name, such as SPACE and UNIT) -> content; None for formats that are only read.
    """

    suffix: str
    parse: Callable[[bytes, str], Polygons]
    encode: Callable[[Mesh, Mapping[str, str]], bytes] | None = None


FORMATS = {
    each.suffix: each
    for each in (
        MeshFormat(".ply", parse_ply, encode_ply),
        MeshFormat(".stl", parse_stl, encode_stl),
        MeshFormat(".obj", parse_obj, encode_obj),
        MeshFormat(".vtp", parse_vtp, encode_vtp),
        MeshFormat(".vtk", parse_legacy_vtk),
    )
}
ENCODERS = {suffix: each.encode for suffix, each in FORMATS.items() if each.encode is not None}
WRITE_SUFFIXES = tuple(ENCODERS)
READ_SUFFIXES = tuple(FORMATS)


def write_mesh(
    mesh: Mesh,
    path: PathLike,
    space: str = "unknown",
    unit: str = "unknown",
    force: bool = False,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write a mesh as .ply, .stl, .obj or .vtp, all or nothing.

    The comment (.ply, .obj), the header (.stl) or the field data (.vtp) carries `SPACE=` and `UNIT=`. STL
    holds single precision, PLY too unless that would move vertices by more than 1e-5 of the extent (then double
    precision), OBJ nine digits of the extent, VTP the coordinates exactly.

    Args:
        mesh: the triangles.
        path: where to; its suffix chooses the format.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        force: replace an existing file.
        more: other words that the file carries beside frame and unit, such as `ModelRecord.metadata`.

    Raises:
        FileFormatError: another suffix.
        OutputError: the target cannot be written, or single precision would spoil an STL.
    """
    suffix = suffix_of(path, WRITE_SUFFIXES, "a mesh")
    write_bytes(path, encode_mesh(mesh, suffix, space, unit, more), force)


def encode_mesh(mesh: Mesh, suffix: str, space: str, unit: str, more: Mapping[str, str] | None = None) -> bytes:
    """The bytes of a mesh file; arguments as for `write_mesh`.

    Raises:
        OptionError: a frame or unit that no file can carry.
        OutputError: single precision would move vertices of an STL.
    """
    check_space_and_unit(space, unit)
    return ENCODERS[suffix](mesh, {"SPACE": space, "UNIT": unit} | dict(more or {}))


def read_mesh(path: PathLike) -> Mesh:
    """Return the triangles of a .ply, .stl, .obj, .vtp or legacy .vtk file.

    Polygons with more corners are divided into triangles over the same area. Corners of an STL are one vertex where
    they are equal, or, where that leaves the surface open, where they differ by rounding.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not what its name says, damaged, or without triangles.
        FileLimitError: it is, or declares to be, beyond the budget.
        PointsError: vertices that are not finite.
    """
    mesh = read_mesh_or_points(path)
    if len(mesh.faces) == 0:
        found = f"found {len(mesh.vertices)} vertices without any"
        raise FileFormatError(f"{quoted(path)}: expected a mesh with triangles, {found}")
    return mesh


def read_mesh_or_points(path: PathLike) -> Mesh:
    """Return the mesh of a file as `read_mesh` does; of points in a mesh format a mesh without triangles."""
    suffix = suffix_to_read(path, READ_SUFFIXES, "a mesh")
    return parse_mesh(read_bytes(path), suffix, quoted(path))


def parse_mesh(data: bytes, suffix: str, where: str) -> Mesh:
    """The vertices and triangles of the content of a mesh file; of points in a mesh format no triangles.

    Raises:
        FileFormatError: not what its suffix says, or damaged.
        FileLimitError: the header declares more than the budget.
        PointsError: vertices that are not finite.
    """
    polygons = FORMATS[suffix].parse(data, where)
    if len(polygons.vertices) == 0:
        raise FileFormatError(f"{where}: expected vertices x y z, found none")
    check_points(polygons.vertices, where)
    return Mesh(polygons.vertices, polygons.triangles(where))


def read_space_and_unit(path: PathLike) -> tuple[str, str]:
    """Frame and unit ("unknown" where it has none) that a mesh file is marked with.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    return parse_space_and_unit(read_bytes(path)[:HEAD])


def read_record(path: PathLike) -> ModelRecord | None:
    """Status and kinds of warnings of the fit that a mesh file is marked with; None where it is not.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    return parse_record(read_bytes(path)[:HEAD])
