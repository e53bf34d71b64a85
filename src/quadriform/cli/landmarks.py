"""Where `quadriform measure` learns of base and insertions: words, files of points, contours; in the models' frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.inputs import turn_to_model
from quadriform.errors import InputError, OptionError
from quadriform.files.guide_points import GuidePoints, is_guide_points, read_guide_point_frames, read_guide_points
from quadriform.files.points import read_point_set
from quadriform.imaging.file_points import SpaceAndUnit, space_and_unit_of
from quadriform.points import Array

if TYPE_CHECKING:
    from quadriform.heart.base import Base

CONTOURS: SpaceAndUnit = ("LPS", "mm")
FEWEST = 3
"""Mitral points that span a plane."""


def read_base(words: Sequence[str], marks: SpaceAndUnit) -> "Base":
    """What --base says, as `measure` takes it.

    Args:
        words: as they were given.
        marks: frame of the world and unit of the models.

    Raises:
        QuadriformError: a word or a file that cannot be read.
    """
    if not words:
        return None
    if len(words) > 1:
        return [_loop(Path(word), marks) for word in words]
    try:
        return float(words[0])
    except ValueError:
        pass
    if words[0].count(",") == 5 and not Path(words[0]).exists():
        plane = coordinates(words[0], 6, "--base")
        return plane[:3], plane[3:]
    return _loop(Path(words[0]), marks)


def read_contours(paths: Sequence[Path], frames: int, marks: SpaceAndUnit) -> tuple[list[Array], list[Array]]:
    """Mitral points and RV insertions (n, 3) of every frame; there may be none of the second.

    Args:
        paths: a folder of files GPFile_NNN.txt, or such files.
        frames: how many there are to be.
        marks: frame of the world and unit of the models.

    Raises:
        QuadriformError: another number of frames, a frame without mitral points, or a file that cannot be read.
    """
    read = read_guide_point_frames(paths)
    if len(read) != frames:
        raise OptionError(
            f"option --contours: expected contours of each of {frames} frames, found {len(read)}; of a moving model in "
            "a file of version 1 only the knots are known: track it again"
        )
    turn = turn_to_model(paths[0], CONTOURS, marks)
    mitral = [_mitral(points, paths[0]) @ turn.T for points in read]
    return mitral, [points.rv_inserts @ turn.T for points in read]


def _loop(file: Path, marks: SpaceAndUnit) -> Array:
    """All points of a file, but of contours the mitral ones."""
    if is_guide_points(file):
        return _mitral(read_guide_points(file), file) @ turn_to_model(file, CONTOURS, marks).T
    return read_point_set(file).in_metric_unit().points @ turn_to_model(file, space_and_unit_of(file), marks).T


def _mitral(points: GuidePoints, file: Path) -> Array:
    found = points.mitral
    if len(found) < FEWEST:
        raise InputError(
            f"{str(file)!r}, frame {points.frame}: expected {FEWEST} or more points MITRAL_VALVE for a plane, found "
            f"{len(found)}"
        )
    return found


def coordinates(text: str, count: int, option: str) -> list[float]:
    """Numbers between commas.

    Raises:
        OptionError: not `count` of them.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise OptionError(f"option {option}={text!r}: expected {count} numbers between commas")
    return values
