"""Triangle meshes in and out. The frame and the unit travel in the header wherever the format has room."""

import io
import os
import re
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError, OutputError
from quadriform.files.atomic import write_bytes
from quadriform.files.marks import check_marks, parse_marks
from quadriform.files.ply import ply_claims
from quadriform.files.reading import quoted, read_bytes, signature, suffix_of
from quadriform.files.vtp import encode_vtp, parse_vtp
from quadriform.points import Array, check_points
from quadriform.shapes.mesh import Mesh

MESH_SUFFIXES = (".ply", ".stl", ".obj", ".vtp")

OBJ_WORDS = ("v", "vt", "vn", "vp", "f")
OBJ_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
OBJ_CORNER = re.compile(r"-?0*[1-9]\d*(/-?\d*){0,2}")
"""Counted from 1, or backwards from -1; of 0 trimesh makes the first vertex."""
HEAD = 4096
"""Bytes in which the marks stand, when there are any."""
SINGLE = 1e-5
"""Vertices may move by this share of the mesh's extent when a format stores single precision."""


def write_mesh(
    mesh: Mesh, path: str | os.PathLike[str], space: str = "unknown", unit: str = "unknown", force: bool = False
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

    Raises:
        FileFormatError: another suffix.
        OutputError: the target cannot be written, or single precision would spoil an STL.
    """
    suffix = suffix_of(path, MESH_SUFFIXES, "a mesh")
    write_bytes(path, encode_mesh(mesh, suffix, space, unit), force)


def encode_mesh(mesh: Mesh, suffix: str, space: str, unit: str) -> bytes:
    """The bytes of a mesh file; arguments as for `write_mesh`.

    Raises:
        OptionError: a frame or unit that no file can carry.
        OutputError: single precision would spoil an STL.
    """
    check_marks(space, unit)
    if suffix == ".vtp":
        return encode_vtp(mesh, space, unit)
    note = f"SPACE={space} UNIT={unit}"
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
    return note.encode().ljust(80) + content[80:]


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
    """Read the triangles of a .ply, .stl, .obj or .vtp file; polygons with four corners are split.

    Vertices that an STL file repeats are merged where they are equal to the bit.

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
    suffix = suffix_of(path, MESH_SUFFIXES, "a mesh")
    data, where = read_bytes(path), quoted(path)
    vertices, faces = _parse(data, suffix, where)
    none = np.empty((0, 3), dtype=np.int64)
    return Mesh(check_points(vertices, where), none if faces is None else np.array(faces, dtype=np.int64))


def read_marks(path: str | os.PathLike[str]) -> tuple[str, str]:
    """Frame and unit ("unknown" where it has none) that a mesh file is marked with.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    return parse_marks(read_bytes(path)[:HEAD])


def parse_vertices(data: bytes, suffix: str, where: str) -> Array:
    """The vertices of a mesh file, or of a cloud in a mesh format.

    Raises:
        FileFormatError: not what its suffix says, or damaged.
        FileLimitError: the header promises more than the budget.
    """
    return _parse(data, suffix, where)[0]


def _parse(data: bytes, suffix: str, where: str) -> tuple[Array, Any]:
    """Vertices (n, 3) and faces (m, 3), or None for a cloud."""
    if suffix == ".vtp":
        return parse_vtp(data, where)
    claimed = ply_claims(data, where) if suffix == ".ply" else {}
    if suffix == ".obj":
        _check_obj(data, where)
    loaded = _load(data, suffix, where)
    vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), getattr(loaded, "faces", None)
    _check_counts(vertices, faces, claimed, where)
    if suffix == ".stl":
        vertices, index = np.unique(vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[np.asarray(faces)]
    return vertices, faces


def _load(data: bytes, suffix: str, where: str) -> Any:
    import trimesh

    options: dict[str, Any] = {".ply": {"fix_texture": False}, ".obj": {"maintain_order": True}}.get(suffix, {})
    try:  # from memory, so that a mesh cannot make us open the files it names
        loaded = trimesh.load(io.BytesIO(data), file_type=suffix[1:], process=False, **options)
        return loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
    except Exception as error:  # the loaders promise no error type of their own
        what = f"{suffix} mesh, found {signature(data)} that cannot be read as one"
        reason = (str(error).splitlines() or [""])[0][:120]
        raise FileFormatError(f"{where}: expected a {what} ({type(error).__name__}: {reason})") from error


def _check_obj(data: bytes, where: str) -> None:
    """What trimesh leaves out or guesses without a word: vertices and faces whose lines are not whole."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{where}: expected text in UTF-8, found {signature(data)}") from error
    for number, line in enumerate(text.splitlines(), 1):
        word, *rest = line.partition("#")[0].split() or [""]
        if word.startswith(("v", "f")) and (word not in OBJ_WORDS or line[0].isspace()):
            words = ", ".join(OBJ_WORDS)
            raise FileFormatError(f"{where}, line {number}: expected to begin with one of {words}, found {line[:60]!r}")
        whole = {"v": OBJ_NUMBER, "f": OBJ_CORNER}.get(word)
        if whole is not None and (len(rest) < 3 or not all(map(whole.fullmatch, rest))):
            raise FileFormatError(f"{where}, line {number}: expected three numbers or more, found {line[:60]!r}")


def _check_counts(vertices: Array, faces: Any, claimed: dict[str, int], where: str) -> None:
    """What trimesh does not: short files, wrong columns and faces that point nowhere are errors."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) == 0:
        raise FileFormatError(f"{where}: expected vertices x y z, found shape {vertices.shape}")
    n_faces = 0 if faces is None else len(faces)
    if len(vertices) != claimed.get("vertex", len(vertices)) or n_faces < claimed.get("face", 0):
        raise FileFormatError(
            f"{where}: the header promises {claimed}, found {len(vertices)} vertices, {n_faces} faces"
        )
    if n_faces and not (np.min(faces) >= 0 and np.max(faces) < len(vertices)):
        raise FileFormatError(f"{where}: a face names vertex {np.max(faces)}, but there are {len(vertices)}")
