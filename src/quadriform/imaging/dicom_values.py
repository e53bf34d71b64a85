"""Values of DICOM headers, checked: numbers, vectors, times and functional groups (DICOM PS3.5, 6.2)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from quadriform.errors import AffineError, FileFormatError
from quadriform.points import Array

if TYPE_CHECKING:
    from pydicom import Dataset as Dataset
else:
    Dataset = Any  # pydicom is optional, and loaded where a file is read

SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
"""SOP classes: Segmentation Storage and Label Map Segmentation Storage."""

KEYWORDS = (
    *("AcquisitionTime", "BitsAllocated", "Columns", "DetectorInformationSequence", "EnergyWindowVector"),
    *("GatedInformationSequence", "ImageOrientationPatient", "ImagePositionPatient", "InstanceNumber"),
    *("MaximumFractionalValue", "Modality", "NumberOfFrames", "PerFrameFunctionalGroupsSequence", "PixelSpacing"),
    *("RRIntervalVector", "RescaleIntercept", "RescaleSlope", "Rows", "SOPClassUID", "SamplesPerPixel"),
    *("SegmentSequence", "SegmentationType", "SeriesInstanceUID", "SeriesNumber"),
    *("SharedFunctionalGroupsSequence", "SliceVector", "SpacingBetweenSlices", "TimeSlotVector", "TriggerTime"),
)
"""All attributes of a header that are read. None of them states who the patient is. SeriesInstanceUID, which a message
may name, and the times belong to one examination: who has access to its images can find the patient by them."""


def is_segmentation(header: Dataset) -> bool:
    """Return whether the SOP class of a file is a segmentation."""
    return str(header.get("SOPClassUID")) in SEGMENTATIONS


def n_images(header: Dataset) -> int:
    """Return the number of images in a file."""
    return int(header.get("NumberOfFrames") or 1)


def functional_group(header: Dataset, image: int, sequence: str) -> Any:
    """Return the item of a functional group of one image, by default that of all images; {} where there is neither.

    Source: DICOM PS3.3, C.7.6.16: a group is either shared or per frame.
    """
    shared = header.get("SharedFunctionalGroupsSequence") or [{}]
    for groups in (header.PerFrameFunctionalGroupsSequence[image], shared[0]):
        if found := groups.get(sequence):
            return found[0]
    return {}


def required_numbers(item: Any, keyword: str, count: int) -> Array:
    """Return the values (count,) of an attribute.

    Raises:
        AffineError: missing, or not `count` finite numbers.
    """
    value = item.get(keyword)
    try:  # a value may be missing, or text
        numbers = np.atleast_1d(np.array(value, dtype=np.float64))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise AffineError(f"expected {keyword} with {count} finite numbers, found {value!r}")
    return numbers


def optional_number(item: Any, keyword: str) -> float | None:
    """Return the value of an attribute; None where it is missing or no finite number."""
    try:
        number = float(item.get(keyword))
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None


def number_or_default(item: Any, keyword: str, default: float) -> float:
    """Return the value of an attribute; the default where it is missing.

    Raises:
        FileFormatError: no finite number.
    """
    if item.get(keyword) is None:
        return default
    number = optional_number(item, keyword)
    if number is None:
        raise FileFormatError(f"expected {keyword} to be a finite number, found {item.get(keyword)!r}")
    return number


def vector_of(header: Dataset, keyword: str, n: int, default: int | None = None) -> list[int]:
    """Return one whole number for each of the n images of a file; the default for all where the attribute is missing.

    Raises:
        AffineError: missing without a default, or another count of numbers.
    """
    value = header.get(keyword)
    if value is None and default is not None:
        return [default] * n
    numbers = [] if value is None else [int(number) for number in np.atleast_1d(value)]
    if len(numbers) != n:
        raise AffineError(f"expected {n} numbers in {keyword}, found {len(numbers)}: no stack of slices")
    return numbers


def seconds_of_day(time: object) -> float | None:
    """Return the seconds of the day of a DICOM time, HHMMSS with a fraction; None for other text."""
    text = str(time)  # TM of PS3.5, 6.2: HHMMSS.FFFFFF
    try:
        return int(text[:2]) * 3600 + int(text[2:4]) * 60 + float(text[4:])
    except ValueError:
        return None
