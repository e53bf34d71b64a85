"""STL, binary and ASCII: a list of triangles, whose corners are put together to vertices."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from quadriform.errors import FileFormatError, OutputError
from quadriform.files.metadata import as_comment
from quadriform.files.numbers import fits_single_precision, floats, moved_by_single_precision
from quadriform.files.polygons import Indices, Polygons
from quadriform.files.reading import signature
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh

TEXT, HEAD, TRIANGLE = 80, 84, 50
"""Bytes of the text at the beginning of a binary file, of all before the triangles, and of each of these."""
NEAR = 1e-6
"""Corners on open edges closer than this share of the extent are one vertex, or closer than two steps of single
precision where these are larger, but never further than `SHORT` of the median edge."""
SHORT = 0.1
NAMES = ("solid", "endsolid", "facet", "outer", "endloop", "endfacet", "vertex", "color")


def parse_stl(data: bytes, where: str) -> Polygons:
    """Vertices and triangles of an STL file.

    Corners are one vertex where they are equal to the bit. Where that leaves the surface open, those that differ by
    rounding are put together, too.

    Raises:
        FileFormatError: neither binary nor ASCII STL, cut short, or triangles without three corners.
    """
    corners = _binary(data, where)
    corners = _ascii(data, where) if corners is None else corners
    if len(corners) == 0:
        raise FileFormatError(f"{where}: expected an STL file with triangles, found {signature(data)} without any")
    # Corners that are equal to the bit are one vertex, without any tolerance.
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    faces = index.reshape(-1).reshape(-1, 3)
    if np.isfinite(vertices).all() and not Mesh(vertices, faces).is_closed():
        vertices, faces = _merged(vertices, faces)
    return Polygons(vertices, faces.reshape(-1), np.full(len(faces), 3))


def _binary(data: bytes, where: str) -> Array | None:
    """Corners (3 m, 3) of a binary file; None where the bytes are not those of its count of triangles."""
    if len(data) < HEAD:
        return None
    count = int.from_bytes(data[80:HEAD], "little")
    more = len(data) - HEAD - TRIANGLE * count
    # Some programs pad the file with zeros; other bytes behind the triangles mean that the count is wrong.
    if more < 0 or (more >= TRIANGLE and any(data[HEAD + TRIANGLE * count :])):
        if data.lstrip()[:5].lower() == b"solid" or b"\0" not in data:
            return None
        found = f"the header declares {count} triangles, found {len(data) - HEAD} bytes of {TRIANGLE} each"
        raise FileFormatError(f"{where}: {found}")
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return np.frombuffer(data, record, count, HEAD)["corners"].astype(np.float64).reshape(-1, 3)


def _ascii(data: bytes, where: str) -> Array:
    lines = data.decode("ascii", "surrogateescape").replace("\0", " ").splitlines()
    lines = [line for each in lines if (line := each.strip())]
    kinds = [line.split(None, 1)[0].lower() for line in lines]
    if not kinds or kinds[0] != "solid":
        raise FileFormatError(f"{where}: expected an STL file, binary or ASCII, found {signature(data)}")
    if not set(kinds) <= set(NAMES):
        found = next(line for line, kind in zip(lines, kinds) if kind not in NAMES)[:60]
        raise FileFormatError(f"{where}: expected the lines of an ASCII STL, found {found!r}")
    words = [line.split()[1:] for line, kind in zip(lines, kinds) if kind == "vertex"]
    wrong = next((row for row in words if len(row) != 3), None)
    if wrong is not None:
        raise FileFormatError(f"{where}: expected vertex x y z, found {' '.join(['vertex', *wrong])[:60]!r}")
    order = [kind for kind in kinds if kind in ("vertex", "endfacet")]
    counts = {name: kinds.count(name) for name in ("facet", "endfacet", "solid", "endsolid")}
    if counts["facet"] != counts["endfacet"] or counts["solid"] != counts["endsolid"]:
        found = ", ".join(f"{count} lines {name}" for name, count in counts.items())
        raise FileFormatError(f"{where}: the file is cut short, found {found}")
    if order != ["vertex", "vertex", "vertex", "endfacet"] * counts["facet"]:
        found = f"{len(words)} corners in {counts['facet']} facets"
        raise FileFormatError(f"{where}: expected three corners in each facet, found {found}")
    return floats((word for row in words for word in row), where).reshape(-1, 3)


def _merged(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """The same with vertices of open edges that differ by rounding as one, the first of them."""
    edge = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    lengths = np.linalg.norm(vertices[edge[:, 1]] - vertices[edge[:, 0]], axis=1)
    near = min(_rounding(vertices), SHORT * float(np.median(lengths)))
    # An edge as one number, from either end: inner edges occur in both directions.
    key, back = edge @ [len(vertices), 1], edge @ [1, len(vertices)]
    loose = np.unique(edge[~np.isin(key, back)])  # what is wound the wrong way is not loose
    if len(loose) == 0:
        return vertices, faces
    pairs = loose[cKDTree(vertices[loose]).query_pairs(near, output_type="ndarray")]
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2)
    group = connected_components(graph, directed=False)[1]
    _, first, index = np.unique(group, return_index=True, return_inverse=True)
    return vertices[first], index.reshape(-1)[faces]


def _rounding(vertices: Array) -> float:
    """Distance that rounding explains, from sizes that single wrong corners do not change."""
    extent = 2 * float(np.quantile(np.abs(vertices - np.median(vertices, axis=0)), 0.9, axis=0).max())
    largest = np.float32(np.median(np.abs(vertices).max(axis=1)))
    return max(NEAR * extent, 2 * float(np.spacing(largest)))


def encode_stl(mesh: Mesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a binary STL, whose header of 80 bytes has as much of the metadata as it has room for.

    Raises:
        OutputError: single precision would move vertices.
    """
    if not fits_single_precision(mesh.vertices):
        moved = moved_by_single_precision(mesh.vertices)
        raise OutputError(
            f".stl stores single precision, which would move vertices by {moved:.3g} so far from the origin; "
            "write .ply, .vtp or .obj instead"
        )
    import trimesh

    content: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type="stl")
    whole_words = re.match(rf".{{0,{TEXT}}}(?=[ ,]|$)", as_comment(metadata))  # and whole members of a list
    return (whole_words[0] if whole_words else "").encode().ljust(TEXT) + content[TEXT:]
