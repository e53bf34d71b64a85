"""NIfTI-1 and NIfTI-2 in one file or two, plain or compressed, read to the last byte.

nibabel decodes the header. It is asked not to repair it: a voxel size of 0 would silently become 1.
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

from quadriform.errors import (
    FileFormatError,
    FileLimitError,
    InputError,
    MaskError,
    WarningKind,
    Warnings,
)
from quadriform.imaging.formats import is_pair, pair_of
from quadriform.imaging.nifti_forms import choose_form, read_forms
from quadriform.imaging.reader_common import Size, choose_frame
from quadriform.imaging.segments import Segment
from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.shapes.spaces import HALF_TURN

if TYPE_CHECKING:
    from nibabel.nifti1 import Nifti1Header

MAX_BYTES = 2 * 1024**3
"""Neither what a header promises nor what a compressed file expands to may be larger."""
MAX_EXPANSION = 1100
"""Deflate cannot shrink by more than 1032: a header that promises more than this lies."""
CHUNK = 1 << 20
MILLIMETRES = {1: 1000.0, 2: 1.0, 3: 0.001}
"""From the units code of the header."""
MILLISECONDS = {8: 1000.0, 16: 1.0, 24: 0.001}
"""From the code of the unit of time."""
LABELS = 1002
"""Intent code of images whose values are labels."""
MAX_EXTENSIONS = 1 << 24
"""Bytes between header and voxels that are searched for names of labels."""
LABEL = re.compile(rb"<Label\s[^>]*?Key=[\"'](\d{1,9})[\"'][^>]*>(.*?)</Label>", re.DOTALL)
"""An entry of the table of labels that Connectome Workbench and TotalSegmentator write."""
CDATA = re.compile(rb"^\s*<!\[CDATA\[(.*?)\]\]>\s*$", re.DOTALL)


def read_nifti(path: Path, frame: int | None, affine: str | None = None) -> Volume:
    """Read one frame; see `quadriform.imaging.reading.read_volume`."""
    head, data = pair_of(path) if is_pair(path) else (path, path)
    with _opened(head) as stream:
        header = _read_header(stream, head)
        if data == head:
            return _read(stream, header, header.sizeof_hdr, path, data, frame, affine)
    with _opened(data) as stream:
        return _read(stream, header, 0, path, data, frame, affine)


def nifti_times(path: Path) -> tuple[int, Array | None]:
    """The number of frames and their times (frames,) in ms; None where the header names no step or no unit of time.

    Raises:
        InputError, FileFormatError, MaskError: as `read_nifti`.
    """
    head = pair_of(path)[0] if is_pair(path) else path
    with _opened(head) as stream:
        header = _read_header(stream, head)
    n = _shape(header, path)[3]
    step, start = float(header["pixdim"][4]), float(header["toffset"])
    scale = MILLISECONDS.get(int(header["xyzt_units"]) & 0x38)
    if n == 1 or scale is None or not (0 < step < np.inf and np.isfinite(start)):
        return n, None
    return n, scale * (start + step * np.arange(n, dtype=np.float64))


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """The content, expanded; what goes wrong while it is read becomes one error."""
    try:
        raw = path.open("rb")
    except OSError as error:
        raise InputError(f"{str(path)!r}: cannot be read: {error.strerror}") from error
    with raw:
        compressed = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        if compressed != path.name.lower().endswith(".gz"):
            found = "a gzip file" if compressed else "no gzip file"
            raise FileFormatError(f"{str(path)!r}: by its content this is {found}; give it the name that fits")
        try:
            yield cast(IO[bytes], gzip.GzipFile(fileobj=raw) if compressed else raw)
        except (OSError, EOFError, zlib.error) as error:
            raise FileFormatError(f"{str(path)!r}: damaged or cut short: {error}; fetch the file again") from error


def _read(
    stream: IO[bytes],
    header: "Nifti1Header",
    at: int,
    path: Path,
    data: Path,
    frame: int | None,
    affine: str | None,
) -> Volume:
    """The image of a header, from a stream that stands at byte `at` of the file with the voxels."""
    shape, dtype = _shape(header, path), _dtype(header, path)
    chosen = choose_frame(frame, shape, path)
    scale = _scale(header, path)
    world, space, unit, warnings = _world(header, shape, path, affine)
    block = int(np.prod(shape[:3], dtype=object)) * dtype.itemsize
    start = _start(header, path, at)
    _check_promise(start + block * shape[3], data)

    extensions = stream.read(min(start - at, MAX_EXTENSIONS))
    _skip(stream, start - at - len(extensions) + block * chosen)
    content = stream.read(block)
    missing = block * (shape[3] - chosen) - len(content) - _skip(stream, MAX_BYTES)
    if missing > 0:
        raise FileFormatError(f"{str(data)!r}: cut short: {missing} bytes of the {shape} voxels are missing")
    if stream.read(1):
        raise FileLimitError(f"{str(data)!r}: expands to more than the budget of {MAX_BYTES} bytes")

    values = np.frombuffer(content, dtype).reshape(shape[:3], order="F").astype(dtype.newbyteorder("="), copy=False)
    segments = _label_table(extensions)
    labels = bool(segments) or int(header["intent_code"]) == LABELS
    try:
        return Volume(_scaled(values, *scale), world, space, unit, warnings, segments, labels)
    except MaskError as error:
        raise MaskError(f"{str(path)!r}: {error}") from error


def _label_table(extensions: bytes) -> tuple[Segment, ...]:
    """The names of labels that stand between header and voxels; 0 is the background whatever it is called."""
    found = []
    for key, content in LABEL.findall(extensions):
        inner = CDATA.match(content)
        text = inner[1].decode("utf-8", "replace") if inner else html.unescape(content.decode("utf-8", "replace"))
        if int(key) > 0:
            found.append(Segment(text.strip(), int(key), (int(key),)))
    return tuple(found)


def _read_header(stream: IO[bytes], path: Path) -> "Nifti1Header":
    from nibabel.nifti1 import Nifti1Header
    from nibabel.nifti2 import Nifti2Header

    first = stream.read(4)
    expected = (b"ni1", b"ni2") if is_pair(path) else (b"n+1", b"n+2")
    for kind, magic in zip((Nifti1Header, Nifti2Header), expected):
        for endianness in ("little", "big"):
            if first == kind.sizeof_hdr.to_bytes(4, endianness):
                block = first + stream.read(kind.sizeof_hdr - 4)
                if len(block) < kind.sizeof_hdr:
                    raise FileFormatError(f"{str(path)!r}: cut short: it ends within its header")
                header = kind(block, endianness=endianness, check=False)
                if header["magic"].item() == magic:
                    return header
                raise FileFormatError(f"{str(path)!r}: {_foreign(header['magic'].item(), path)}")
    raise FileFormatError(f"{str(path)!r}: not a NIfTI image; its first bytes are {first!r}")


def _foreign(magic: bytes, path: Path) -> str:
    """What a header is that begins as NIfTI does, but has other letters than its name needs."""
    if magic in (b"ni1", b"ni2", b"n+1", b"n+2"):
        return (
            "one of a pair of files by its content, and so should be called .hdr"
            if magic.startswith(b"ni")
            else ("an image in one file by its content, and so should be called .nii")
        )
    if path.name.lower().endswith((".hdr", ".img", ".hdr.gz", ".img.gz")):
        return "an Analyze image, which does not say where left and right are; convert it to NIfTI"
    return f"not a NIfTI image: expected the letters 'n+1' or 'n+2' in its header, found {magic!r}"


def _shape(header: "Nifti1Header", path: Path) -> Size:
    """Voxels along i, j, k and frames."""
    dim = [int(size) for size in header["dim"]]
    shape = tuple(dim[1 : dim[0] + 1])
    if not 1 <= dim[0] <= 7 or min(shape) < 1:
        raise FileFormatError(f"{str(path)!r}: the header has impossible dimensions {dim}")
    while len(shape) > 4 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) not in (3, 4):
        raise MaskError(f"{str(path)!r}: expected a three-dimensional image, found shape {shape}")
    return shape[0], shape[1], shape[2], shape[3] if len(shape) == 4 else 1


def _dtype(header: "Nifti1Header", path: Path) -> np.dtype[Any]:
    try:
        dtype = header.get_data_dtype()
    except KeyError as error:
        raise FileFormatError(f"{str(path)!r}: the header has the unknown data type {error}") from error
    if dtype.kind not in "iuf":
        raise MaskError(f"{str(path)!r}: expected one real number a voxel, found type {dtype}")
    return dtype


def _start(header: "Nifti1Header", path: Path, at: int) -> int:
    offset = float(header["vox_offset"])
    if not at <= offset <= MAX_BYTES:
        raise FileFormatError(f"{str(path)!r}: the header says that its voxels begin at byte {offset:g}")
    return int(offset)


def _check_promise(promised: int, path: Path) -> None:
    if promised > MAX_BYTES:
        raise FileLimitError(f"{str(path)!r}: the header promises {promised} bytes; the budget is {MAX_BYTES}")
    size = path.stat().st_size
    if promised > size * (MAX_EXPANSION if path.name.lower().endswith(".gz") else 1):
        raise FileFormatError(f"{str(path)!r}: cut short: the header promises {promised} bytes, found {size}")


def _skip(stream: IO[bytes], count: int) -> int:
    """Read over `count` bytes, or to the end, keeping none; return how many there were."""
    left = count
    while left and (chunk := stream.read(min(left, CHUNK))):
        left -= len(chunk)
    return count - left


def _scale(header: "Nifti1Header", path: Path) -> tuple[float, float]:
    slope, intercept = float(header["scl_slope"]), float(header["scl_inter"])
    if slope == 0 or (np.isnan(slope) and (np.isnan(intercept) or intercept == 0)):
        return 1.0, 0.0  # NaN is how nibabel keeps "none" in memory; other programs write it
    if not np.isfinite([slope, intercept]).all():
        raise FileFormatError(f"{str(path)!r}: slope {slope:g} and intercept {intercept:g}; expected finite numbers")
    return slope, intercept


def _scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[Any]:
    if (slope, intercept) == (1.0, 0.0):
        return values  # labels stay whole numbers
    return values.astype(np.float64) * slope + intercept


def _world(header: "Nifti1Header", shape: Size, path: Path, affine: str | None) -> tuple[Array, str, str, Warnings]:
    """World mm from voxels, its frame and unit, and what is doubtful: two forms that disagree, no unit."""
    forms = read_forms(header, shape, path)
    used, warnings = choose_form(forms, affine)
    scale = MILLIMETRES.get(int(header["xyzt_units"]) & 7)
    if not scale:
        warnings[WarningKind.UNKNOWN_UNIT] = "the image names no unit of length (xyzt_units): its lengths are as stored"
    to_world = np.eye(4)
    to_world[:3, :3] = (scale or 1.0) * (np.eye(3) if used == "pixdim" else HALF_TURN)
    space = "unknown" if used == "pixdim" else "LPS"
    return to_world @ forms.stored[used], space, "mm" if scale else "unknown", warnings
