"""The planes of slices, as the SliceInfoFile of biv-me lists them.

Reference: https://github.com/UOA-Heart-Mechanics-Research/biv-me
"""

from dataclasses import dataclass

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.guide_points import SLICE_NAMES, lines_of, number_in, plain
from quadriform.files.reading import PathLike, quoted, read_bytes
from quadriform.points import Array

RIGHT_ANGLE = 1e-3
"""Row and column of an image are unit vectors, perpendicular to each other, within this; headers round."""


@dataclass(frozen=True)
class SlicePlane:
    """The plane of a slice in the world.

    Attributes:
        origin: (3,) centre of the image's first pixel, LPS mm.
        rows: (3,) unit vector along a row, as the first three numbers of ImageOrientationPatient.
        columns: (3,) unit vector down a column.
        spacing: (2,) mm between rows, and between the pixels of a row.
    """

    origin: Array
    rows: Array
    columns: Array
    spacing: Array

    @property
    def normal(self) -> Array:
        """(3,) unit vector, rows x columns."""
        return unit_normal(self.rows, self.columns)

    def is_at(self, other: "SlicePlane") -> bool:
        """Whether both planes are the same to the last digit; a file may list a slice for each of its frames."""
        mine, others = (np.concatenate([p.origin, p.rows, p.columns, p.spacing]) for p in (self, other))
        return bool(np.array_equal(mine, others))


def unit_normal(row: Array, column: Array) -> Array:
    """The unit vector (3,) along row x column."""
    normal = np.cross(row, column)
    return np.asarray(normal / np.linalg.norm(normal))


def is_right_angle(cosines: Array) -> bool:
    """Whether the directions of row and column, (2, 3), of an ImageOrientationPatient are unit and perpendicular."""
    return bool(np.abs(cosines @ cosines.T - np.eye(2)).max() <= RIGHT_ANGLE)


def read_slice_planes(path: PathLike) -> dict[int, SlicePlane]:
    """The planes of a SliceInfoFile, which has number, position, orientation and pixel spacing of each slice.

    Returns:
        From the slice number to its plane, in the order of the file.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not such a file, or one slice in two planes; with the line, what was expected and found.
        FileLimitError: beyond the budget.
    """
    where = quoted(path)
    planes: dict[int, SlicePlane] = {}
    for number, words in lines_of(read_bytes(path), where, str.split):
        here = f"{where}, line {number}"
        plane_number = _slice_number(words, here)
        plane = _plane(words, here)
        if not plane.is_at(planes.setdefault(plane_number, plane)):
            raise FileFormatError(f"{here}: slice {plane_number} lies in another plane than before")
    if not planes:
        raise FileFormatError(f"{where}: no slices in it")
    return planes


def _plane(words: list[str], where: str) -> SlicePlane:
    cosines = _after(words, "ImageOrientationPatient", 6, where).reshape(2, 3)
    if not is_right_angle(cosines):
        raise FileFormatError(f"{where}: ImageOrientationPatient {cosines.ravel().tolist()} is no right angle")
    origin, spacing = _after(words, "ImagePositionPatient", 3, where), _after(words, "PixelSpacing", 2, where)
    return SlicePlane(origin, cosines[0], cosines[1], spacing)


def _slice_number(words: list[str], where: str) -> int:
    for word in words[1:]:
        if word.endswith(":") and plain(word[:-1]) in SLICE_NAMES:
            return int(_after(words, word, 1, where, whole=True)[0])
    raise FileFormatError(f"{where}: expected sliceID: or frameID: with the number of the slice, found {words}")


def _after(words: list[str], keyword: str, count: int, where: str, whole: bool = False) -> Array:
    """The numbers that follow a keyword."""
    if keyword not in words:
        raise FileFormatError(f"{where}: expected {keyword}, found {words}")
    at = words.index(keyword) + 1
    found = words[at : at + count]
    if len(found) < count:
        raise FileFormatError(f"{where}: expected {count} numbers after {keyword}, found {found}")
    return np.array([number_in(word, where, whole) for word in found])
