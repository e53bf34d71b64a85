"""Wavefront OBJ: vertices and polygons; textures, normals, materials and groups do not matter to the surface."""

import re
from array import array
from collections.abc import Iterator, Mapping

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.metadata import as_comment
from quadriform.files.numbers import MAY_BE_CUT, check_last_index, check_last_number
from quadriform.files.polygons import Polygons
from quadriform.files.reading import signature
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
CORNER = re.compile(r"(-?0*[1-9]\d{0,17})(/-?\d*){0,2}")
"""Counted from 1, or backwards from -1, the vertex that was defined last."""
COMMENT = re.compile(r"(?:^|\s)#")
"""A # within a word is damage."""
POINTS = ("v", "vt", "vn", "vp", "f")
FREE_FORM = ("curv", "curv2", "surf")


def parse_obj(data: bytes, where: str) -> Polygons:
    """Vertices and polygons of an OBJ file.

    Raises:
        FileFormatError: no text, a line of vertices or polygons that is not whole, or free-form surfaces.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FileFormatError(f"{where}: expected text in UTF-8, found UTF-16; save it in UTF-8")
    if b"\0" in data:
        raise FileFormatError(f"{where}: expected text, found {signature(data)}")
    rows, corners, lengths = array("d"), array("q"), array("q")
    text, words, line = data.removeprefix(b"\xef\xbb\xbf").decode("ascii", "surrogateescape"), [""], where
    for number, words in _lines(text):
        word, line = words[0], f"{where}, line {number}"
        if word in FREE_FORM:
            raise FileFormatError(f"{line}: free-form surfaces ({word}) are not read; save polygons")
        if word[0] in "vf" and word not in POINTS:
            raise _refusal(line, f"one of {', '.join(POINTS)}", words)
        if word == "v":
            rows.extend(_numbers(words, line))
        elif word == "f":
            polygon = _corners(words, len(rows) // 3, line)
            corners.extend(polygon)
            lengths.append(len(polygon))
    if words[0] in ("v", "f") and _has_no_end(text):
        _check_last(text, words, (len(rows) // 3, lengths), line)
    vertices: Array = np.frombuffer(rows, dtype=np.float64).reshape(-1, 3) if rows else np.empty((0, 3))
    return Polygons(vertices, np.array(corners, dtype=np.int64), np.array(lengths, dtype=np.int64))


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Words of each line with its number, comments left out, and lines that end with a backslash joined to the next."""
    words: list[str] = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1):
        content = COMMENT.split(line, maxsplit=1)[0].rstrip()
        words += content.removesuffix("\\").split()
        if words and not content.endswith("\\"):
            yield number, words
            words = []
    if words:
        yield number, words


def _has_no_end(text: str) -> bool:
    """Whether the last line ends with one of its words."""
    last = re.split(r"[\r\n]", text[text.rfind("\n") + 1 :])[-1]
    return bool(last.strip()) and not COMMENT.search(last)


def _check_last(text: str, words: list[str], found: tuple[int, array], where: str) -> None:
    """Refuse a last line without an end that may be cut; `found`: how many vertices, and corners of each polygon."""
    vertices, lengths = found
    is_cut_within = not text[-1].isspace()
    if words[0] == "f":
        if len(lengths) > 2 and len(set(lengths[:-1])) == 1 and lengths[-1] < lengths[0]:
            raise FileFormatError(f"{where}: the line has no end, and fewer corners than all others: {MAY_BE_CUT}")
        if is_cut_within and "/" not in words[-1]:
            check_last_index(abs(int(words[-1])), vertices, where)
    elif is_cut_within and len(words) <= 4:
        rows = (line for _, line in _lines(text) if line[0] == "v")
        check_last_number([row[len(words) - 1] for row in rows], where)


def _numbers(line: list[str], where: str) -> list[float]:
    """The coordinates; a weight and a colour may follow."""
    words = line[1:]
    if len(words) < 3 or not all(map(NUMBER.fullmatch, words)):
        raise _refusal(where, "three numbers or more", line)
    return [float(word) for word in words[:3]]


def _corners(line: list[str], count: int, where: str) -> list[int]:
    """Vertices of a polygon, counted from 0; negative ones are counted back from the vertices that there are so far."""
    matches = [CORNER.fullmatch(word) for word in line[1:]]
    if len(matches) < 3 or not all(matches):
        raise _refusal(where, "three whole numbers or more, counted from 1 or back from -1", line)
    given = [int(match[1]) for match in matches if match]
    corners = [index - 1 if index > 0 else count + index for index in given]
    if min(corners) < 0:
        raise FileFormatError(f"{where}: vertex {min(given)} is before the first of {count}")
    return corners


def _refusal(where: str, expected: str, words: list[str]) -> FileFormatError:
    return FileFormatError(f"{where}: expected {expected}, found {' '.join(words)[:60]!r}")


def encode_obj(mesh: Mesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of an OBJ file with nine digits of the extent; metadata in its first comment."""
    import trimesh
    from trimesh.exchange.obj import export_obj

    extent = float(np.ptp(mesh.vertices, axis=0).max()) or 1.0
    digits = max(0, 8 - int(np.floor(np.log10(extent))))  # decimals: metres need more of them than millimetres
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    text: str = export_obj(whole, include_normals=False, digits=digits, header=as_comment(metadata))
    return (text.rstrip("\n") + "\n").encode()
