"""DICOM: a folder of slices, one file of a series, or a file of many images.

pydicom decodes headers and pixels; what each file is is told by `dicom_files`, where its planes lie by
`dicom_headers`, and their order by `planes`. Nothing of the patient is kept.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import InputError, MaskError, OptionError, WarningKind, Warnings
from quadriform.files.reading import PathLike, check_budget, quoted
from quadriform.imaging.dicom_files import Folder, Series, decoding, examine, examine_folder
from quadriform.imaging.dicom_headers import is_segmentation, n_images, planes_of
from quadriform.imaging.dicom_segments import label_map
from quadriform.imaging.dicom_stack import LISTED, ImagePlane, SliceStack, stack_slices
from quadriform.imaging.reader_common import choose_frame, import_reader
from quadriform.imaging.volume import Volume
from quadriform.points import Array

if TYPE_CHECKING:
    from pydicom import Dataset

Chosen = tuple[dict[Path, "Dataset"], Warnings]
"""The headers of one series, and what was left out beside it."""


def read_dicom(path: PathLike, frame: int | None = None, series: str | None = None) -> Volume:
    """Read one frame of a DICOM series into world LPS millimetres; a segmentation as a label image with names.

    Slices are spaced by ImagePositionPatient alone; SliceThickness and SliceLocation are not looked at. Frames are
    sorted by TriggerTime, else AcquisitionTime, else InstanceNumber. RescaleSlope and RescaleIntercept are applied
    once. Files of other series beside it do not matter; files that are damaged before they name their series are
    left out with the warning UNREADABLE_FILES.

    Args:
        path: a folder with the files of a series, one file of a series (the others are looked for beside it), or a
            file that holds all slices.
        frame: which frame of a moving image, from 0.
        series: SeriesInstanceUID, where a folder holds several.

    Raises:
        InputError: no such file, an object without images (its class is named), several series, a ragged one (the
            slices are named), or pydicom is not installed.
        FileFormatError: no DICOM, damaged, or cut short.
        FileLimitError: beyond the budget.
        AffineError: positions, orientations or spacings are missing or cannot be.
        MaskError: several frames and none chosen, colour, NaN, or no slices.
        OptionError: there is no such frame or series.
    """
    path = Path(path)
    headers, warnings = _headers(path, series)
    file, header = next(iter(headers.items()))
    if is_segmentation(header):
        choose_frame(frame, (0, 0, 0, 1), path)
        with decoding(file):
            return label_map(header, _pixels(file), file, warnings)
    stack = _stack(path, headers, warnings)
    first = stack.frames[0][0]
    shape = (*first.size, len(stack.frames[0]), len(stack.frames))
    planes = stack.frames[choose_frame(frame, shape, path)]
    values = np.stack(list(_images(planes)), axis=-1)
    try:
        return Volume(values, stack.world_from_voxel, warnings=warnings)
    except MaskError as error:
        raise MaskError(f"{quoted(path)}: {error}") from error


def dicom_times(path: Path) -> tuple[int, Array | None]:
    """The number of frames of a series, and their mean trigger times (frames,) in ms, where the headers have them.

    Raises:
        InputError, FileFormatError, AffineError, MaskError: as `read_dicom`.
    """
    headers, warnings = _headers(path)
    if any(map(is_segmentation, headers.values())):
        return 1, None
    stack = _stack(path, headers, warnings)
    return len(stack.frames), stack.times


def _headers(path: Path, series: str | None = None) -> Chosen:
    """The headers of the series that is meant; a segmentation and a file of many images are each their own."""
    if path.is_dir():
        folder = examine_folder(path)
        headers = _judged(_chosen(folder, series, path))
    else:
        examined = examine(path)
        if examined.fault is not None:
            raise examined.fault
        headers = {path: examined.header} if examined.header is not None else {}
        if any(n_images(header) > 1 or is_segmentation(header) for header in headers.values()):
            return headers, {}
        folder = examine_folder(path.parent)
        headers |= _judged(folder.series.get(examined.series or "", Series()))
    many = [file for file, header in headers.items() if n_images(header) > 1 or is_segmentation(header)]
    if many and len(headers) > 1:
        names = ", ".join(file.name for file in many[:LISTED])
        raise InputError(f"{quoted(path)}: the series has {len(many)} files of many images; choose one of {names}")
    return headers, _left_out(folder)


def _judged(series: Series) -> "dict[Path, Dataset]":
    """The headers of a series without damaged files."""
    if series.faults:
        raise series.faults[0]
    return series.headers


def _left_out(folder: Folder) -> Warnings:
    if not folder.unreadable:
        return {}
    names = ", ".join(file.name for file in list(folder.unreadable)[:LISTED])
    why = next(iter(folder.unreadable.values()))
    return {
        WarningKind.UNREADABLE_FILES: f"{len(folder.unreadable)} files beside the series are left out, for they cannot "
        f"be read ({names}): {why}; slices may be missing at the ends of the stack"
    }


def _stack(path: Path, headers: "dict[Path, Dataset]", warnings: Warnings) -> SliceStack:
    planes = []
    for file, header in headers.items():
        with decoding(file):
            planes += planes_of(header, file)
    try:
        return stack_slices(planes, quoted(path))
    except InputError as error:
        if not warnings:
            raise
        raise type(error)(f"{error}; {next(iter(warnings.values()))}") from error


def _chosen(folder: Folder, series: str | None, path: Path) -> Series:
    found = folder.series
    listed = "; ".join(_describe(uid, one) for uid, one in found.items())
    if not found:
        raise _nothing(folder, path)
    if series is not None and series not in found:
        raise OptionError(f"option series={series!r}: {quoted(path)} holds {listed}")
    if series is None and len(found) > 1:
        raise InputError(f"{quoted(path)}: {len(found)} series: {listed}; give the path of one file of the one meant")
    return found[series] if series is not None else next(iter(found.values()))


def _nothing(folder: Folder, path: Path) -> Exception:
    """The error for a folder without images: a damaged file, else what is there instead."""
    if folder.unreadable:
        return next(iter(folder.unreadable.values()))
    kinds = ", ".join(f"{folder.others.count(kind)} of {kind!r}" for kind in dict.fromkeys(folder.others))
    return InputError(f"{quoted(path)}: no DICOM images in this folder{'; found ' if kinds else ''}{kinds}")


def _describe(uid: str, series: Series) -> str:
    if not series.headers:
        return f"{uid} ({len(series.faults)} files, none of which can be read)"
    file, header = next(iter(series.headers.items()))
    number, modality = header.get("SeriesNumber"), header.get("Modality")
    return f"{uid} (series {number}, {modality}, {len(series.headers)} files, the first {file.name})"


def _bytes(header: "Dataset") -> int:
    return n_images(header) * int(header.Rows) * int(header.Columns) * int(header.get("BitsAllocated", 8)) // 8


def _images(planes: tuple[ImagePlane, ...]) -> Iterator[NDArray[Any]]:
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
    with decoding(file):
        content = pydicom.dcmread(file, force=True)
        check_budget(_bytes(content), quoted(file))
        pixels = _decoded(content, file)
        return pixels if pixels.ndim == 3 else pixels[None]


def _decoded(content: Any, file: Path) -> NDArray[Any]:
    """The pixels, when there is a decoder for their compression.

    Raises:
        InputError: there is none; the message names the compression.
    """
    from pydicom import uid

    encodings = {
        (True, True): uid.ImplicitVRLittleEndian,
        (False, True): uid.ExplicitVRLittleEndian,
        (False, False): uid.ExplicitVRBigEndian,
    }
    if "TransferSyntaxUID" not in content.file_meta:  # then it is not compressed, and the header shows the byte order
        content.file_meta.TransferSyntaxUID = encodings[content.original_encoding]
    try:
        return np.asarray(content.pixel_array)
    except RuntimeError as error:
        if "missing dependencies" not in str(error):
            raise
        raise InputError(
            f"{quoted(file)}: its pixels are compressed ({content.file_meta.TransferSyntaxUID.name}), and no decoder "
            "for it is installed; pip install 'pylibjpeg[all]', or write the images uncompressed"
        ) from error
