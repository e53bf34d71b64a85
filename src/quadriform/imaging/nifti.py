"""NIfTI-1 and NIfTI-2 in one file or two, plain or compressed, read to the last byte.

nibabel decodes the header. It is not allowed to repair it: a voxel size of 0 would become 1 without notice.
Reference: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h, whose fields the comments name.
"""

import gzip
import html
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, FileLimitError, InputError, MaskError, WarningKind, Warnings
from quadriform.files import reading
from quadriform.files.reading import check_budget, named_in_errors
from quadriform.imaging.formats import Size, choose_frame, is_pair, pair_of
from quadriform.imaging.nifti_forms import choose_form, read_forms
from quadriform.imaging.segments import Segment
from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.shapes.spaces import HALF_ROTATION

if TYPE_CHECKING:
    from nibabel.nifti1 import Nifti1Header

MAX_EXPANSION = 1100
"""Deflate compresses by a factor of 1032 at most: a header that states more than this is wrong."""
CHUNK = 1 << 20
MILLIMETRES = {1: 1000.0, 2: 1.0, 3: 0.001}
"""From the code of the unit of length, the lowest three bits of xyzt_units."""
MILLISECONDS = {8: 1000.0, 16: 1.0, 24: 0.001}
"""From the code of the unit of time, the next three bits."""
LABEL_INTENT = 1002
"""NIFTI_INTENT_LABEL: the values are labels."""
MAX_EXTENSIONS = 1 << 24
"""Bytes between header and voxels that are searched for names of labels."""
LABEL = re.compile(rb"<Label\s[^>]*?Key=[\"'](\d{1,9})[\"'][^>]*>(.*?)</Label>", re.DOTALL)
"""An entry of the table of labels that Connectome Workbench and TotalSegmentator write."""
CDATA = re.compile(rb"^\s*<!\[CDATA\[(.*?)\]\]>\s*$", re.DOTALL)


def read_nifti(path: Path, frame: int | None, affine: str | None = None) -> Volume:
    """Return one frame; see `quadriform.imaging.reading.read_volume`."""
    head, data = pair_of(path) if is_pair(path) else (path, path)
    with _opened_expanded(head) as stream:
        header = _read_header(stream, head)
        shape, dtype, (factor, offset) = _shape(header), _dtype(header), _scale(header)
        placement, warnings = _placement(header, shape, affine)
        number = choose_frame(frame, shape, path)
        # in one file the voxels begin behind the header, in two at the first byte of the other
        at = header.sizeof_hdr if data == head else 0
        start = _start(header, at)
        if data == head:
            extensions, values = _read_voxels(stream, at, start, shape, dtype, number, data)
    if data != head:
        with _opened_expanded(data) as stream:
            extensions, values = _read_voxels(stream, at, start, shape, dtype, number, data)
    with named_in_errors(path):
        if (factor, offset) != (1.0, 0.0):  # labels stay whole numbers
            values = values.astype(np.float64) * factor + offset
        segments = _label_table(extensions)
        is_label_map = bool(segments) or int(header["intent_code"]) == LABEL_INTENT
        return Volume(values, *placement, warnings, segments, is_label_map)


def nifti_times(path: Path) -> tuple[int, Array | None]:
    """Return the number of frames and their times (frames,) in ms; None where the header has no step or unit of time.

    Raises:
        InputError, FileFormatError, MaskError: as `read_nifti`.
    """
    head = pair_of(path)[0] if is_pair(path) else path
    with _opened_expanded(head) as stream:
        header = _read_header(stream, head)
        n = _shape(header)[3]
    # pixdim[4] is the time step, toffset the time of the first frame
    step, start = float(header["pixdim"][4]), float(header["toffset"])
    scale = MILLISECONDS.get(int(header["xyzt_units"]) & 0x38)
    if n == 1 or scale is None or not (0 < step < np.inf and np.isfinite(start)):
        return n, None
    return n, scale * (start + step * np.arange(n, dtype=np.float64))


@contextmanager
def _opened_expanded(path: Path) -> Iterator[IO[bytes]]:
    """The content, expanded; errors name the file."""
    try:
        raw = path.open("rb")
    except OSError as error:
        raise InputError(f"{str(path)!r}: cannot be read: {error.strerror}") from error
    with raw, named_in_errors(path):
        compressed = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        if compressed != path.name.lower().endswith(".gz"):
            found = "a gzip file" if compressed else "no gzip file"
            raise FileFormatError(f"by its content this is {found}; give it the name that fits")
        try:
            yield cast(IO[bytes], gzip.GzipFile(fileobj=raw) if compressed else raw)
        except (OSError, EOFError, zlib.error) as error:
            raise FileFormatError(f"damaged or cut short: {error}; fetch the file again") from error


def _read_voxels(
    stream: IO[bytes], at: int, start: int, shape: Size, dtype: np.dtype[Any], number: int, path: Path
) -> tuple[bytes, NDArray[Any]]:
    """The extensions of the header, and the voxels (i, j, k) of a frame as they are stored.

    The stream, at byte `at` of the file, is read to its end, so that damage anywhere is found.
    """
    block = int(np.prod(shape[:3], dtype=object)) * dtype.itemsize  # without overflow for a damaged header
    _check_size(start + block * shape[3], path)
    extensions = stream.read(min(start - at, MAX_EXTENSIONS))
    # frames before and behind the requested one are read without being kept
    _skip(stream, start - at - len(extensions) + block * number)
    content = stream.read(block)
    missing = block * (shape[3] - number) - len(content) - _skip(stream, reading.MAX_BYTES)
    if missing > 0:
        raise FileFormatError(f"cut short: {missing} bytes of the {shape} voxels are missing")
    if stream.read(1):
        raise FileLimitError(f"expands to more than the budget of {reading.MAX_BYTES} bytes")
    stored = np.frombuffer(content, dtype).reshape(shape[:3], order="F")
    return extensions, stored.astype(dtype.newbyteorder("="), copy=False)


def _label_table(extensions: bytes) -> tuple[Segment, ...]:
    """The names of labels between header and voxels; 0 is the background whatever its name."""
    found = []
    for key, content in LABEL.findall(extensions):
        inner = CDATA.match(content)
        text = inner[1].decode("utf-8", "replace") if inner else html.unescape(content.decode("utf-8", "replace"))
        if int(key) > 0:
            found.append(Segment(text.strip(), int(key), (int(key),)))
    return tuple(found)


def _read_header(stream: IO[bytes], path: Path) -> "Nifti1Header":
    """The header: sizeof_hdr, its first field, determines version and byte order, magic one or two files."""
    from nibabel.nifti1 import Nifti1Header
    from nibabel.nifti2 import Nifti2Header

    first = stream.read(4)
    expected = (b"ni1", b"ni2") if is_pair(path) else (b"n+1", b"n+2")
    for kind, magic in zip((Nifti1Header, Nifti2Header), expected):
        for endianness in ("little", "big"):
            if first == kind.sizeof_hdr.to_bytes(4, endianness):
                block = first + stream.read(kind.sizeof_hdr - 4)
                if len(block) < kind.sizeof_hdr:
                    raise FileFormatError("cut short: it ends within its header")
                header = kind(block, endianness=endianness, check=False)
                if header["magic"].item() == magic:
                    return header
                raise FileFormatError(_other_format(header["magic"].item(), path))
    raise FileFormatError(f"not a NIfTI image; its first bytes are {first!r}")


def _other_format(magic: bytes, path: Path) -> str:
    """The format of a header that begins as NIfTI does, but whose magic does not fit its name."""
    if magic in (b"ni1", b"ni2"):
        return "one of a pair of files by its content, and so should be called .hdr"
    if magic in (b"n+1", b"n+2"):
        return "an image in one file by its content, and so should be called .nii"
    if is_pair(path):
        return "an Analyze image, which does not say where left and right are; convert it to NIfTI"
    return f"not a NIfTI image: expected the letters 'n+1' or 'n+2' in its header, found {magic!r}"


def _shape(header: "Nifti1Header") -> Size:
    """Voxels along i, j, k and frames: dim[0] is the number of dimensions, dim[1] to dim[7] their sizes."""
    dim = [int(size) for size in header["dim"]]
    shape = tuple(dim[1 : dim[0] + 1])
    if not 1 <= dim[0] <= 7 or min(shape) < 1:
        raise FileFormatError(f"the header has impossible dimensions {dim}")
    while len(shape) > 4 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) not in (3, 4):
        raise MaskError(f"expected a three-dimensional image, found shape {shape}")
    return shape[0], shape[1], shape[2], shape[3] if len(shape) == 4 else 1


def _dtype(header: "Nifti1Header") -> np.dtype[Any]:
    try:
        dtype = header.get_data_dtype()
    except KeyError as error:
        raise FileFormatError(f"the header has the unknown data type {error}") from error
    if dtype.kind not in "iuf":
        raise MaskError(f"expected one real number a voxel, found type {dtype}")
    return dtype


def _start(header: "Nifti1Header", at: int) -> int:
    offset = float(header["vox_offset"])
    if not at <= offset <= reading.MAX_BYTES:
        raise FileFormatError(f"the header states that its voxels begin at byte {offset:g}")
    return int(offset)


def _check_size(stated: int, path: Path) -> None:
    """Refuse before anything is allocated what cannot be in the file."""
    check_budget(stated, f"{str(path)!r}: the size in the header")
    size = path.stat().st_size
    if stated > size * (MAX_EXPANSION if path.name.lower().endswith(".gz") else 1):
        raise FileFormatError(f"cut short: the header states {stated} bytes, found {size}")


def _skip(stream: IO[bytes], count: int) -> int:
    """Read past `count` bytes, or to the end, without keeping them; return how many were read."""
    left = count
    while left and (chunk := stream.read(min(left, CHUNK))):
        left -= len(chunk)
    return count - left


def _scale(header: "Nifti1Header") -> tuple[float, float]:
    """Slope and intercept; a scl_slope of 0 means that the values are not scaled, whatever the intercept is."""
    factor, offset = float(header["scl_slope"]), float(header["scl_inter"])
    # nibabel keeps "none" as NaN in memory, and other programs write it
    if factor == 0 or np.isnan(factor):
        return 1.0, 0.0
    if not np.isfinite([factor, offset]).all():
        raise FileFormatError(f"slope {factor:g} and intercept {offset:g}; expected finite numbers")
    return factor, offset


def _placement(header: "Nifti1Header", shape: Size, affine: str | None) -> tuple[tuple[Array, str, str], Warnings]:
    """World from voxel (4, 4), its space and unit; warnings where two forms disagree, or the unit is unknown."""
    forms = read_forms(header, shape)
    used, warnings = choose_form(forms, affine)
    scale = MILLIMETRES.get(int(header["xyzt_units"]) & 7)
    if not scale:
        warnings[WarningKind.UNKNOWN_UNIT] = "the image names no unit of length (xyzt_units): its lengths are as stored"
    # the standard has RAS coordinates (+x right, +y anterior); pixdim alone has no known orientation
    rotation, space = (np.eye(3), "unknown") if used == "pixdim" else (HALF_ROTATION, "LPS")
    stored = forms.stored[used]
    world_from_voxel = np.vstack([(scale or 1.0) * rotation @ stored[:3], stored[3:]])
    return (world_from_voxel, space, "mm" if scale else "unknown"), warnings
