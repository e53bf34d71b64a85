"""The format of an image file, by its content, or by its name where the content shows none; and rules of all readers.

The reader of each format is in `READERS` of `reading.py`.
"""

import re
import zlib
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Literal

import numpy as np

from quadriform.errors import InputError, MaskError, OptionError
from quadriform.files.reading import first_bytes, quoted, visible_files

Size = tuple[int, int, int, int]
"""Voxels along i, j and k, and frames."""
Format = Literal["nifti", "simpleitk", "dicom"]

NIFTI_SUFFIXES = (".nii", ".nii.gz", ".hdr", ".img", ".hdr.gz", ".img.gz")
DICOM_SUFFIXES = (".dcm", ".ima")
TEXT_SUFFIXES = (".nrrd", ".nhdr", ".mha", ".mhd")
SUFFIXES: dict[str, Format] = {
    **dict.fromkeys(NIFTI_SUFFIXES, "nifti"),
    **dict.fromkeys(TEXT_SUFFIXES, "simpleitk"),
    **dict.fromkeys(DICOM_SUFFIXES, "dicom"),
}
HEADER_SIZES = (348, 540)
"""sizeof_hdr of NIfTI-1 and Analyze, and of NIfTI-2: the first four bytes of a file."""
PREAMBLE = 128
"""Bytes before the letters DICM (PS3.10, 7.1)."""
FIRST_GROUPS = (b"\x02\x00", b"\x08\x00", b"\x00\x08")
"""Groups of the first element of a file without these letters, in either byte order."""
SHORT = 1 << 16
"""The first element of such a file is shorter, where it does not name its value representation."""
META_FIRST = re.compile(rb"\s*(ObjectType|NDims|Comment|ObjectSubType)\s*=")
BLOCK = 4096
WITH_GZIP = 31
"""zlib's wbits: a window of 32 kB, and a gzip header."""


def image_format(path: Path) -> Format | None:
    """Return the format of an image, or None for other files; a folder is DICOM when a file in it is.

    Args:
        path: of a file or folder.
    """
    if path.is_dir():
        slices = (file.suffix.lower() in DICOM_SUFFIXES or is_dicom(file) for file in visible_files(path))
        return "dicom" if any(slices) else None
    return _by_content(path) or _by_name(path)


def is_dicom(path: Path) -> bool:
    """Return whether a file is DICOM by its content: the letters DICM, or a first element without them."""
    start = first_bytes(path, PREAMBLE + 4)
    return start[PREAMBLE:] == b"DICM" or _begins_with_element(start)


def _begins_with_element(start: bytes) -> bool:
    """A value representation of two capital letters after the tag, or a short length (PS3.5, 7.1)."""
    if start[:2] not in FIRST_GROUPS or len(start) < PREAMBLE:
        return False
    named = start[4:6].isalpha() and start[4:6].isupper()
    return named or (start[3] == 0 and 0 < int.from_bytes(start[4:8], "little") < SHORT)


def is_pair(path: Path) -> bool:
    """Return whether a name is that of an image in two files, .hdr and .img."""
    return path.name.lower().removesuffix(".gz").endswith((".hdr", ".img"))


def pair_of(path: Path) -> tuple[Path, Path]:
    """Return the files of the header and of the voxels of an image in two files, from the path of one.

    Raises:
        InputError: the other file is missing.
    """
    name, packed = path.name, ".gz" if path.name.lower().endswith(".gz") else ""
    stem = name[: len(name) - len(".hdr" + packed)]
    own = name[len(stem) : len(stem) + 4]
    found: list[Path] = []
    for suffix in (".hdr", ".img"):
        # the other file is named in capitals where this one is
        letters = suffix.upper() if own.isupper() else suffix
        file = path if own.lower() == suffix else path.with_name(stem + letters + packed)
        if not file.is_file():
            raise InputError(f"{str(path)!r}: expected a header (.hdr) and voxels (.img); {file.name!r} is missing")
        found.append(file)
    return found[0], found[1]


def _by_content(path: Path) -> Format | None:
    start = _start(path)  # NIfTI begins with sizeof_hdr, NRRD with a magic, MetaImage with one of its first keys
    if any(start[:4] == size.to_bytes(4, order) for size in HEADER_SIZES for order in ("little", "big")):
        return "nifti"
    if start.startswith(b"NRRD000") or META_FIRST.match(start):
        return "simpleitk"
    return "dicom" if len(start) > PREAMBLE and is_dicom(path) else None


def _by_name(path: Path) -> Format | None:
    name = path.name.lower()
    return next((kind for suffix, kind in SUFFIXES.items() if name.endswith(suffix)), None)


def _start(path: Path) -> bytes:
    """The first bytes of a regular file, expanded where it is compressed by gzip."""
    start = first_bytes(path, BLOCK)
    try:
        return zlib.decompressobj(WITH_GZIP).decompress(start, BLOCK) if start.startswith(b"\x1f\x8b") else start
    except zlib.error:
        return b""


# --- rules of all readers ------------------------------------------------------------------------------------------


def choose_frame(frame: int | None, shape: Size, path: Path) -> int:
    """Return the frame to read from an image of `shape`; None is valid for an image of one frame.

    Raises:
        MaskError: there are several, and none was given.
        OptionError: there is no such frame.
    """
    n = shape[3]
    if frame is None and n > 1:
        raise MaskError(
            f"{quoted(path)}: a four-dimensional image of shape {shape}; choose frame=0 to frame={n - 1}, or follow "
            "them all with track"
        )
    if frame is not None and not (isinstance(frame, (int, np.integer)) and 0 <= frame < n):
        raise OptionError(f"option frame={frame!r}: {quoted(path)} has frames 0 to {n - 1}")
    return int(frame or 0)


def import_reader(module: str, path: Path) -> ModuleType:
    """Return the library that reads `path`.

    Raises:
        InputError: it is not installed; the message has the command that does it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{quoted(path)}: reading this format needs {module.split('.')[0]}; pip install 'quadriform[images]'"
        ) from error
