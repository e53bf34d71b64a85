"""The lines of text before the voxels of NRRD and MetaImage files, for what SimpleITK does not check.

SimpleITK decodes these formats. It takes a file that was cut short for a whole one, or a spacing that is no number
for 1: where the voxels lie and which spacing was meant is therefore read here too, and compared.

References: https://teem.sourceforge.net/nrrd/format.html, https://itk.org/Wiki/MetaIO/Documentation
"""

import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadriform.errors import FileFormatError, FileLimitError
from quadriform.files import reading
from quadriform.files.reading import check_budget, check_readable, quoted
from quadriform.points import Array

MAX_HEADER = 1 << 20
"""Bytes; a header has a few hundred."""
CHUNK = 1 << 20
MOST_DIMENSIONS = 10
"""MetaImage has no more."""
WITH_ZLIB_OR_GZIP = 47
"""Window of 32 kB, and either kind of header is recognised."""
SEGMENT = re.compile(r"^Segment(\d+)_(ID|Name|LabelValue|Layer):=(.*)$", re.MULTILINE)
"""A remark by which 3D Slicer describes a segment."""
NRRD_SPACES = {
    *("left-posterior-superior", "right-anterior-superior", "left-anterior-superior", "lps", "ras", "las"),
    *("left-posterior-superior-time", "lpst"),
}
"""Frames that SimpleITK gives as LPS; with time, it turns none over."""


@dataclass(frozen=True)
class StoredSegment:
    """A segment of a .seg.nrrd file.

    Attributes:
        name: in the file's words.
        value: of its voxels.
        layer: the image of the file that holds it, from 0; those of one layer do not overlap.
    """

    name: str
    value: int
    layer: int


@dataclass(frozen=True)
class TextHeader:
    """What the text says about the voxels.

    Attributes:
        data: the file that holds them.
        start: their first byte; None when they are the last of the file.
        compressed: whether by deflate.
        spacing: (d,) as the text has it, NaN for an axis without.
        space: "LPS" or "unknown", after SimpleITK has read the file.
        kinds: what the axes of a NRRD are called, in lower case.
        stored: how many compressed bytes there are, by the text; None where its format does not say.
        segments: of a segmentation of 3D Slicer.
        is_nrrd: not MetaImage.
    """

    data: Path
    start: int | None
    compressed: bool
    spacing: Array
    space: str
    kinds: str
    stored: int | None = None
    segments: tuple[StoredSegment, ...] = ()
    is_nrrd: bool = False


def read_text_header(path: Path) -> TextHeader:
    """Read the header of a .nrrd, .nhdr, .mha or .mhd file.

    Raises:
        InputError: the file, or the one with its voxels, is missing or cannot be read.
        FileFormatError: it does not begin as either format does, or is kept in a way that is not read.
    """
    check_budget(check_readable(path), quoted(path))
    with path.open("rb") as stream:
        block = stream.read(MAX_HEADER)
    nrrd = block.startswith(b"NRRD") or path.suffix.lower() in (".nrrd", ".nhdr")
    header = _nrrd(block, path) if nrrd else _meta(block, path)
    check_readable(header.data)
    return header


def check_bytes(header: TextHeader, promised: int) -> None:
    """Compare what the header promises with the bytes that are there; compressed ones are expanded to their end.

    Raises:
        FileLimitError: beyond the budget.
        FileFormatError: cut short, or damaged.
    """
    where = quoted(header.data)
    check_budget(promised, f"{where}: what the header promises")
    size = check_readable(header.data)
    start = header.start if header.start is not None else size - promised
    found = _expanded(header.data, start) if header.compressed else size - max(start, 0)
    if header.stored not in (None, size - start):  # SimpleITK would leave the rest of the voxels to chance
        raise FileFormatError(f"{where}: the header promises {header.stored} compressed bytes, found {size - start}")
    if start < 0 or found < promised:
        raise FileFormatError(f"{where}: cut short: the header promises {promised} bytes of voxels, found {found}")


def _expanded(path: Path, start: int) -> int:
    """The number of bytes that a deflated stream holds, to its checksum."""
    expander, found = zlib.decompressobj(WITH_ZLIB_OR_GZIP), 0
    with path.open("rb") as stream:
        stream.seek(start)
        try:
            while not expander.eof and (chunk := expander.unconsumed_tail or stream.read(CHUNK)):
                found += len(expander.decompress(chunk, CHUNK))
                if found > reading.MAX_BYTES:
                    raise FileLimitError(f"{quoted(path)}: expands beyond the budget of {reading.MAX_BYTES} bytes")
        except zlib.error as error:
            raise FileFormatError(f"{quoted(path)}: damaged: {error}; fetch the file again") from error
    if not expander.eof:
        raise FileFormatError(f"{quoted(path)}: cut short: its compressed voxels do not end; fetch the file again")
    return found


def _nrrd(block: bytes, path: Path) -> TextHeader:
    if not block.startswith(b"NRRD000"):
        raise FileFormatError(f"{quoted(path)}: not a NRRD image; its first bytes are {block[:8]!r}")
    end = min((at + len(gap) for gap in (b"\n\n", b"\r\n\r\n") if (at := block.find(gap)) >= 0), default=len(block))
    # NRRD looks at no case, MetaImage does
    fields = {key.lower(): value for key, value in _fields(block[:end], ":").items()}
    encoding = fields.get("encoding", "")
    if encoding not in ("raw", "gzip", "gz"):
        raise FileFormatError(f"{quoted(path)}: encoding {encoding!r}; expected raw or gzip")
    skip = _whole(fields.get("byte skip", "0"), path)
    if fields.get("line skip", "0") != "0" or skip < -1 or (skip and encoding != "raw"):
        raise FileFormatError(f"{quoted(path)}: a line skip or byte skip that is not read; expected voxels at once")
    name = fields.get("data file", fields.get("datafile"))
    start = (end if name is None else 0) + skip if skip >= 0 else None
    compressed, kinds = encoding != "raw", fields.get("kinds", "").lower()
    return TextHeader(
        _data_file(name, path),
        start,
        compressed,
        _nrrd_spacing(fields),
        _nrrd_space(fields, path),
        kinds,
        segments=_segments(block[:end], path),
        is_nrrd=True,
    )


def _segments(block: bytes, path: Path) -> tuple[StoredSegment, ...]:
    """The segments that 3D Slicer names in lines such as Segment0_Name:=liver; old files have a layer for each."""
    found: dict[int, dict[str, str]] = {}
    for number, key, value in SEGMENT.findall(block.decode("utf-8", "replace")):
        found.setdefault(int(number), {})[key] = value.strip()
    return tuple(
        StoredSegment(
            fields.get("Name", fields.get("ID", f"Segment_{number}")),
            _whole(fields.get("LabelValue", "1"), path),
            _whole(fields.get("Layer", str(order)), path),
        )
        for order, (number, fields) in enumerate(sorted(found.items()))
    )


def _nrrd_space(fields: Mapping[str, str], path: Path) -> str:
    if set(fields.get("space units", "mm").lower().replace('"', "").split()) != {"mm"}:
        raise FileFormatError(f"{quoted(path)}: space units {fields['space units']}; expected mm")
    named = fields.get("space", "").lower()
    if named == "" or named.startswith(("scanner-xyz", "3d-")):
        return "unknown"
    if named not in NRRD_SPACES:
        raise FileFormatError(f"{quoted(path)}: space {named!r}; expected one of {', '.join(sorted(NRRD_SPACES))}")
    return "LPS"


def _nrrd_spacing(fields: Mapping[str, str]) -> Array:
    if "space directions" in fields:
        vectors = fields["space directions"].replace("none", "()").replace(" ", "").strip("()").split(")(")
        return np.array([np.linalg.norm(_floats(vector.split(","))) for vector in vectors if vector])
    return _floats(fields.get("spacings", "").split())


def _meta(block: bytes, path: Path) -> TextHeader:
    at = block.find(b"ElementDataFile")
    end = block.find(b"\n", at) + 1
    if at < 0 or end == 0:
        raise FileFormatError(f"{quoted(path)}: not a MetaImage: no line ElementDataFile; it begins {block[:16]!r}")
    fields = _meta_fields(block[:end], path)
    if fields.get("BinaryData", "true").lower() != "true":
        raise FileFormatError(f"{quoted(path)}: voxels as text; expected BinaryData = True")
    name, compressed = fields.get("ElementDataFile", ""), fields.get("CompressedData", "false").lower() == "true"
    if not name:
        raise FileFormatError(f"{quoted(path)}: not a MetaImage: the line ElementDataFile names no file")
    start: int | None = end
    if name.upper() != "LOCAL":
        skip = _whole(fields.get("HeaderSize", "0"), path)
        start = skip if skip >= 0 else None
    spacing = fields.get("ElementSpacing", fields.get("ElementSize", ""))
    oriented = {"TransformMatrix", "Orientation", "Rotation"} & set(fields)
    return TextHeader(
        _data_file(None if name.upper() == "LOCAL" else name, path),
        start,
        compressed,
        _floats(spacing.split()),
        "LPS" if oriented else "unknown",
        "",
        _whole(fields.get("CompressedDataSize", ""), path) if compressed else None,
    )


def _meta_fields(block: bytes, path: Path) -> dict[str, str]:
    """Keys and values, each line one and none of them twice.

    Where they are not, or `CompressedDataSize` comes first, SimpleITK makes something else of them and leaves voxels to
    chance; where the number of dimensions is none it writes beyond its own memory, which ends the whole process.
    """
    fields: dict[str, str] = {}
    for number, line in enumerate(block.decode("latin-1").rstrip("\r\n").split("\n"), 1):
        key, found, value = line.partition("=")
        key = key.strip(" ")
        if not found or not key or not key.isprintable() or key in fields:
            raise FileFormatError(
                f"{quoted(path)}, line {number}: expected `key = value` with a key of its own, found {line[:60]!r}"
            )
        fields[key] = value.strip()
    dimensions = fields.get("NDims", "")
    if not dimensions.isdecimal() or not 1 <= int(dimensions) <= MOST_DIMENSIONS:
        raise FileFormatError(f"{quoted(path)}: expected NDims from 1 to {MOST_DIMENSIONS}, found {dimensions!r}")
    order = [key for key in fields if key in ("CompressedData", "CompressedDataSize")]
    if order[:1] == ["CompressedDataSize"]:
        raise FileFormatError(f"{quoted(path)}: expected CompressedData before CompressedDataSize")
    return fields


def _fields(block: bytes, separator: str) -> dict[str, str]:
    """Keys and values of lines `key separator value`; the first of a key counts."""
    return dict(reversed(list(_pairs(block.decode("latin-1"), separator))))


def _pairs(text: str, separator: str) -> Iterator[tuple[str, str]]:
    for line in text.splitlines():
        key, found, value = line.partition(separator)
        if found and not line.startswith("#") and not value.startswith("="):  # key:=value is a remark in NRRD
            yield key.strip(), value.strip()


def _data_file(name: str | None, path: Path) -> Path:
    if name is None:
        return path
    if name.upper().startswith("LIST") or "%" in name:
        raise FileFormatError(f"{quoted(path)}: voxels in several files ({name!r}); expected one")
    return path.parent / name


def _whole(text: str, path: Path) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise FileFormatError(f"{quoted(path)}: expected a whole number in the header, found {text!r}") from error


def _floats(words: list[str]) -> Array:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return np.full(len(words), np.nan)
