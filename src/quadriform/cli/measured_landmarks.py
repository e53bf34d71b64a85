"""Base and RV insertions of `quadriform measure` from options, files of points or contours; in the models' frame."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.inputs import rotation_to_model
from quadriform.cli.options import decimals
from quadriform.errors import InputError, OptionError
from quadriform.files.guide_points import (
    MIN_MITRAL_POINTS,
    GuidePoints,
    is_guide_points,
    read_guide_point_frames,
    read_guide_points,
)
from quadriform.files.points import read_point_set
from quadriform.imaging.file_points import SpaceAndUnit, space_and_unit_of
from quadriform.points import Array

if TYPE_CHECKING:
    from quadriform.heart.base import Base

CONTOURS: SpaceAndUnit = ("LPS", "mm")
PLANE = re.compile(r"[^/,]*,[^/,]*,[^/,]*[/,][^/,]*,[^/,]*,[^/,]*")
"""x,y,z/nx,ny,nz as `fit` takes and shows it, or six numbers between commas."""


def read_base(options: Sequence[str], metadata: SpaceAndUnit) -> "Base":
    """The base as `measure` takes it.

    Args:
        options: --base, as given.
        metadata: frame of the world and unit of the models.

    Raises:
        QuadriformError: an option or a file that cannot be read.
    """
    if not options:
        return None
    if len(options) > 1:
        return [_loop(Path(option), metadata) for option in options]
    try:
        return float(options[0])
    except ValueError:
        pass
    # a file whose name looks like a plane is a file
    if PLANE.fullmatch(options[0]) and not Path(options[0]).exists():
        plane = decimals(options[0].replace("/", ","), "--base", 6)
        return plane[:3], plane[3:]
    return _loop(Path(options[0]), metadata)


def read_contours(paths: Sequence[Path], frames: int, metadata: SpaceAndUnit) -> tuple[list[Array], list[Array]]:
    """Mitral points and RV insertions (n, 3) of every frame; there may be none of the second.

    Args:
        paths: a folder of files GPFile_NNN.txt, or such files.
        frames: how many there are to be.
        metadata: frame of the world and unit of the models.

    Raises:
        QuadriformError: another number of frames, a frame without mitral points, or a file that cannot be read.
    """
    read = read_guide_point_frames(paths)
    if len(read) != frames:
        raise OptionError(
            f"option --contours: expected contours of each of {frames} frames, found {len(read)}; a file of "
            "a moving model of version 1 has the times of its knots only: track it again"
        )
    rotation = rotation_to_model(paths[0], CONTOURS, metadata)
    mitral = [_mitral(points, paths[0]) @ rotation.T for points in read]
    return mitral, [points.rv_inserts @ rotation.T for points in read]


def _loop(file: Path, metadata: SpaceAndUnit) -> Array:
    """All points of a file; the mitral points of contours."""
    if is_guide_points(file):
        return _mitral(read_guide_points(file), file) @ rotation_to_model(file, CONTOURS, metadata).T
    return read_point_set(file).in_metric_unit().points @ rotation_to_model(file, space_and_unit_of(file), metadata).T


def _mitral(points: GuidePoints, file: Path) -> Array:
    found = points.mitral
    if len(found) < MIN_MITRAL_POINTS:
        raise InputError(
            f"{str(file)!r}, frame {points.frame}: expected {MIN_MITRAL_POINTS} or more points MITRAL_VALVE for a "
            f"plane, found {len(found)}"
        )
    return found
