"""The DICOM files of a folder by their content: images by series, objects of other classes, damaged files."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from quadriform.errors import FileFormatError, InputError, QuadriformError
from quadriform.files.reading import check_budget, check_readable, first_bytes, named_in_errors, quoted, visible_files
from quadriform.imaging.dicom_values import KEYWORDS, Dataset, n_images
from quadriform.imaging.formats import DICOM_SUFFIXES, PREAMBLE, import_reader, is_dicom

SERIES_TAG = 0x0020000E
"""Of SeriesInstanceUID."""
PIXELS = (0x7FE00008, 0x7FE00009, 0x7FE00010)
UNDEFINED = 0xFFFFFFFF
"""The length of an element that ends with a delimiter (PS3.5, 7.1)."""
IMAGES = ("Image Storage", "Segmentation Storage", "RT Dose Storage", "Parametric Map Storage")
HINTS = {
    "RT Structure Set Storage": "; its contours are not read: write them as a mask or a DICOM segmentation first",
    "Media Storage Directory Storage": ", an index of other files; give the folder with the slices of one series",
}


@dataclass(frozen=True)
class Examined:
    """What the header of a DICOM file contains.

    Attributes:
        header: of a file with images; None for others.
        series: SeriesInstanceUID; None where it could not be read.
        kind: name of its SOP class; empty where it could not be read.
        fault: why it gives no images.
    """

    header: Dataset | None
    series: str | None
    kind: str
    fault: QuadriformError | None


@dataclass
class Series:
    """Files with the same SeriesInstanceUID.

    Attributes:
        headers: of the files with images.
        faults: of those that should have images and cannot be read.
    """

    headers: dict[Path, Dataset] = field(default_factory=dict)
    faults: list[QuadriformError] = field(default_factory=list)


@dataclass
class Folder:
    """The DICOM files of a folder.

    Attributes:
        series: with images, by SeriesInstanceUID.
        others: names of the classes of objects without images.
        unreadable: faults of files whose series could not be read.
    """

    series: dict[str, Series] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)
    unreadable: dict[Path, QuadriformError] = field(default_factory=dict)


def examine_folder(folder: Path) -> Folder:
    """Return what the DICOM files of a folder contain, without hidden files and indices."""
    found = Folder()
    for file in visible_files(folder):
        if file.name == "DICOMDIR" or not _meant_as_dicom(file):
            continue
        examined = examine(file)
        if examined.header is not None:
            found.series.setdefault(examined.series or "", Series()).headers[file] = examined.header
        elif examined.fault is not None and examined.series is not None and _has_images(examined.kind):
            found.series.setdefault(examined.series, Series()).faults.append(examined.fault)
        elif examined.kind and not _has_images(examined.kind):
            found.others.append(examined.kind)
        elif examined.fault is not None:
            found.unreadable[file] = examined.fault
    return found


def _meant_as_dicom(file: Path) -> bool:
    """Whether a file may be a slice, even a damaged one: not text, and without the suffix of another format."""
    suffix = file.suffix.lower()
    return suffix in DICOM_SUFFIXES or is_dicom(file) or (suffix == "" and b"\0" in first_bytes(file, PREAMBLE + 4))


def examine(file: Path) -> Examined:
    """Return the header of a file, and whether it has pixels.

    Raises:
        InputError: pydicom is not installed.
    """
    import_reader("pydicom", file)
    try:
        header, pixels, cut = _parsed(file)
        with decoding(file):
            for keyword in KEYWORDS:
                header.get(keyword)  # pydicom decodes a value on access: damage is found here
            n_images(header)
        check_budget(file.stat().st_size, quoted(file))
        fault = None if pixels else _no_pixels(file, _class_name(header), cut)
        return Examined(header if fault is None else None, _series(header), _class_name(header), fault)
    except QuadriformError as error:
        return _examined_before_damage(file, error)


def _examined_before_damage(file: Path, fault: QuadriformError) -> Examined:
    """What can be read of a damaged file before the damage."""
    try:
        header, *_ = _parsed(file, SERIES_TAG)
    except QuadriformError:
        return Examined(None, None, "", fault)
    return Examined(None, _series(header), _class_name(header), fault)


def _parsed(file: Path, last: int | None = None) -> tuple[Dataset, bool, bool]:
    """The header to the tag `last`, whether pixels follow, and whether the file ends within an element."""
    from pydicom.filereader import read_partial
    from pydicom.tag import Tag

    size = check_readable(file)
    if not is_dicom(file):
        raise FileFormatError(f"{quoted(file)}: not a DICOM file; it begins with {first_bytes(file, 8)!r}")
    with file.open("rb") as stream, decoding(file):
        stop = _StopCondition(stream, size, last)
        header = read_partial(stream, stop, force=True, specific_tags=[Tag(keyword) for keyword in KEYWORDS])
    if stop.cut_in is not None and stop.cut_in in header:
        del header[stop.cut_in]  # its value is incomplete
    return header, stop.pixels, stop.cut_in is not None


class _StopCondition:
    """Called by pydicom before each element; stops at the pixels, or behind the tag `last`."""

    def __init__(self, stream: IO[bytes], size: int, last: int | None) -> None:
        self.stream, self.size, self.last = stream, size, last
        self.pixels = False
        self.cut_in: int | None = None

    def __call__(self, tag: int, vr: str | None, length: int) -> bool:
        self.pixels |= tag in PIXELS
        at = self.stream.tell()
        # at the end of the file the element was inflated in memory, and its length means nothing here
        if not self.pixels and length != UNDEFINED and at < self.size < at + length:
            self.cut_in = tag
        return self.pixels or (self.last is not None and tag > self.last)


def _no_pixels(file: Path, kind: str, cut: bool) -> QuadriformError:
    if cut:
        return FileFormatError(f"{quoted(file)}: cut short: it ends within its header; fetch the file again")
    if not kind:
        return FileFormatError(f"{quoted(file)}: neither pixels nor a SOP class; is it DICOM, and whole?")
    if _has_images(kind):
        return FileFormatError(
            f"{quoted(file)}: {kind} without pixels: cut short before them, or written without; fetch the file again"
        )
    return InputError(
        f"{quoted(file)}: a DICOM object of the class {kind!r}, which contains no images{HINTS.get(kind, '')}"
    )


def _has_images(kind: str) -> bool:
    return kind != "Surface Segmentation Storage" and (not kind or any(word in kind for word in IMAGES))


def _class_name(header: Dataset) -> str:
    from pydicom.uid import UID

    meta = getattr(header, "file_meta", None) or {}
    try:
        uid = header.get("SOPClassUID") or meta.get("MediaStorageSOPClassUID")
        return UID(str(uid)).name if uid else ""
    except Exception:  # a damaged value can raise anything in the decoder
        return ""


def _series(header: Dataset) -> str | None:
    try:
        uid = header.get("SeriesInstanceUID")
    except Exception:  # a damaged value can raise anything in the decoder
        return None
    return None if uid is None else str(uid)


@contextmanager
def decoding(file: Path) -> Iterator[None]:
    """Turn every exception of the decoder into a FileFormatError, and put the name of the file before all errors.

    Warnings of pydicom are about values that break rules of DICOM; those that matter to the image are checked here.
    """
    with named_in_errors(file), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except QuadriformError:
            raise
        except Exception as error:  # a damaged header can raise anything in the decoder
            text = " ".join(str(error).split())
            raise FileFormatError(f"cannot be decoded; is it DICOM, and whole? {text}") from error
