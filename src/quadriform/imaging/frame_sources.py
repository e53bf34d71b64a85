"""The frames of a moving object from files of any kind: points by surface, slices, times, and what was assumed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import InputError, OptionError, Warnings, join_warnings
from quadriform.files.guide_points import FRAME_FILE, read_guide_points
from quadriform.fitting.fit import ALONE
from quadriform.imaging.sources import ImageOptions, Marks, kind_of, read_source
from quadriform.points import Array

SAME_GRID = 1e-3
"""Transforms of images whose entries differ by less, in the unit of the image, are the same."""


@dataclass
class Frames:
    """What the files hold.

    Attributes:
        clouds: for each frame its points by surface.
        slices: the slice number of each point, in the same form; for frames of contours and images alone.
        grids: for these frames world from voxel of the image, (4, 4); None for contours.
        marks: frames of the world and units that were found.
        times: of the frames, where a file tells.
        warnings: of the reading.
        notes: what was assumed, one sentence each.
    """

    clouds: list[dict[str, Array]] = field(default_factory=list)
    slices: list[dict[str, NDArray[np.int64]]] = field(default_factory=list)
    grids: list[Array | None] = field(default_factory=list)
    marks: set[tuple[str, str]] = field(default_factory=set)
    times: Array | None = None
    warnings: Warnings = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def add(
        self, clouds: dict[str, Array], marks: Marks, warnings: Warnings | None = None, notes: Sequence[str] = ()
    ) -> None:
        """One more frame, the warnings of its reading joined with those of the others."""
        self.clouds.append(clouds)
        self.marks.add(marks)
        self.add_warnings(warnings or {})
        self.notes += notes

    def add_warnings(self, warnings: Warnings) -> None:
        """More warnings; two of one kind are joined."""
        self.warnings = join_warnings(self.warnings, warnings)


def frame_files(inputs: Sequence[Path]) -> list[Path]:
    """The files of the frames in order; those of a folder by name.

    Raises:
        InputError: a folder without any.
    """
    result = []
    for path in inputs:
        if not path.is_dir() or kind_of(path):
            result.append(path)
            continue
        inside = sorted(file for file in path.iterdir() if file.is_file())
        chosen = [file for file in inside if FRAME_FILE.fullmatch(file.name)] or [
            file for file in inside if kind_of(file)
        ]
        if not chosen:
            raise InputError(f"{str(path)!r}: the folder holds no contours, points, meshes or images")
        result += chosen
    return result


def read_frames(files: Sequence[Path], surfaces: Sequence[str]) -> Frames:
    """The frames of files in the order of time: contours, 4-D images, or a file of points, a mesh or an image each.

    Args:
        files: as `frame_files` finds them.
        surfaces: NAME=label:VALUES of label images, such as epi=label:1+2; empty for points of one surface.

    Raises:
        QuadriformError: a file gives no points, or the frames differ in their marks.
    """
    frames = Frames()
    labels = dict(_label(text) for text in surfaces)
    for file in files:
        if FRAME_FILE.fullmatch(file.name):
            _add_contours(frames, file, labels)
        elif kind_of(file) == "image":
            _add_image(frames, file, labels)
        else:
            source = read_source(file, ImageOptions())
            frames.add({ALONE: source.points}, (source.space, source.unit), source.warnings, source.notes)
    if len(frames.marks) > 1:
        raise InputError(f"the frames differ in frame of the world or unit: {sorted(frames.marks)}")
    return frames


def _add_contours(frames: Frames, file: Path, labels: Mapping[str, str]) -> None:
    if labels:
        raise OptionError(
            f"option --surface does not go with contours such as {file.name!r}: their types name surfaces"
        )
    read = read_guide_points(file)
    found = {name: read.surface(name) for name in ("endo", "epi")}
    frames.slices.append({name: slices for name, (_, slices) in found.items()})
    frames.grids.append(None)
    frames.add({name: points for name, (points, _) in found.items()}, ("LPS", "mm"))


def _add_image(frames: Frames, file: Path, labels: Mapping[str, str]) -> None:
    from quadriform.imaging.reading import frame_count, frame_times

    count = frame_count(file)
    if count > 1:
        frames.times = frame_times(file)
    for number in range(count):
        options = replace(ImageOptions(), frame=number if count > 1 else None)
        chosen = {name: options.with_label(value) for name, value in labels.items()} or {ALONE: options}
        sources = {name: read_source(file, option) for name, option in chosen.items()}
        first = next(iter(sources.values()))
        notes = [note for source in sources.values() for note in source.notes]
        warnings: Warnings = {}
        for source in sources.values():
            warnings = join_warnings(warnings, source.warnings)
        clouds = {name: source.points for name, source in sources.items()}
        frames.slices.append({name: source.slices for name, source in sources.items() if source.slices is not None})
        frames.grids.append(None if first.image is None else first.image.world_from_voxel)
        frames.add(clouds, (first.space, first.unit), warnings, notes)


def _label(text: str) -> tuple[str, str]:
    """A surface's name and its labels, as --label takes them."""
    from quadriform.imaging.labels import parse_surface

    name, labels = parse_surface(text)
    return name, ",".join(map(str, labels.values))


def keep_slices(frames: Frames) -> None:
    """Leave out the points of images that are of no slice; how many is said.

    Raises:
        OptionError: frames without slice numbers, or whose numbers do not mean the same slices.
    """
    from quadriform.imaging.slice_numbers import BETWEEN, slice_axis

    if len(frames.slices) != len(frames.clouds):
        raise OptionError("option --shift-slices needs slice numbers in all frames: contours, or images")
    first = frames.grids[0]
    for number, grid in enumerate(frames.grids):
        if not _same_slices(first, grid):
            raise OptionError(f"option --shift-slices: the slices of frame {number} are not those of frame 0")
    if first is None:
        return
    left = total = 0
    for clouds, slices in zip(frames.clouds, frames.slices):
        for name, numbers in slices.items():
            kept = numbers != BETWEEN
            left, total = left + int((~kept).sum()), total + len(kept)
            clouds[name], slices[name] = clouds[name][kept], numbers[kept]
    axis = slice_axis(first)
    frames.notes.append(
        f"slices are taken along {'ijk'[axis]}, {np.linalg.norm(first[:3, axis]):.3g} apart; {left} of {total} points "
        "lie between two slices and are left out"
    )


def _same_slices(one: Array | None, other: Array | None) -> bool:
    """Whether two frames have slices of contours, or images on one grid."""
    if one is None or other is None:
        return one is other
    return np.allclose(one, other, rtol=0, atol=SAME_GRID)
