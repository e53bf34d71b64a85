"""The files of a subject: found by pattern, summarised from their headers, and read."""

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from quadriform.cohort.manifest import Row, is_label
from quadriform.errors import InputError
from quadriform.files.frame_numbers import frame_numbers, natural
from quadriform.files.guide_points import is_guide_points, read_guide_point_frames
from quadriform.imaging.file_points import ReadOptions, files_of, kind_of, read_source, space_and_unit_of
from quadriform.imaging.frame_series import FrameSeries, frame_files, note_order, read_frames
from quadriform.point_sets import ALONE


@dataclass(frozen=True)
class FileSummary:
    """What the headers of the files of a subject contain.

    Attributes:
        frames: number of frames.
        surfaces: names of the surfaces.
        space: "LPS", "RAS" or "unknown".
        unit: of lengths.
    """

    frames: int
    surfaces: tuple[str, ...]
    space: str
    unit: str


def files_by_surface(row: Row, folder: Path) -> dict[str, list[Path]]:
    """Return the files of the frames in order, for each surface, or under "" for all surfaces together.

    Raises:
        InputError: no such files, or surfaces with different numbers of them.
    """
    if row.input:
        return {"": frame_files(_found(row.input, folder))}
    found = {name: frame_files(_found((rule,), folder)) for name, rule in row.surfaces}
    counts = {name: len(files) for name, files in found.items()}
    if len(set(counts.values())) > 1:
        raise InputError(f"expected as many files for each surface, found {counts}")
    _check_same_numbers(found)
    return found


def _check_same_numbers(found: dict[str, list[Path]]) -> None:
    numbers = {name: frame_numbers(files) for name, files in found.items()}
    first, *others = numbers.items()
    for name, other in others:
        if None not in (other, first[1]) and other != first[1]:
            raise InputError(f"the frames of {name} are numbered {other}, those of {first[0]} {first[1]}")


def inspect_files(row: Row, folder: Path) -> FileSummary:
    """Return frames, surfaces, space and unit of a subject.

    Raises:
        QuadriformError: the files are missing, or the header of an image cannot be read.
    """
    from quadriform.imaging.reading import frame_count

    found = files_by_surface(row, folder)
    files = next(iter(found.values()))
    is_image, is_contours = kind_of(files[0]) == "image", is_guide_points(files[0])
    count = sum(frame_count(file) for file in files) if is_image and "" in found else len(files)
    if is_contours and len(files) == 1:
        count = len(read_guide_point_frames(files))
    heart = row.reading["heart"]
    named = tuple(name for name, _ in row.surfaces) if heart is None else heart.surfaces
    names = named or (("endo", "epi") if is_contours else (ALONE,))
    if is_image or is_contours:
        # pixdim has no position or direction: see imaging/nifti_forms.py
        space, unit = "unknown" if is_image and row.reading["affine"] == "pixdim" else "LPS", "mm"
    else:
        space, unit = space_and_unit_of(files[0], row.reading["columns"])
    return FileSummary(count, names, space, unit)


def read_subject(row: Row, folder: Path) -> tuple[FrameSeries, list[Path]]:
    """Return the points of all frames, and the files that were read.

    Raises:
        QuadriformError: a file is missing or gives no points.
    """
    found = files_by_surface(row, folder)
    if "" in found:
        labels = [f"{name}={rule}" for name, rule in row.surfaces if is_label(rule)]
        frames = read_frames(found[""], labels, **row.reading)
    else:
        frames, options = FrameSeries(), ReadOptions(affine=row.reading["affine"], columns=row.reading["columns"])
        for files in zip(*found.values()):
            frames.add_sources({name: read_source(file, options) for name, file in zip(found, files)})
        note_order(frames, next(iter(found.values())))
    every = [file for files in found.values() for path in files for file in files_of(path)]
    return frames, list(dict.fromkeys(every))


def _found(patterns: Sequence[str], folder: Path) -> list[Path]:
    """The files of patterns, those of each in the order of their names, with numbers compared as numbers."""
    result: list[Path] = []
    for pattern in patterns:
        path = str(folder / pattern)
        matches = sorted(glob.glob(path), key=natural) if glob.has_magic(pattern) else [path]
        if not matches or not Path(matches[0]).exists():
            raise InputError(f"{pattern!r}: there is no such file in the folder of the list of subjects")
        result += map(Path, matches)
    return result
