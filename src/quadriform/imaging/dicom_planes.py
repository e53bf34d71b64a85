"""Position, orientation, pixel size and time of one image of a DICOM series."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadriform.errors import InputError
from quadriform.points import Array
from quadriform.words import first_of

SAME_ORIENTATION = 0.1
"""Two images have the same orientation when no corner moves by more than this many pixels."""
LISTED = 6
"""The number of images that a message names."""


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
        normal = np.cross(self.along_row, self.along_column)
        return normal / np.linalg.norm(normal)


def names(planes: Sequence[ImagePlane]) -> str:
    """Return the names of images, the first LISTED of them."""
    return first_of([plane.name for plane in planes], LISTED)


def check_same_grid(planes: Sequence[ImagePlane]) -> None:
    """Refuse images of different sizes, orientations or pixel sizes.

    Raises:
        InputError: naming the images.
    """
    first = planes[0]
    _refuse("images of different sizes", planes, lambda plane: plane.size != first.size, lambda plane: f"{plane.size}")
    shorter_step = min(np.linalg.norm(first.along_row), np.linalg.norm(first.along_column))
    # a change of the step moves the far corner by that change times the number of pixels
    allowed = SAME_ORIENTATION * shorter_step / max(first.size)

    def differs(plane: ImagePlane) -> bool:
        change = (plane.along_row - first.along_row, plane.along_column - first.along_column)
        return bool(np.linalg.norm(change, axis=1).max() > allowed)

    def steps(plane: ImagePlane) -> str:
        return f"steps {plane.along_row.round(4).tolist()} and {plane.along_column.round(4).tolist()}"

    _refuse("images of different orientations or pixel sizes", planes, differs, steps)


def _refuse(
    fault: str,
    planes: Sequence[ImagePlane],
    differs: Callable[[ImagePlane], bool],
    describe: Callable[[ImagePlane], str],
) -> None:
    others = [plane for plane in planes if differs(plane)]
    if others:
        raise InputError(
            f"{fault}: {planes[0].name} has {describe(planes[0])}, {others[0].name} has {describe(others[0])}; "
            f"{len(others)} of {len(planes)} differ from the first: {names(others)}; keep one stack of slices"
        )
