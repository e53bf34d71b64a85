"""DICOM segmentations: the frames of each segment put on one grid, as a label image with the names of the segments.

Reference: DICOM PS3.3, C.8.20 (Segmentation). Slices without a voxel of a segment need not be stored.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import AffineError, FileFormatError, InputError, Warnings
from quadriform.files.reading import check_budget, quoted
from quadriform.imaging.dicom_headers import planes_of
from quadriform.imaging.dicom_stack import ROUNDING, UNEVEN, ImagePlane, check_alike
from quadriform.imaging.segments import SegmentMap
from quadriform.imaging.volume import Volume
from quadriform.points import Array

if TYPE_CHECKING:
    from pydicom import Dataset

HALF = 0.5
"""A voxel belongs to a segment where its fraction is above."""


def label_map(header: "Dataset", pixels: NDArray[Any], file: Path, warnings: Warnings) -> Volume:
    """A segmentation as a label image: voxel values are segment numbers, and further ones where segments overlap.

    Args:
        header: of the file.
        pixels: (frames, rows, columns) as stored.
        file: for messages.
        warnings: of reading, which the image carries.

    Raises:
        InputError: a frame is there twice, or frames differ in size or orientation.
        AffineError: the slices are not evenly spaced, or are one alone without a spacing.
        FileFormatError: the header contradicts itself.
    """
    planes = planes_of(header, file)
    check_alike(planes, quoted(file))
    slices, affine = _grid(header, planes, file)
    names = _names(header, file)
    columns, rows = planes[0].size
    found = SegmentMap(np.zeros((columns, rows, max(slices) + 1), dtype=np.int32))
    check_budget(found.values.nbytes, quoted(file))
    for number, masks in _frames(header, pixels, names, file).items():
        mask = np.zeros(found.values.shape, dtype=bool)
        for index, image in masks.items():
            if mask[..., slices[index]].any():
                raise InputError(f"{quoted(file)}: two frames of segment {number} lie at slice {slices[index]}")
            mask[..., slices[index]] = image.T
        found.add(names[number], number, mask)
    if pixels.any(axis=(1, 2)).all():  # slices without a voxel were left out, so the segments end at the last ones
        found.values = np.pad(found.values, ((0, 0), (0, 0), (1, 1)))
        affine[:3, 3] -= affine[:3, 2]
    return Volume(found.values, affine, "LPS", "mm", warnings, tuple(found.segments), is_label_map=True)


def _names(header: "Dataset", file: Path) -> dict[int, str]:
    """The segments by number; 0, which label maps may describe, is the background."""
    items = header.get("SegmentSequence") or ()
    numbers = [item.get("SegmentNumber") for item in items]
    if not items or None in numbers or len(set(numbers)) < len(numbers):
        raise FileFormatError(
            f"{quoted(file)}: SegmentSequence has the SegmentNumbers {numbers}; expected one for each segment"
        )
    return {int(item.SegmentNumber): str(item.get("SegmentLabel") or "") for item in items if item.SegmentNumber != 0}


def _frames(
    header: "Dataset", pixels: NDArray[Any], names: dict[int, str], file: Path
) -> dict[int, dict[int, NDArray[np.bool_]]]:
    """For each segment of the header its frames: from the index in the file to the mask (rows, columns)."""
    result: dict[int, dict[int, NDArray[np.bool_]]] = {number: {} for number in names}
    if header.get("SegmentationType") == "LABELMAP":
        for number in result:
            result[number] = {index: image == number for index, image in enumerate(pixels) if (image == number).any()}
        return result
    full = float(header.get("MaximumFractionalValue") or 1) if header.get("SegmentationType") == "FRACTIONAL" else 1.0
    for index, image in enumerate(pixels):
        of = _number(header, index)
        if of is None or of not in result:
            raise FileFormatError(f"{quoted(file)}: frame {index} is of segment {of}; expected one of {list(names)}")
        result[of][index] = image > HALF * full
    return result


def _number(header: "Dataset", index: int) -> int | None:
    """The segment of a frame, by its own functional group or the shared one."""
    groups = (header.PerFrameFunctionalGroupsSequence[index], *(header.get("SharedFunctionalGroupsSequence") or ()))
    for group in groups:
        for item in group.get("SegmentIdentificationSequence") or ():
            return int(item.ReferencedSegmentNumber)
    return None


def _grid(header: "Dataset", planes: list[ImagePlane], file: Path) -> tuple[list[int], Array]:
    """The slice of each frame, from 0, and world from voxel (4, 4)."""
    first = planes[0]
    normal = np.cross(first.along_row, first.along_column)
    normal /= np.linalg.norm(normal)
    origins = np.array([plane.origin for plane in planes])
    heights = origins @ normal
    lowest = int(heights.argmin())
    step = _spacing(header, heights, file)
    slices = np.rint((heights - heights[lowest]) / step).astype(int)
    last = max(int(slices.max()), 1)
    across = (origins[heights.argmax()] - origins[lowest]) / last if slices.any() else step * normal
    off = np.linalg.norm(origins - origins[lowest] - slices[:, None] * across, axis=1)
    if off.max() > UNEVEN * step + ROUNDING:
        worst = planes[int(off.argmax())]
        raise AffineError(
            f"{quoted(file)}: uneven slices: {worst.name} lies {off.max():.3g} mm off a grid of slices {step:.4g} mm "
            "apart; expected a multiple of one distance"
        )
    affine = np.eye(4)
    affine[:3] = np.column_stack([first.along_row, first.along_column, across, origins[lowest]])
    return slices.tolist(), affine


def _spacing(header: "Dataset", heights: Array, file: Path) -> float:
    """The distance of slices as stated, else the smallest one between frames."""
    groups = (*(header.get("SharedFunctionalGroupsSequence") or ()), *header.PerFrameFunctionalGroupsSequence[:1])
    measures = (item for group in groups for item in group.get("PixelMeasuresSequence") or ())
    stated = [abs(float(item.SpacingBetweenSlices)) for item in measures if item.get("SpacingBetweenSlices")]
    gaps = np.diff(np.unique(heights))
    gaps = gaps[gaps > ROUNDING]
    if stated and stated[0] > 0:
        return stated[0]
    if not len(gaps):
        raise AffineError(f"{quoted(file)}: one slice position and no SpacingBetweenSlices; expected a stack of slices")
    return float(gaps.min())
