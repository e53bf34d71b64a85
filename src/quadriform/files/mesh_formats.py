"""The table of mesh formats, one entry each: the only place that lists them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from quadriform.files.legacy_vtk import parse_legacy_vtk
from quadriform.files.obj import encode_obj, parse_obj
from quadriform.files.ply import encode_ply, parse_ply
from quadriform.files.polygons import Polygons
from quadriform.files.stl import encode_stl, parse_stl
from quadriform.files.vtp import encode_vtp, parse_vtp
from quadriform.shapes.mesh import Mesh


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
