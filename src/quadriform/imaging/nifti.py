"""NIfTI-1 and NIfTI-2 in one file, plain or compressed, read to the last byte.

nibabel decodes the header. It is asked not to repair it: a voxel size of 0 would silently become 1.
"""

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import (
    AffineError,
    FileFormatError,
    FileLimitError,
    InputError,
    MaskError,
    WarningKind,
    Warnings,
)
from quadriform.imaging.frames import Size, choose_frame
from quadriform.imaging.volume import Volume, affine_fault
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
KNOWN_CODES = 5
"""What the format knows to say of a form: 0 for none, up to "another template"."""
SAME_FORM = 0.01
"""Two forms agree when no corner of the image moves by more than this share of the smallest spacing."""


def read_nifti(path: Path, frame: int | None) -> Volume:
    """Read one frame; see `quadriform.imaging.reading.read_volume`."""
    with _opened(path) as stream:
        return _read(stream, path, frame)


def nifti_times(path: Path) -> tuple[int, Array | None]:
    """The number of frames and their times (frames,) in ms; None where the header names no step or no unit of time.

    Raises:
        InputError, FileFormatError, MaskError: as `read_nifti`.
    """
    with _opened(path) as stream:
        header = _read_header(stream, path)
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


def _read(stream: IO[bytes], path: Path, frame: int | None) -> Volume:
    header = _read_header(stream, path)
    shape, dtype = _shape(header, path), _dtype(header, path)
    chosen = choose_frame(frame, shape, path)
    scale = _scale(header, path)
    affine, unit, warnings = _world(header, shape, path)
    block = int(np.prod(shape[:3], dtype=object)) * dtype.itemsize
    start = _start(header, path)
    _check_promise(start + block * shape[3], path)

    _skip(stream, start - header.sizeof_hdr + block * chosen)
    data = stream.read(block)
    missing = block * (shape[3] - chosen) - len(data) - _skip(stream, MAX_BYTES)
    if missing > 0:
        raise FileFormatError(f"{str(path)!r}: cut short: {missing} bytes of the {shape} voxels are missing")
    if stream.read(1):
        raise FileLimitError(f"{str(path)!r}: expands to more than the budget of {MAX_BYTES} bytes")

    values = np.frombuffer(data, dtype).reshape(shape[:3], order="F").astype(dtype.newbyteorder("="), copy=False)
    try:
        return Volume(_scaled(values, *scale), affine, "LPS", unit, warnings)
    except MaskError as error:
        raise MaskError(f"{str(path)!r}: {error}") from error


def _read_header(stream: IO[bytes], path: Path) -> "Nifti1Header":
    from nibabel.nifti1 import Nifti1Header
    from nibabel.nifti2 import Nifti2Header

    first = stream.read(4)
    for kind, magic in ((Nifti1Header, b"n+1"), (Nifti2Header, b"n+2")):
        for endianness in ("little", "big"):
            if first == kind.sizeof_hdr.to_bytes(4, endianness):
                block = first + stream.read(kind.sizeof_hdr - 4)
                if len(block) < kind.sizeof_hdr:
                    raise FileFormatError(f"{str(path)!r}: cut short: it ends within its header")
                header = kind(block, endianness=endianness, check=False)
                if header["magic"].item() == magic:
                    return header
    raise FileFormatError(f"{str(path)!r}: not a NIfTI image in one file (.nii); its first bytes are {first!r}")


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


def _start(header: "Nifti1Header", path: Path) -> int:
    offset = float(header["vox_offset"])
    if not header.sizeof_hdr <= offset <= MAX_BYTES:
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
    if slope == 0:
        return 1.0, 0.0
    if not np.isfinite([slope, intercept]).all():
        raise FileFormatError(f"{str(path)!r}: slope {slope:g} and intercept {intercept:g}; expected finite numbers")
    return slope, intercept


def _scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[Any]:
    if (slope, intercept) == (1.0, 0.0):
        return values  # labels stay whole numbers
    return values.astype(np.float64) * slope + intercept


def _world(header: "Nifti1Header", shape: Size, path: Path) -> tuple[Array, str, Warnings]:
    """World LPS mm from voxels, the unit, and what is doubtful: two forms that disagree, no unit."""
    stored = {"sform": header.get_sform(), "qform": _qform(header)}
    codes = {name: int(header[f"{name}_code"]) for name in stored}
    if not all(0 <= code <= KNOWN_CODES for code in codes.values()):
        raise AffineError(f"{str(path)!r}: form codes {codes}; expected 0 to {KNOWN_CODES}: the header is damaged")
    used = next((name for name, code in codes.items() if code > 0), "")
    fault = affine_fault(stored[used]) if used else "no form has a code above 0"
    if fault:
        forms = "; ".join(f"{name} (code {codes[name]}) {form.tolist()}" for name, form in stored.items())
        raise AffineError(
            f"{str(path)!r}: no usable transform to the world ({used or 'sform and qform'}: {fault}); {forms}; "
            "repair the header, or build a Volume from the voxels and a transform of your own"
        )
    scale = MILLIMETRES.get(int(header["xyzt_units"]) & 7)
    to_lps = np.eye(4)
    to_lps[:3, :3] = (scale or 1.0) * HALF_TURN
    warnings: Warnings = {}
    if used == "sform" and codes["qform"] > 0 and (difference := _difference(stored, shape)):
        warnings[WarningKind.AFFINE_REPAIRED] = difference
    if not scale:
        warnings[WarningKind.UNKNOWN_UNIT] = "the image names no unit of length (xyzt_units): its lengths are as stored"
    return to_lps @ stored[used], "mm" if scale else "unknown", warnings


def _qform(header: "Nifti1Header") -> Array:
    """The qform as stored, NaN where it cannot be computed."""
    from nibabel.spatialimages import HeaderDataError

    header = header.copy()
    if header["pixdim"][0] == 0:
        header["pixdim"][0] = 1  # the format says so
    try:
        return header.get_qform()
    except (HeaderDataError, ValueError):
        return np.full((4, 4), np.nan)


def _difference(forms: dict[str, Array], shape: Size) -> str:
    """How far apart sform and qform put the corners of the image; empty when they agree."""
    sform, qform = forms["sform"], forms["qform"]
    corners = np.array([(*corner, 1) for corner in np.ndindex(2, 2, 2)]) * (*np.array(shape[:3]) - 1, 1)
    apart = float(np.linalg.norm(corners @ (sform - qform).T, axis=1).max())
    lengths_s, lengths_q = (np.linalg.norm(form[:3, :3], axis=0) for form in (sform, qform))
    if apart <= SAME_FORM * lengths_s.min():
        return ""
    if affine_fault(qform):
        return f"the qform is unusable ({affine_fault(qform)}); the sform is used"
    cosines = (sform[:3, :3] * qform[:3, :3]).sum(axis=0) / (lengths_s * lengths_q)
    degrees = float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max())
    return (
        f"sform and qform put a corner of the image {apart:.4g} (in the file's unit) apart and differ by "
        f"{degrees:.3g} degrees; the sform is used"
    )
