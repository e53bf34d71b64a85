"""The text headers of NRRD and MetaImage files, for what SimpleITK does not check.

SimpleITK decodes these formats. It accepts a file that was cut short, and takes 1 for a spacing that is no number: so
the position of the voxels and the spacing are read here too, and compared.

References: https://teem.sourceforge.net/nrrd/format.html, https://itk.org/Wiki/MetaIO/Documentation
"""

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadriform.errors import FileFormatError, FileLimitError
from quadriform.files import reading
from quadriform.files.reading import check_budget, check_readable, named_in_errors, quoted
from quadriform.points import Array

MAX_HEADER = 1 << 20
"""Bytes; a header has a few hundred."""
CHUNK = 1 << 20
MAX_DIMENSIONS = 10
"""Of MetaImage."""
WITH_ZLIB_OR_GZIP = 47
"""zlib's wbits: a window of 32 kB, and either kind of header."""
SEGMENT = re.compile(r"^Segment(\d+)_(ID|Name|LabelValue|Layer):=(.*)$", re.MULTILINE)
"""A key/value pair by which 3D Slicer describes a segment."""
NRRD_SPACES = {
    *("left-posterior-superior", "right-anterior-superior", "left-anterior-superior", "lps", "ras", "las"),
    *("left-posterior-superior-time", "lpst"),
}
"""Spaces that SimpleITK converts to LPS; of those with time it converts none but LPS itself."""


@dataclass(frozen=True)
class StoredSegment:
    """A segment of a .seg.nrrd file.

    Attributes:
        name: as the file has it.
        value: of its voxels.
        layer: the image of the file that contains it, from 0; segments of one layer do not overlap.
    """

    name: str
    value: int
    layer: int


@dataclass(frozen=True)
class TextHeader:
    """What the text states about the voxels.

    Attributes:
        data: the file that contains them.
        start: their first byte; None when they are the last of the file.
        compressed: whether by deflate.
        spacing: (d,) as the text has it, NaN for an axis without.
        space: "LPS" or "unknown", after SimpleITK has read the file.
        kinds: names of the axes of a NRRD, in lower case.
        stored: number of compressed bytes by the text; None where its format does not have it.
        segments: of a segmentation of 3D Slicer.
        is_nrrd: not MetaImage.
    """

    data: Path
    start: int | None
    compressed: bool
    spacing: Array
    space: str
    kinds: str = ""
    stored: int | None = None
    segments: tuple[StoredSegment, ...] = ()
    is_nrrd: bool = False


def read_text_header(path: Path) -> TextHeader:
    """Return the header of a .nrrd, .nhdr, .mha or .mhd file.

    Raises:
        InputError: the file, or the one with its voxels, is missing or cannot be read.
        FileFormatError: it does not begin as either format does, or uses an encoding that is not read.
    """
    check_budget(check_readable(path), quoted(path))
    with path.open("rb") as stream:
        block = stream.read(MAX_HEADER)
    is_nrrd = block.startswith(b"NRRD") or path.suffix.lower() in (".nrrd", ".nhdr")
    with named_in_errors(path):
        header = _nrrd(block, path) if is_nrrd else _meta(block, path)
        check_readable(header.data)
    return header


def check_bytes(header: TextHeader, stated: int) -> None:
    """Compare the number of bytes by the header with those of the file; compressed ones are expanded to their end.

    Raises:
        FileLimitError: beyond the budget.
        FileFormatError: cut short, or damaged.
    """
    check_budget(stated, f"{quoted(header.data)}: the size in the header")
    size = check_readable(header.data)
    start = header.start if header.start is not None else size - stated
    with named_in_errors(header.data):
        found = _expanded(header.data, start) if header.compressed else size - max(start, 0)
        # SimpleITK would fill the remaining voxels with whatever is in memory
        if header.stored not in (None, size - start):
            raise FileFormatError(f"the header states {header.stored} compressed bytes, found {size - start}")
        if start < 0 or found < stated:
            raise FileFormatError(f"cut short: the header states {stated} bytes of voxels, found {found}")


def _expanded(path: Path, start: int) -> int:
    """The number of bytes of a deflated stream, to its checksum."""
    expander, found = zlib.decompressobj(WITH_ZLIB_OR_GZIP), 0
    with path.open("rb") as stream:
        stream.seek(start)
        try:
            while not expander.eof and (chunk := expander.unconsumed_tail or stream.read(CHUNK)):
                found += len(expander.decompress(chunk, CHUNK))
                if found > reading.MAX_BYTES:
                    raise FileLimitError(f"expands beyond the budget of {reading.MAX_BYTES} bytes")
        except zlib.error as error:
            raise FileFormatError(f"damaged: {error}; fetch the file again") from error
    if not expander.eof:
        raise FileFormatError("cut short: its compressed voxels do not end; fetch the file again")
    return found


# --- NRRD --------------------------------------------------------------------------------------------------------


def _nrrd(block: bytes, path: Path) -> TextHeader:
    if not block.startswith(b"NRRD000"):
        raise FileFormatError(f"not a NRRD image; its first bytes are {block[:8]!r}")
    # an empty line ends the header
    ends = [at + len(blank) for blank in (b"\n\n", b"\r\n\r\n") if (at := block.find(blank)) >= 0]
    end = min(ends, default=len(block))
    fields = _nrrd_fields(block[:end].decode("latin-1"))
    encoding = fields.get("encoding", "")
    if encoding not in ("raw", "gzip", "gz"):
        raise FileFormatError(f"encoding {encoding!r}; expected raw or gzip")
    skip = _whole(fields.get("byte skip", "0"))
    if fields.get("line skip", "0") != "0" or skip < -1 or (skip and encoding != "raw"):
        raise FileFormatError("a line skip or byte skip that is not read; expected voxels at once")
    name = fields.get("data file", fields.get("datafile"))
    return TextHeader(
        data=_data_file(name, path),
        start=(end if name is None else 0) + skip if skip >= 0 else None,
        compressed=encoding != "raw",
        spacing=_nrrd_spacing(fields),
        space=_nrrd_space(fields),
        kinds=fields.get("kinds", "").lower(),
        segments=_segments(block[:end]),
        is_nrrd=True,
    )


def _nrrd_fields(text: str) -> dict[str, str]:
    """Values by key in lower case, the first of each key; comments and `key:=value` are no fields."""
    fields: dict[str, str] = {}
    for line in text.splitlines():
        key, colon, value = line.partition(":")
        if colon and not line.startswith("#") and not value.startswith("="):
            fields.setdefault(key.strip().lower(), value.strip())
    return fields


def _segments(block: bytes) -> tuple[StoredSegment, ...]:
    """The segments that 3D Slicer names in lines such as Segment0_Name:=liver; old files have a layer for each."""
    found: dict[int, dict[str, str]] = {}
    for number, key, value in SEGMENT.findall(block.decode("utf-8", "replace")):
        found.setdefault(int(number), {})[key] = value.strip()
    return tuple(
        StoredSegment(
            fields.get("Name", fields.get("ID", f"Segment_{number}")),
            _whole(fields.get("LabelValue", "1")),
            _whole(fields.get("Layer", str(order))),
        )
        for order, (number, fields) in enumerate(sorted(found.items()))
    )


def _nrrd_space(fields: Mapping[str, str]) -> str:
    if set(fields.get("space units", "mm").lower().replace('"', "").split()) != {"mm"}:
        raise FileFormatError(f"space units {fields['space units']}; expected mm")
    named = fields.get("space", "").lower()
    if named == "" or named.startswith(("scanner-xyz", "3d-")):
        return "unknown"
    if named not in NRRD_SPACES:
        raise FileFormatError(f"space {named!r}; expected one of {', '.join(sorted(NRRD_SPACES))}")
    return "LPS"


def _nrrd_spacing(fields: Mapping[str, str]) -> Array:
    """Lengths of the columns of `space directions`, else `spacings`; "none" is an axis without direction, as time."""
    if "space directions" in fields:
        # written as (1,0,0) (0,1,0) none, with or without blanks
        vectors = fields["space directions"].replace("none", "()").replace(" ", "").strip("()").split(")(")
        return np.array([np.linalg.norm(_floats(vector.split(","))) for vector in vectors if vector])
    return _floats(fields.get("spacings", "").split())


# --- MetaImage ---------------------------------------------------------------------------------------------------


def _meta(block: bytes, path: Path) -> TextHeader:
    at = block.find(b"ElementDataFile")  # the last line of the header
    end = block.find(b"\n", at) + 1
    if at < 0 or end == 0:
        raise FileFormatError(f"not a MetaImage: no line ElementDataFile; it begins {block[:16]!r}")
    fields = _meta_fields(block[:end])
    if fields.get("BinaryData", "true").lower() != "true":
        raise FileFormatError("voxels as text; expected BinaryData = True")
    name, compressed = fields.get("ElementDataFile", ""), fields.get("CompressedData", "false").lower() == "true"
    if not name:
        raise FileFormatError("not a MetaImage: the line ElementDataFile names no file")
    local = name.upper() == "LOCAL"
    skip = 0 if local else _whole(fields.get("HeaderSize", "0"))  # HeaderSize = -1: the voxels end the file
    oriented = {"TransformMatrix", "Orientation", "Rotation"} & set(fields)
    return TextHeader(
        data=_data_file(None if local else name, path),
        start=end if local else skip if skip >= 0 else None,
        compressed=compressed,
        spacing=_floats(fields.get("ElementSpacing", fields.get("ElementSize", "")).split()),
        space="LPS" if oriented else "unknown",
        stored=_whole(fields.get("CompressedDataSize", "")) if compressed else None,
    )


def _meta_fields(block: bytes) -> dict[str, str]:
    """Values by key, one a line and each key once.

    Otherwise, or if `CompressedDataSize` comes first, SimpleITK reads something else and leaves voxels undefined; where
    the number of dimensions is no number it writes outside its memory, which ends the whole process.
    """
    fields: dict[str, str] = {}
    for number, line in enumerate(block.decode("latin-1").rstrip("\r\n").split("\n"), 1):
        key, found, value = line.partition("=")
        key = key.strip(" ")
        if not found or not key or not key.isprintable() or key in fields:
            raise FileFormatError(
                f"line {number}: expected `key = value` with a key that occurs once, found {line[:60]!r}"
            )
        fields[key] = value.strip()
    dimensions = fields.get("NDims", "")
    if not dimensions.isdecimal() or not 1 <= int(dimensions) <= MAX_DIMENSIONS:
        raise FileFormatError(f"expected NDims from 1 to {MAX_DIMENSIONS}, found {dimensions!r}")
    order = [key for key in fields if key in ("CompressedData", "CompressedDataSize")]
    if order[:1] == ["CompressedDataSize"]:
        raise FileFormatError("expected CompressedData before CompressedDataSize")
    return fields


def _data_file(name: str | None, path: Path) -> Path:
    if name is None:
        return path
    if name.upper().startswith("LIST") or "%" in name:
        raise FileFormatError(f"voxels in several files ({name!r}); expected one")
    return path.parent / name


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise FileFormatError(f"expected a whole number in the header, found {text!r}") from error


def _floats(words: list[str]) -> Array:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return np.full(len(words), np.nan)
