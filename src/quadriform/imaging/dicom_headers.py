"""What a DICOM header says about the planes of its file: classic slices, enhanced multi-frame, nuclear medicine.

References: DICOM PS3.3, C.7.6.2 (Image Plane), C.7.6.16 (Multi-frame Functional Groups), C.8.4.11 (NM Detector) and
C.8.4.15 (NM Reconstruction), where the sign of SpacingBetweenSlices is the direction of the slices along the normal.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from quadriform.errors import AffineError, FileFormatError, MaskError
from quadriform.imaging.dicom_stack import ImagePlane
from quadriform.points import Array

if TYPE_CHECKING:
    from pydicom import Dataset

RIGHT_ANGLE = 1e-3
"""Rows and columns are of length one and square to each other within this; headers round."""

SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
"""Classes: Segmentation Storage and Label Map Segmentation Storage."""

TAGS = [
    "AcquisitionTime",
    "BitsAllocated",
    "Columns",
    "DetectorInformationSequence",
    "EnergyWindowVector",
    "GatedInformationSequence",
    "ImageOrientationPatient",
    "ImagePositionPatient",
    "InstanceNumber",
    "MaximumFractionalValue",
    "Modality",
    "NumberOfFrames",
    "PerFrameFunctionalGroupsSequence",
    "PixelSpacing",
    "RRIntervalVector",
    "RescaleIntercept",
    "RescaleSlope",
    "Rows",
    "SOPClassUID",
    "SamplesPerPixel",
    "SegmentSequence",
    "SegmentationType",
    "SeriesInstanceUID",
    "SeriesNumber",
    "SharedFunctionalGroupsSequence",
    "SliceVector",
    "SpacingBetweenSlices",
    "TimeSlotVector",
    "TriggerTime",
]
"""All that is read of a header; nothing in it is of the patient."""


def planes_of(header: "Dataset", file: Path) -> list[ImagePlane]:
    """The planes of one file, in the order of its images.

    Raises:
        AffineError: positions, orientations or spacings are missing or cannot be.
        MaskError: colour, or images that are no slices.
        FileFormatError: the header contradicts itself.
    """
    if (samples := header.get("SamplesPerPixel", 1)) != 1:
        raise MaskError(f"{str(file)!r}: expected one real number a pixel, found {samples}")
    if "PerFrameFunctionalGroupsSequence" in header:
        return _enhanced(header, file)
    if n_images(header) == 1:
        return [_classic(header, file)]
    if "DetectorInformationSequence" in header:
        return _nuclear(header, file)
    raise AffineError(
        f"{str(file)!r}: {n_images(header)} images of modality {header.get('Modality')!r} and no position of each; "
        "expected functional groups or a reconstruction of nuclear medicine"
    )


def is_segmentation(header: "Dataset") -> bool:
    """Whether a file holds segments of an image, by its SOP class."""
    return str(header.get("SOPClassUID")) in SEGMENTATIONS


def n_images(header: "Dataset") -> int:
    """How many images the file holds."""
    return int(header.get("NumberOfFrames") or 1)


def _classic(header: "Dataset", file: Path) -> ImagePlane:
    return ImagePlane(
        _numbers(header, "ImagePositionPatient", 3, file),
        *_steps(header, header, file),
        _size(header),
        file,
        slope=_number(header, "RescaleSlope", 1.0, file),
        intercept=_number(header, "RescaleIntercept", 0.0, file),
        trigger_time=_optional(header, "TriggerTime"),
        acquisition_time=_seconds(header.get("AcquisitionTime")),
        number=_optional(header, "InstanceNumber"),
    )


def _enhanced(header: "Dataset", file: Path) -> list[ImagePlane]:
    groups, shared = header.PerFrameFunctionalGroupsSequence, header.get("SharedFunctionalGroupsSequence") or [{}]
    if len(groups) != n_images(header):
        raise FileFormatError(f"{str(file)!r}: {n_images(header)} images, but {len(groups)} functional groups")

    def macro(index: int, name: str) -> Any:
        found = groups[index].get(name) or shared[0].get(name)
        return found[0] if found else {}

    planes = []
    for index in range(len(groups)):
        values, content = macro(index, "PixelValueTransformationSequence"), macro(index, "FrameContentSequence")
        plane = ImagePlane(
            _numbers(macro(index, "PlanePositionSequence"), "ImagePositionPatient", 3, file),
            *_steps(macro(index, "PlaneOrientationSequence"), macro(index, "PixelMeasuresSequence"), file),
            _size(header),
            file,
            index,
            len(groups) == 1,
            slope=_number(values, "RescaleSlope", 1.0, file),
            intercept=_number(values, "RescaleIntercept", 0.0, file),
            trigger_time=_optional(macro(index, "CardiacSynchronizationSequence"), "NominalCardiacTriggerDelayTime"),
            number=_optional(content, "TemporalPositionIndex"),
        )
        planes.append(plane)
    return planes


def _nuclear(header: "Dataset", file: Path) -> list[ImagePlane]:
    """Reconstructed slices: the first one's place is the detector's, the others follow along the normal."""
    n = n_images(header)
    for vector in ("EnergyWindowVector", "RRIntervalVector"):
        if len(set(_vector(header, vector, n, file, "1"))) > 1:
            raise MaskError(f"{str(file)!r}: {vector} has several values; expected one reconstruction")
    slices, slots = _vector(header, "SliceVector", n, file), _vector(header, "TimeSlotVector", n, file, "1")
    place, *others = [at for at in header.DetectorInformationSequence if "ImagePositionPatient" in at] or [header]
    if others:
        raise AffineError(f"{str(file)!r}: {len(others) + 1} detectors with ImagePositionPatient; expected one")
    along_row, along_column = _steps(place, header, file)
    normal = np.cross(along_row, along_column)
    step = normal / np.linalg.norm(normal) * _numbers(header, "SpacingBetweenSlices", 1, file)
    origin, slot_ms = _numbers(place, "ImagePositionPatient", 3, file), _slot_ms(header)
    return [
        ImagePlane(
            origin + (slices[index] - 1) * step,
            along_row,
            along_column,
            _size(header),
            file,
            index,
            False,
            slope=_number(header, "RescaleSlope", 1.0, file),
            intercept=_number(header, "RescaleIntercept", 0.0, file),
            trigger_time=None if slot_ms is None else (slots[index] - 1) * slot_ms,
            number=slots[index],
        )
        for index in range(n)
    ]


def _vector(header: "Dataset", keyword: str, n: int, file: Path, missing: str | None = None) -> list[int]:
    """One whole number for each image of the file."""
    found = header.get(keyword, missing)
    if found == missing and missing is not None:
        return [int(missing)] * n
    numbers = [int(number) for number in np.atleast_1d(found)] if found is not None else []
    if len(numbers) != n:
        raise AffineError(f"{str(file)!r}: expected {n} numbers in {keyword}, found {len(numbers)}: no stack of slices")
    return numbers


def _slot_ms(header: "Dataset") -> float | None:
    """Length of a time slot of a gated study, ms."""
    for gated in header.get("GatedInformationSequence") or ():
        for data in gated.get("DataInformationSequence") or ():
            return _optional(data, "FrameTime")
    return None


def _size(header: "Dataset") -> tuple[int, int]:
    return int(header.Columns), int(header.Rows)


def _steps(orientation: Any, measures: Any, file: Path) -> tuple[Array, Array]:
    """The steps (3,) in mm along a row and down a column."""
    cosines = _numbers(orientation, "ImageOrientationPatient", 6, file).reshape(2, 3)
    if np.abs(cosines @ cosines.T - np.eye(2)).max() > RIGHT_ANGLE:
        raise AffineError(f"{str(file)!r}: ImageOrientationPatient {cosines.ravel().tolist()} is no right angle")
    spacing = _numbers(measures, "PixelSpacing", 2, file)
    if spacing.min() <= 0:
        raise AffineError(f"{str(file)!r}: PixelSpacing {spacing.tolist()}; expected lengths above 0")
    # The first length is that between rows, the first direction that along them.
    return cosines[0] * spacing[1], cosines[1] * spacing[0]


def _numbers(place: Any, keyword: str, count: int, file: Path) -> Array:
    value = place.get(keyword)
    try:
        numbers = np.atleast_1d(np.array(value, dtype=np.float64))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise AffineError(f"{str(file)!r}: expected {keyword} with {count} finite numbers, found {value!r}")
    return numbers


def _number(place: Any, keyword: str, default: float, file: Path) -> float:
    if place.get(keyword) is None:
        return default
    number = _optional(place, keyword)
    if number is None:
        raise FileFormatError(f"{str(file)!r}: expected {keyword} to be a finite number, found {place.get(keyword)!r}")
    return number


def _optional(place: Any, keyword: str) -> float | None:
    try:
        number = float(place.get(keyword))
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None


def _seconds(time: object) -> float | None:
    """Seconds of the day of a DICOM time, HHMMSS with a fraction."""
    text = str(time)
    try:
        return int(text[:2]) * 3600 + int(text[2:4]) * 60 + float(text[4:])
    except ValueError:
        return None
