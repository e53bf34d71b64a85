"""The image planes of DICOM, and their spacing: which attributes of the header determine it, and which are ignored.

- Pixels of an image: PixelSpacing and ImageOrientationPatient (DICOM PS3.3, C.7.6.2.1.1 and 10.7.1.3).
- Slices of a series, and of an enhanced multi-frame image: ImagePositionPatient alone. SliceThickness, SliceLocation
  and SpacingBetweenSlices are ignored: slices may overlap or leave space between them, and scanners write them
  differently.
- Reconstructed slices of nuclear medicine: the first has a position, SpacingBetweenSlices gives the others; its sign is
  the direction along the normal (C.8.4.15).
- Segmentations: SpacingBetweenSlices where it is stated, else the smallest distance of two frames, for slices without a
  voxel of a segment need not be stored (C.8.20).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from quadriform.errors import AffineError, InputError
from quadriform.files.slice_planes import is_right_angle, unit_normal
from quadriform.imaging.dicom_values import Dataset, functional_group, number_or_default, required_numbers
from quadriform.points import Array
from quadriform.words import first_of

SAME_ORIENTATION = 0.1
"""Two images have the same orientation when no corner moves by more than this many pixels."""
LISTED = 6
"""The number of images that a message names."""
ROUNDING = 0.02
"""mm; positions are written with at least two decimals."""
UNEVEN = 0.01
"""A distance between slices may differ from the usual one by this fraction, and by `ROUNDING`."""


@dataclass(frozen=True)
class ImagePlane:
    """One image of a series: position in the world, time of acquisition, and location of its pixels.

    Attributes:
        origin: (3,) centre of the first pixel, LPS mm.
        along_row: (3,) mm, the step to the next pixel of the same row.
        along_column: (3,) mm, the step to the next row.
        size: pixels in a row, rows.
        file: that contains the pixels.
        index: number of the image in the file, from 0.
        alone: whether the file contains no other image.
        rescale: slope and intercept of the stored values.
        trigger_time: ms after the R wave, where known.
        acquisition_time: seconds of the day, where known.
        number: position in the series by the count of the scanner, where known.
    """

    origin: Array
    along_row: Array
    along_column: Array
    size: tuple[int, int]
    file: Path
    index: int = 0
    alone: bool = True
    rescale: tuple[float, float] = (1.0, 0.0)
    trigger_time: float | None = None
    acquisition_time: float | None = None
    number: float | None = None

    @property
    def name(self) -> str:
        """The image as messages name it."""
        return self.file.name if self.alone else f"image {self.index} of {self.file.name}"

    @property
    def position(self) -> str:
        """The origin as messages print it."""
        return f"({', '.join(f'{value:.2f}' for value in self.origin)})"

    @property
    def normal(self) -> Array:
        """Unit normal (3,) of the image, right-handed to rows and columns."""
        return unit_normal(self.along_row, self.along_column)


def names(planes: Sequence[ImagePlane]) -> str:
    """Return the names of images, the first LISTED of them."""
    return first_of([plane.name for plane in planes], LISTED)


def check_same_grid(planes: Sequence[ImagePlane]) -> None:
    """Refuse images of different sizes, orientations or pixel sizes.

    Raises:
        InputError: naming the images.
    """
    first = planes[0]
    other_sizes = [plane.size != first.size for plane in planes]
    _check_alike(planes, other_sizes, "images of different sizes", lambda plane: f"{plane.size}")
    shorter_step = min(np.linalg.norm(first.along_row), np.linalg.norm(first.along_column))
    # a change of the step moves the far corner by that change times the number of pixels
    allowed = SAME_ORIENTATION * shorter_step / max(first.size)
    steps = np.array([(plane.along_row, plane.along_column) for plane in planes])
    other_steps = np.linalg.norm(steps - steps[0], axis=-1).max(axis=1) > allowed
    _check_alike(planes, other_steps, "images of different orientations or pixel sizes", _steps)


def _steps(plane: ImagePlane) -> str:
    """The steps of a plane in words."""
    return f"steps {plane.along_row.round(4).tolist()} and {plane.along_column.round(4).tolist()}"


def _check_alike(
    planes: Sequence[ImagePlane], is_other: Iterable[bool], fault: str, describe: Callable[[ImagePlane], str]
) -> None:
    """Refuse images of which some, by `is_other`, are unlike the first; the fault and both are described."""
    if others := [plane for plane, other in zip(planes, is_other) if other]:
        raise InputError(
            f"{fault}: {planes[0].name} has {describe(planes[0])}, {others[0].name} has {describe(others[0])}; "
            f"{len(others)} of {len(planes)} differ from the first: {names(others)}; keep one stack of slices"
        )


def pixel_steps(orientation: Any, measures: Any) -> tuple[Array, Array]:
    """Return the steps (3,) in mm to the next pixel of a row and to the next row, LPS.

    Args:
        orientation: item with ImageOrientationPatient, the directions of row and column.
        measures: item with PixelSpacing.

    Raises:
        AffineError: missing, no right angle, or no lengths above 0.
    """
    cosines = required_numbers(orientation, "ImageOrientationPatient", 6).reshape(2, 3)
    if not is_right_angle(cosines):
        raise AffineError(f"ImageOrientationPatient {cosines.ravel().tolist()} is no right angle")
    spacing = required_numbers(measures, "PixelSpacing", 2)
    if spacing.min() <= 0:
        raise AffineError(f"PixelSpacing {spacing.tolist()}; expected lengths above 0")
    # PS3.3 10.7.1.3: the first length is between rows; C.7.6.2.1.1: the first direction is along them
    return cosines[0] * spacing[1], cosines[1] * spacing[0]


def slice_step(planes: Sequence[ImagePlane]) -> Array:
    """Return the vector (3,) in mm from slice to slice.

    Args:
        planes: one of each slice, in order; two or more.

    Raises:
        InputError: the steps differ; the slices are named.
    """
    origins = np.array([plane.origin for plane in planes])
    steps = np.diff(origins, axis=0)
    usual = np.median(steps, axis=0)
    uneven = np.linalg.norm(steps - usual, axis=1) > UNEVEN * np.linalg.norm(usual) + ROUNDING
    if uneven.any():
        pairs = [(k, planes[k], planes[k + 1]) for k in np.flatnonzero(uneven)[:LISTED]]
        found = "; ".join(
            f"{np.linalg.norm(steps[k]):.4g} mm between {low.name} at {low.position} and {high.name} at {high.position}"
            for k, low, high in pairs
        )
        raise InputError(
            f"uneven spacing: slices are {np.linalg.norm(usual):.4g} mm apart, but {found}; is a slice missing, or "
            "contained twice?"
        )
    # the whole stack determines the step: a rounded position at one end matters least
    return np.asarray((origins[-1] - origins[0]) / (len(origins) - 1))


def reconstructed_slice_step(header: Dataset, along_row: Array, along_column: Array) -> Array:
    """Return the vector (3,) in mm from slice to slice of a reconstruction of nuclear medicine.

    Raises:
        AffineError: no SpacingBetweenSlices.
    """
    return unit_normal(along_row, along_column) * required_numbers(header, "SpacingBetweenSlices", 1)


def segmentation_grid(header: Dataset, planes: Sequence[ImagePlane]) -> tuple[list[int], Array]:
    """Return the slice of each frame of a segmentation, from 0, and world from voxel (4, 4), LPS mm.

    Args:
        header: of the file.
        planes: of its frames, in their order; alike in size and orientation.

    Raises:
        AffineError: the frames are not on evenly spaced slices, or one position without a spacing.
    """
    first = planes[0]
    origins = np.array([plane.origin for plane in planes])
    heights = origins @ first.normal
    lowest = int(heights.argmin())
    spacing = _segmentation_spacing(header, heights)
    slices = np.rint((heights - heights[lowest]) / spacing).astype(int)
    # the step is taken from the positions, not from the stated spacing, so that a leaning stack keeps its direction
    last = max(int(slices.max()), 1)
    step = (origins[heights.argmax()] - origins[lowest]) / last if slices.any() else spacing * first.normal
    off = np.linalg.norm(origins - origins[lowest] - slices[:, None] * step, axis=1)
    if off.max() > UNEVEN * spacing + ROUNDING:
        raise AffineError(
            f"uneven slices: {planes[int(off.argmax())].name} lies {off.max():.3g} mm off a grid of slices "
            f"{spacing:.4g} mm apart; expected a multiple of one distance"
        )
    return slices.tolist(), world_from_voxel(first, step, origins[lowest])


def _segmentation_spacing(header: Dataset, heights: Array) -> float:
    measures = functional_group(header, 0, "PixelMeasuresSequence")
    if stated := number_or_default(measures, "SpacingBetweenSlices", 0.0):
        return abs(stated)
    distances = np.diff(np.unique(heights))
    distances = distances[distances > ROUNDING]
    if not len(distances):
        raise AffineError("one slice position and no SpacingBetweenSlices; expected a stack of slices")
    return float(distances.min())


def world_from_voxel(plane: ImagePlane, step: Array, origin: Array) -> Array:
    """Return the transform (4, 4) to LPS mm: i along a row, j down the rows, k over the slices (C.7.6.2.1.1)."""
    affine = np.eye(4)
    affine[:3] = np.column_stack([plane.along_row, plane.along_column, step, origin])
    return affine
