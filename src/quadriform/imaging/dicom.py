"""DICOM: a folder of slices, one file of a series, or a file of many images.

pydicom decodes headers and pixels. `dicom_files` finds the files of a series, `dicom_headers` the planes of a file,
`dicom_stack` their order, `dicom_spacing` all spacings. `dicom_values.KEYWORDS` lists all attributes that are read: the
name, the number and the date of birth of the patient are not among them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import InputError, OptionError, WarningKind, Warnings
from quadriform.files.reading import PathLike, check_budget, named_in_errors, quoted
from quadriform.imaging.dicom_files import Folder, Series, decoding, examine, examine_folder
from quadriform.imaging.dicom_headers import planes_of
from quadriform.imaging.dicom_segments import label_image
from quadriform.imaging.dicom_spacing import LISTED, ImagePlane
from quadriform.imaging.dicom_stack import SliceStack, stack_slices
from quadriform.imaging.dicom_values import Dataset, is_segmentation, n_images
from quadriform.imaging.formats import choose_frame, import_reader
from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.words import first_of

Headers = dict[Path, Dataset]
"""The headers of the files of one series."""


def read_dicom(path: PathLike, frame: int | None = None, series: str | None = None) -> Volume:
    """Return one frame of a DICOM series in LPS millimetres; a segmentation as a label image with names.

    Slices are placed by ImagePositionPatient alone; `quadriform.imaging.dicom_spacing` has the rules, also those of
    nuclear medicine and segmentations, which state a spacing. Frames are sorted by TriggerTime, else AcquisitionTime,
    else InstanceNumber; those of enhanced files by NominalCardiacTriggerDelayTime, else TemporalPositionIndex; those of
    gated nuclear medicine by time slot. RescaleSlope and RescaleIntercept are applied once. Files of other series in
    the same folder do not matter; files that are damaged before they name their series are left out with the warning
    UNREADABLE_FILES.

    Args:
        path: a folder with the files of a series, one file of a series (the others are searched in its folder), or a
            file that contains all slices.
        frame: which frame of a moving image, from 0.
        series: SeriesInstanceUID, where a folder contains several.

    Raises:
        InputError: no such file, an object without images (its class is named), several series, a ragged one (the
            slices are named), or pydicom is not installed.
        FileFormatError: no DICOM, damaged, or cut short.
        FileLimitError: beyond the budget.
        AffineError: positions, orientations or spacings are missing or unusable.
        MaskError: several frames and none chosen, colour, NaN, or no slices.
        OptionError: there is no such frame or series.
    """
    path = Path(path)
    headers, warnings = _headers(path, series)
    file, header = next(iter(headers.items()))
    if is_segmentation(header):
        choose_frame(frame, (0, 0, 0, 1), path)
        with decoding(file):
            return label_image(header, _pixels(file), file, warnings)
    stack = _stack(path, headers, warnings)
    first = stack.frames[0]
    planes = stack.frames[choose_frame(frame, (*first[0].size, len(first), len(stack.frames)), path)]
    values = np.stack(list(_images(planes)), axis=-1)
    with named_in_errors(path):
        return Volume(values, stack.world_from_voxel, warnings=warnings)


def dicom_times(path: Path) -> tuple[int, Array | None]:
    """Return the number of frames of a series, and their mean trigger times (frames,) in ms, where it has them.

    Raises:
        InputError, FileFormatError, AffineError, MaskError: as `read_dicom`.
    """
    headers, warnings = _headers(path)
    if any(map(is_segmentation, headers.values())):
        return 1, None
    stack = _stack(path, headers, warnings)
    return len(stack.frames), stack.times


def _headers(path: Path, series: str | None = None) -> tuple[Headers, Warnings]:
    """The headers of the requested series, and UNREADABLE_FILES of its folder."""
    own: Headers = {}
    if path.is_dir():
        folder = examine_folder(path)
        chosen = _chosen(folder, series, path)
    else:
        examined = examine(path)
        if examined.header is None:
            raise examined.fault or InputError(f"{quoted(path)}: no image")
        own = {path: examined.header}
        if _is_whole(examined.header):
            return own, {}
        folder = examine_folder(path.parent)
        chosen = folder.series.get(examined.series or "", Series())
    if chosen.faults:
        raise chosen.faults[0]
    headers = own | chosen.headers
    whole = [file.name for file, header in headers.items() if _is_whole(header)]
    if whole and len(headers) > 1:
        listed = first_of(whole, LISTED)
        raise InputError(f"{quoted(path)}: the series has {len(whole)} files of many images; choose one of {listed}")
    return headers, _left_out(folder)


def _is_whole(header: Dataset) -> bool:
    """Whether a file is an image of its own, not one slice of a series."""
    return n_images(header) > 1 or is_segmentation(header)


def _left_out(folder: Folder) -> Warnings:
    if not folder.unreadable:
        return {}
    names = first_of([file.name for file in folder.unreadable], LISTED)
    why = next(iter(folder.unreadable.values()))
    return {
        WarningKind.UNREADABLE_FILES: f"{len(folder.unreadable)} files beside the series are left out, for they cannot "
        f"be read ({names}): {why}; slices may be missing at the ends of the stack"
    }


def _stack(path: Path, headers: Headers, warnings: Warnings) -> SliceStack:
    planes = []
    for file, header in headers.items():
        with decoding(file):
            planes += planes_of(header, file)
    try:
        with named_in_errors(path):
            return stack_slices(planes)
    except InputError as error:
        if not warnings:
            raise
        raise type(error)(f"{error}; {next(iter(warnings.values()))}") from error


def _chosen(folder: Folder, series: str | None, path: Path) -> Series:
    found = folder.series
    listed = "; ".join(_describe(uid, one) for uid, one in found.items())
    if not found:
        raise _without_images(folder, path)
    if series is not None and series not in found:
        raise OptionError(f"option series={series!r}: {quoted(path)} contains {listed}")
    if series is None and len(found) > 1:
        raise InputError(f"{quoted(path)}: {len(found)} series: {listed}; give the path of a file of one series")
    return found[series] if series is not None else next(iter(found.values()))


def _without_images(folder: Folder, path: Path) -> Exception:
    """The error for a folder without images: of a damaged file, else the classes of the other objects."""
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


def _images(planes: tuple[ImagePlane, ...]) -> Iterator[NDArray[Any]]:
    """The pixels (columns, rows) of each plane; consecutive planes of one file read it once."""
    scaled = any(plane.rescale != (1.0, 0.0) for plane in planes)
    file, pixels, total = None, np.empty(0), 0
    for plane in planes:
        if plane.file != file:
            file, pixels = plane.file, _pixels(plane.file)
            check_budget(total := total + pixels.nbytes, f"the series of {quoted(file)}")
        image = pixels[plane.index].T
        # labels stay whole numbers where nothing is scaled (PS3.3, C.11.1)
        yield image.astype(np.float64) * plane.rescale[0] + plane.rescale[1] if scaled else image


def _pixels(file: Path) -> NDArray[Any]:
    """The stored values of all images of a file, (images, rows, columns)."""
    pydicom = import_reader("pydicom", file)
    with decoding(file):
        content = pydicom.dcmread(file, force=True)
        bits = int(content.get("BitsAllocated", 8))
        check_budget(n_images(content) * int(content.Rows) * int(content.Columns) * bits // 8, quoted(file))
        pixels = _decoded(content)
        return pixels if pixels.ndim == 3 else pixels[None]


def _decoded(content: Any) -> NDArray[Any]:
    """The pixels of a file.

    Raises:
        InputError: there is no decoder; the message names the compression.
    """
    from pydicom import uid

    encodings = {
        (True, True): uid.ImplicitVRLittleEndian,
        (False, True): uid.ExplicitVRLittleEndian,
        (False, False): uid.ExplicitVRBigEndian,
    }
    # PS3.10, 7.1: a file without meta information is not compressed; its elements show the byte order
    if "TransferSyntaxUID" not in content.file_meta:
        content.file_meta.TransferSyntaxUID = encodings[content.original_encoding]
    try:
        return np.asarray(content.pixel_array)
    except RuntimeError as error:
        if "missing dependencies" not in str(error):
            raise
        raise InputError(
            f"its pixels are compressed ({content.file_meta.TransferSyntaxUID.name}), and no decoder for it is "
            "installed; pip install 'pylibjpeg[all]', or write the images uncompressed"
        ) from error
