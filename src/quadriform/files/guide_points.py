"""Contour points of the heart as biv-me writes them: GPFile text, a file for each frame, and the planes of the slices.

Reference: https://github.com/UOA-Heart-Mechanics-Research/biv-me
"""

import os
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, InputError, PointsError, choose
from quadriform.files.reading import quoted, read_bytes, signature
from quadriform.points import Array

PathLike = str | os.PathLike[str]
Slices = NDArray[np.int64]

HEADER = ("x", "y", "z", "contour type", "frameid", "weight", "time frame")
SURFACES = {"endo": "LV_ENDOCARDIAL", "epi": "LV_EPICARDIAL"}
"""From our surfaces to the contour types, behind SAX_ for short-axis slices and LAX_ for long-axis ones."""
FRAME_FILE = re.compile(r"GPFile_(\d+)\.txt", re.IGNORECASE)


@dataclass(frozen=True)
class GuidePoints:
    """Contour points of one frame.

    Attributes:
        points: from the contour type, as in the file, to its points (n, 3), LPS mm, in the order of the file.
        slices: from the contour type to the number of the slice of each point, (n,).
        weights: from the contour type to the weight of each point, (n,).
        frame: the number in the name of the file; 0 where it has none.
    """

    points: Mapping[str, Array]
    slices: Mapping[str, Slices]
    weights: Mapping[str, Array]
    frame: int

    def surface(self, name: str) -> tuple[Array, Slices]:
        """Points (n, 3), LPS mm, and slice numbers (n,) of the left ventricle's short-axis, then long-axis contours.

        Args:
            name: "endo" or "epi".

        Raises:
            OptionError: another name.
            PointsError: the file has no such contour.
        """
        contour = SURFACES[choose(name, tuple(SURFACES), "surface")]
        kinds = [kind for kind in (f"SAX_{contour}", f"LAX_{contour}") if kind in self.points]
        if not kinds:
            raise PointsError(f"frame {self.frame}: no points of {contour}; found {', '.join(sorted(self.points))}")
        return (
            np.concatenate([self.points[kind] for kind in kinds]),
            np.concatenate([self.slices[kind] for kind in kinds]),
        )

    @property
    def mitral(self) -> Array:
        """Points (n, 3) of the mitral ring; n may be 0."""
        return self._of("MITRAL_VALVE")

    @property
    def rv_inserts(self) -> Array:
        """Points (n, 3) where the right ventricle's wall meets the left's; n may be 0."""
        return self._of("RV_INSERT")

    @property
    def apex(self) -> Array:
        """Points (n, 3) of the apex; n may be 0."""
        return self._of("APEX_POINT")

    def _of(self, kind: str) -> Array:
        return self.points.get(kind, np.empty((0, 3)))


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
        normal = np.cross(self.rows, self.columns)
        return np.asarray(normal / np.linalg.norm(normal))


def read_guide_points(path: PathLike) -> GuidePoints:
    """Read a GPFile: lines of x y z, contour type, slice, weight and time, between tabs, under a header.

    The column frameID is the number of the slice. The column of time holds the frame in some rows and 1.0 in others,
    so it is not used: the frame is the number in the file's name.

    Args:
        path: the file, as GPFile_000.txt.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not such a file; with the line, what was expected and what was found.
        FileLimitError: beyond the budget.
    """
    where = quoted(path)
    lines = _lines(read_bytes(path), where)
    number, names = next(lines, (1, []))
    if tuple(name.lower() for name in names) != HEADER:
        raise FileFormatError(f"{where}, line {number}: expected the header {' | '.join(HEADER)}, found {names}")
    rows: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for number, fields in lines:
        kind, values = _row(fields, f"{where}, line {number}")
        rows[kind].append(values)
    if not rows:
        raise FileFormatError(f"{where}: no points under the header")
    tables = {kind: np.array(values) for kind, values in rows.items()}
    return GuidePoints(
        {kind: table[:, :3] for kind, table in tables.items()},
        {kind: table[:, 3].astype(np.int64) for kind, table in tables.items()},
        {kind: table[:, 4] for kind, table in tables.items()},
        _frame_of(Path(path)),
    )


def read_guide_point_frames(folder: PathLike) -> list[GuidePoints]:
    """Read the files GPFile_NNN.txt of a folder, in the order of their frames.

    Raises:
        InputError: as `guide_point_files`.
        FileFormatError, FileLimitError: as `read_guide_points`.
    """
    return [read_guide_points(file) for file in guide_point_files(folder)]


def guide_point_files(folder: PathLike) -> list[Path]:
    """The files GPFile_NNN.txt of a folder, in the order of their frames.

    Raises:
        InputError: no folder, no such file, a frame between the first and the last is missing, or there twice.
    """
    if not Path(folder).is_dir():
        raise InputError(f"{quoted(folder)}: expected a folder of files GPFile_NNN.txt")
    files = sorted((_frame_of(file), file) for file in Path(folder).iterdir() if FRAME_FILE.fullmatch(file.name))
    if not files:
        raise InputError(f"{quoted(folder)}: no files GPFile_NNN.txt in this folder")
    frames = [frame for frame, _ in files]
    if twice := sorted({file.name for frame, file in files if frames.count(frame) > 1}):
        raise InputError(f"{quoted(folder)}: the same frame in several files: {', '.join(twice)}")
    missing = sorted(set(range(frames[0], frames[-1])) - set(frames))
    if missing:
        listed = ", ".join(f"GPFile_{frame:03d}.txt" for frame in missing)
        raise InputError(f"{quoted(folder)}: frames are missing between {frames[0]} and {frames[-1]}: {listed}")
    return [file for _, file in files]


def read_slice_planes(path: PathLike) -> dict[int, SlicePlane]:
    """Read a SliceInfoFile: for each slice its number, and position, orientation and pixel spacing as in DICOM.

    Returns:
        From the slice number to its plane, in the order of the file.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not such a file, or a slice twice; with the line, what was expected and what was found.
        FileLimitError: beyond the budget.
    """
    where = quoted(path)
    planes: dict[int, SlicePlane] = {}
    for number, fields in _lines(read_bytes(path), where):
        here = f"{where}, line {number}"
        words = fields[1:]
        slice_number = int(_after(words, "sliceID:", 1, here, whole=True)[0])
        if slice_number in planes:
            raise FileFormatError(f"{here}: slice {slice_number} is there twice")
        cosines = _after(words, "ImageOrientationPatient", 6, here).reshape(2, 3)
        if np.abs(cosines @ cosines.T - np.eye(2)).max() > 1e-3:
            raise FileFormatError(f"{here}: ImageOrientationPatient {cosines.ravel().tolist()} is no right angle")
        origin, spacing = _after(words, "ImagePositionPatient", 3, here), _after(words, "PixelSpacing", 2, here)
        planes[slice_number] = SlicePlane(origin, cosines[0], cosines[1], spacing)
    if not planes:
        raise FileFormatError(f"{where}: no slices in it")
    return planes


def _lines(data: bytes, where: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and fields between tabs, blank lines left out."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{where}: expected text in UTF-8, found {signature(data)}") from error
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip():
            yield number, [field.strip() for field in line.split("\t")]


def _row(fields: list[str], where: str) -> tuple[str, tuple[float, ...]]:
    """The contour type, and x y z, slice and weight."""
    if len(fields) != len(HEADER):
        raise FileFormatError(f"{where}: expected {len(HEADER)} fields between tabs, found {len(fields)}")
    x, y, z, kind, slice_number, weight, _ = fields
    if not kind:
        raise FileFormatError(f"{where}: expected a contour type, found none")
    place = tuple(_number(word, where) for word in (x, y, z))
    counts = _number(weight, where)
    if counts < 0:
        raise FileFormatError(f"{where}: expected a weight of 0 or more, found {weight!r}")
    return kind, (*place, _number(slice_number, where, whole=True), counts)


def _after(words: list[str], keyword: str, count: int, where: str, whole: bool = False) -> Array:
    """The numbers that follow a keyword."""
    if keyword not in words:
        raise FileFormatError(f"{where}: expected {keyword}, found {words}")
    at = words.index(keyword) + 1
    found = words[at : at + count]
    if len(found) < count:
        raise FileFormatError(f"{where}: expected {count} numbers after {keyword}, found {found}")
    return np.array([_number(word, where, whole) for word in found])


def _number(word: str, where: str, whole: bool = False) -> float:
    try:
        value = float("nan") if "_" in word else float(word)  # Python reads 1_000 as a number; a table must not
    except ValueError:
        value = float("nan")
    if not np.isfinite(value) or (whole and value != int(value)):
        raise FileFormatError(f"{where}: expected a {'whole' if whole else 'finite'} number, found {word!r}")
    return value


def _frame_of(path: Path) -> int:
    found = re.search(r"(\d+)$", path.stem)
    return int(found[1]) if found else 0
