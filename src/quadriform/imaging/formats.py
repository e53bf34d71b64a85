"""The format of an image file by its content; by its name only where the content is of no known format."""

import re
import zlib
from pathlib import Path
from typing import Literal

from quadriform.errors import InputError
from quadriform.files.reading import visible_files
from quadriform.imaging.dicom_files import DICOM_SUFFIXES, PREAMBLE, is_dicom

Format = Literal["nifti", "simpleitk", "dicom"]

NIFTI_SUFFIXES = (".nii", ".nii.gz", ".hdr", ".img", ".hdr.gz", ".img.gz")
TEXT_SUFFIXES = (".nrrd", ".nhdr", ".mha", ".mhd")
SUFFIXES: dict[str, Format] = {
    **dict.fromkeys(NIFTI_SUFFIXES, "nifti"),
    **dict.fromkeys(TEXT_SUFFIXES, "simpleitk"),
    **dict.fromkeys(DICOM_SUFFIXES, "dicom"),
}
HEADER_SIZES = (348, 540)
"""sizeof_hdr of NIfTI-1 and Analyze, and of NIfTI-2: the first four bytes of a file."""
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
    if not path.is_file():
        return b""
    try:
        with path.open("rb") as stream:
            start = stream.read(BLOCK)
        return zlib.decompressobj(WITH_GZIP).decompress(start, BLOCK) if start.startswith(b"\x1f\x8b") else start
    except (OSError, zlib.error):
        return b""
