"""DICOM segmentations: the frames of all segments on one grid, as a label image with the names of the segments.

Reference: DICOM PS3.3, C.8.20 (Segmentation). Slices without a voxel of a segment need not be stored.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, InputError, Warnings
from quadriform.files.reading import check_budget, quoted
from quadriform.imaging.dicom_headers import planes_of
from quadriform.imaging.dicom_spacing import check_same_grid, segmentation_grid
from quadriform.imaging.dicom_values import Dataset, functional_group
from quadriform.imaging.segments import SegmentMap
from quadriform.imaging.volume import Volume

HALF = 0.5
"""A voxel belongs to a segment where its fraction is above."""
Masks = dict[int, NDArray[np.bool_]]
"""Index of a frame in the file -> mask (rows, columns)."""


def label_image(header: Dataset, pixels: NDArray[Any], file: Path, warnings: Warnings) -> Volume:
    """Return a segmentation as a label image: values are segment numbers, and further ones where segments overlap.

    Args:
        header: of the file.
        pixels: (frames, rows, columns) as stored.
        file: for messages.
        warnings: of reading, which are added to the image.

    Raises:
        InputError: a frame is contained twice, or frames differ in size or orientation.
        AffineError: the slices are not evenly spaced, or are one alone without a spacing.
        FileFormatError: the header contradicts itself.
    """
    planes = planes_of(header, file)
    check_same_grid(planes)
    slices, affine = segmentation_grid(header, planes)
    names = _names(header)  # of SegmentSequence (C.8.20.2)
    found = SegmentMap(np.zeros((*planes[0].size, max(slices) + 1), dtype=np.int32))
    check_budget(found.values.nbytes, quoted(file))
    for number, masks in _masks(header, pixels, names).items():
        mask = np.zeros(found.values.shape, dtype=bool)
        for index, image in masks.items():
            if mask[..., slices[index]].any():
                raise InputError(f"two frames of segment {number} lie at slice {slices[index]}")
            mask[..., slices[index]] = image.T
        found.add(names[number], number, mask)
    if pixels.any(axis=(1, 2)).all():  # slices without a voxel were left out, so the segments end at the last ones
        found.values = np.pad(found.values, ((0, 0), (0, 0), (1, 1)))
        affine[:3, 3] -= affine[:3, 2]
    return Volume(found.values, affine, "LPS", "mm", warnings, tuple(found.segments), is_label_map=True)


def _names(header: Dataset) -> dict[int, str]:
    """The segments by number; 0, which label maps may describe, is the background."""
    items = header.get("SegmentSequence") or ()
    numbers = [item.get("SegmentNumber") for item in items]
    if not items or None in numbers or len(set(numbers)) < len(numbers):
        raise FileFormatError(f"SegmentSequence has the SegmentNumbers {numbers}; expected one for each segment")
    return {int(item.SegmentNumber): str(item.get("SegmentLabel") or "") for item in items if item.SegmentNumber != 0}


def _masks(header: Dataset, pixels: NDArray[Any], names: dict[int, str]) -> dict[int, Masks]:
    """The frames of each segment of the header."""
    kind = header.get("SegmentationType")
    if kind == "LABELMAP":
        return {
            number: {index: image == number for index, image in enumerate(pixels) if (image == number).any()}
            for number in names
        }
    # C.8.20.2: FRACTIONAL values are fractions of MaximumFractionalValue
    full = float(header.get("MaximumFractionalValue") or 1) if kind == "FRACTIONAL" else 1.0
    result: dict[int, Masks] = {number: {} for number in names}
    for index, image in enumerate(pixels):
        number = functional_group(header, index, "SegmentIdentificationSequence").get("ReferencedSegmentNumber")
        if number not in result:
            raise FileFormatError(f"frame {index} is of segment {number}; expected one of {list(names)}")
        result[int(number)][index] = image > HALF * full
    return result
