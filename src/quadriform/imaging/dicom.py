"""DICOM: a folder of slices, one file of a series, or a file of many images.

pydicom decodes headers and pixels; where the planes lie is told by `dicom_headers`, their order by `planes`. Nothing
of the patient is kept.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, InputError, MaskError, OptionError, QuadriformError
from quadriform.files.reading import PathLike, check_budget, check_readable, quoted
from quadriform.imaging.dicom_headers import TAGS, n_images, planes_of
from quadriform.imaging.frames import choose_frame, import_reader
from quadriform.imaging.planes import Plane, Stack, stack_planes
from quadriform.imaging.volume import Volume
from quadriform.points import Array

if TYPE_CHECKING:
    from pydicom import Dataset

DICOM_SUFFIXES = (".dcm", ".ima")
PREAMBLE = 128
"""Bytes before the letters DICM."""


def read_dicom(path: PathLike, frame: int | None = None, series: str | None = None) -> Volume:
    """Read one frame of a DICOM series into world LPS millimetres.

    Slices are spaced by ImagePositionPatient alone; SliceThickness and SliceLocation are not looked at. Frames are
    sorted by TriggerTime, else AcquisitionTime, else InstanceNumber. RescaleSlope and RescaleIntercept are applied
    once.

    Args:
        path: a folder with the files of a series, one file of a series (the others are looked for beside it), or a
            file that holds all slices.
        frame: which frame of a moving image, from 0.
        series: SeriesInstanceUID, where a folder holds several.

    Raises:
        InputError: no such file, several series, a ragged one (the slices are named), or pydicom is not installed.
        FileFormatError: no DICOM, damaged, or cut short.
        FileLimitError: beyond the budget.
        AffineError: positions, orientations or spacings are missing or cannot be.
        MaskError: several frames and none chosen, colour, NaN, or no slices.
        OptionError: there is no such frame or series.
    """
    path = Path(path)
    stack = _stack(path, series)
    first = stack.frames[0][0]
    shape = (*first.size, len(stack.frames[0]), len(stack.frames))
    planes = stack.frames[choose_frame(frame, shape, path)]
    values = np.stack(list(_images(planes)), axis=-1)
    try:
        return Volume(values, stack.world_from_voxel)
    except MaskError as error:
        raise MaskError(f"{quoted(path)}: {error}") from error


def dicom_times(path: Path) -> tuple[int, Array | None]:
    """The number of frames of a series, and their mean trigger times (frames,) in ms, where the headers have them.

    Raises:
        InputError, FileFormatError, AffineError, MaskError: as `read_dicom`.
    """
    stack = _stack(path)
    return len(stack.frames), stack.times


def is_dicom(path: Path) -> bool:
    """Whether the letters DICM stand where they should in a file."""
    return _beginning(path)[PREAMBLE:] == b"DICM"


def _stack(path: Path, series: str | None = None) -> Stack:
    if path.is_dir():
        headers = _chosen(_by_series(path), series, path)
    else:
        header = _header(path)
        headers = {path: header}
        if n_images(header) == 1:
            headers = _by_series(path.parent)[_uid(header)]
    many = [file for file, header in headers.items() if n_images(header) > 1]
    if many and len(headers) > 1:
        names = ", ".join(file.name for file in many[:6])
        raise InputError(f"{quoted(path)}: the series has {len(many)} files of many images; choose one of {names}")
    planes = []
    for file, header in headers.items():
        with _decoding(file):
            planes += planes_of(header, file)
    return stack_planes(planes, quoted(path))


def _by_series(folder: Path) -> dict[str, dict[Path, "Dataset"]]:
    """Headers of the images in a folder, by SeriesInstanceUID and file.

    Files of other kinds are passed by: hidden ones, indices, and those that neither are DICOM nor should be.
    """
    found: dict[str, dict[Path, Dataset]] = {}
    for file in sorted(folder.iterdir()):
        if file.is_file() and not file.name.startswith(".") and file.name != "DICOMDIR" and _meant_as_dicom(file):
            header = _header(file)
            if _holds_images(header, file):
                found.setdefault(_uid(header), {})[file] = header
    return found


def _meant_as_dicom(file: Path) -> bool:
    """A damaged slice must not go unseen: only text, and names of other formats, are no slices."""
    suffix = file.suffix.lower()
    return suffix in DICOM_SUFFIXES or is_dicom(file) or (suffix == "" and b"\0" in _beginning(file))


def _holds_images(header: "Dataset", file: Path) -> bool:
    """Reports and outlines, by their class, hold none; anything else without a size is cut short."""
    if "Rows" in header:
        return True
    with _decoding(file):
        kind = header.file_meta.MediaStorageSOPClassUID
        if kind.type != "SOP Class" or "Image Storage" in kind.name:
            raise FileFormatError(f"{quoted(file)}: cut short: it ends within its header; fetch the file again")
    return False


def _beginning(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(PREAMBLE + 4)
    except OSError:
        return b""


def _chosen(found: dict[str, dict[Path, "Dataset"]], series: str | None, folder: Path) -> dict[Path, "Dataset"]:
    listed = "; ".join(_describe(uid, headers) for uid, headers in found.items())
    if not found:
        raise InputError(f"{quoted(folder)}: no DICOM images in this folder")
    if series is not None and series not in found:
        raise OptionError(f"option series={series!r}: {quoted(folder)} holds {listed}")
    if series is None and len(found) > 1:
        raise InputError(f"{quoted(folder)}: {len(found)} series: {listed}; give the path of one file of the one meant")
    return found[series] if series is not None else next(iter(found.values()))


def _describe(uid: str, headers: dict[Path, "Dataset"]) -> str:
    file, header = next(iter(headers.items()))
    number, modality = header.get("SeriesNumber"), header.get("Modality")
    return f"{uid} (series {number}, {modality}, {len(headers)} files, the first {file.name})"


def _uid(header: "Dataset") -> str:
    return str(header.get("SeriesInstanceUID"))


def _header(file: Path) -> "Dataset":
    pydicom = import_reader("pydicom", file)
    check_budget(check_readable(file), quoted(file))
    with _decoding(file):
        header = pydicom.dcmread(file, stop_before_pixels=True, specific_tags=TAGS)
        for keyword in TAGS:
            header.get(keyword)  # values are decoded when asked for
        n_images(header)  # so that a count that is none is met here
        return header


def _bytes(header: "Dataset") -> int:
    return n_images(header) * int(header.Rows) * int(header.Columns) * int(header.get("BitsAllocated", 8)) // 8


def _images(planes: tuple[Plane, ...]) -> Iterator[NDArray[Any]]:
    """The pixels (columns, rows) of each plane; each file is read once, for the files of a frame are few or one."""
    scaled = any((plane.slope, plane.intercept) != (1.0, 0.0) for plane in planes)
    file, pixels, total = None, np.empty(0), 0
    for plane in planes:
        if plane.file != file:
            file, pixels = plane.file, _pixels(plane.file)
            check_budget(total := total + pixels.nbytes, f"the series of {quoted(file)}")
        image = pixels[plane.index].T
        # Labels stay whole numbers.
        yield image.astype(np.float64) * plane.slope + plane.intercept if scaled else image


def _pixels(file: Path) -> NDArray[Any]:
    """The stored values of all images of a file, (images, rows, columns)."""
    pydicom = import_reader("pydicom", file)
    with _decoding(file):
        content = pydicom.dcmread(file)
        if not any(keyword in content for keyword in ("PixelData", "FloatPixelData", "DoubleFloatPixelData")):
            raise FileFormatError(f"{quoted(file)}: cut short: it ends before its pixels do; fetch the file again")
        check_budget(_bytes(content), quoted(file))
        pixels = content.pixel_array
        return pixels if pixels.ndim == 3 else pixels[None]


@contextmanager
def _decoding(file: Path) -> Iterator[None]:
    """One error for whatever a decoder meets in a damaged file, and no warnings beside it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except QuadriformError:
        raise
    except Exception as error:  # a damaged header can raise anything in the decoder
        said = " ".join(str(error).split())
        raise FileFormatError(f"{quoted(file)}: cannot be decoded; is it DICOM, and whole? {said}") from error
