"""The frames of a moving object from files of any kind: points by surface, slices, times, and notes of assumptions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import InputError, OptionError, Warnings, join_warnings
from quadriform.files.frame_numbers import frame_numbers, in_time, missing_numbers, names_of
from quadriform.files.guide_points import FILE_NAME, GuidePoints, is_guide_points, read_guide_point_frames
from quadriform.files.reading import visible_files
from quadriform.imaging.contour_landmarks import landmarks_of_contours
from quadriform.imaging.file_points import (
    ReadOptions,
    Source,
    SpaceAndUnit,
    common_space_and_unit,
    has_points,
    kind_of,
    read_source,
)
from quadriform.point_sets import ALONE, PointSet
from quadriform.points import Array
from quadriform.shapes.landmarks import Landmarks

if TYPE_CHECKING:
    from quadriform.imaging.labels import Preset
    from quadriform.imaging.object_choice import Labels
    from quadriform.imaging.ventricle_files import LabelledHeart

LARGEST_EXACT = 2**53
"""Larger whole numbers are not exact as times."""
WALLS = ("endo", "epi")
NO_BASE = "not all frames have a plane of mitral points: volumes are those of the closed surfaces"
SAME_GRID = 1e-3
"""Transforms of images whose entries differ by less, in the unit of the image, are the same."""


@dataclass
class FrameSeries:
    """The frames of a moving object.

    Attributes:
        sets: for each frame its points by surface, as `track` takes them.
        slice_of_point: the slice number of each point, in the same form; for frames of contours and images only.
        grids: for these frames world from voxel of the image, (4, 4); None for contours.
        landmarks: of ventricles, one entry a frame; empty where none are known.
        space_and_unit: of all frames.
        times: (F,) of the frames, where the files have them.
        period: after which the motion repeats, where the times are the numbers of frames of which some are missing.
        warnings: of reading the files.
        notes: what was assumed, one sentence each.
    """

    sets: list[dict[str, PointSet]] = field(default_factory=list)
    slice_of_point: list[dict[str, NDArray[np.int64]]] = field(default_factory=list)
    grids: list[Array | None] = field(default_factory=list)
    landmarks: tuple[Landmarks, ...] = ()
    space_and_unit: SpaceAndUnit = ("unknown", "unknown")
    times: Array | None = None
    period: float | None = None
    warnings: Warnings = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def clouds(self) -> list[dict[str, Array]]:
        """The points alone, (n, 3), in the same form."""
        return [{name: each.points for name, each in frame.items()} for frame in self.sets]

    def add(self, frame: dict[str, PointSet], space_and_unit: SpaceAndUnit) -> None:
        """Append a frame.

        Raises:
            InputError: its space or unit is not that of the frames before.
        """
        if self.sets and space_and_unit != self.space_and_unit:
            before, other = " ".join(self.space_and_unit), " ".join(space_and_unit)
            raise InputError(f"the frames differ in space or unit: the first is in {before}, another in {other}")
        self.space_and_unit = space_and_unit
        self.sets.append(frame)

    def add_sources(self, sources: Mapping[str, Source]) -> None:
        """Append a frame with a file for each surface, or an image for all; warnings of one kind are joined.

        Raises:
            InputError: surfaces or frames differ in space or unit.
        """
        self.add({name: source.cloud for name, source in sources.items()}, common_space_and_unit(sources))
        for source in sources.values():
            self.notes += source.notes
            self.warnings = join_warnings(self.warnings, source.warnings)
        numbers = {name: each.slice_of_point for name, each in sources.items() if each.slice_of_point is not None}
        if numbers:
            image = next(iter(sources.values())).image
            self.slice_of_point.append(numbers)
            self.grids.append(None if image is None else image.world_from_voxel)

    def use_numbers(self, numbers: Sequence[int]) -> None:
        """Take the numbers of the frames for their times where some between them are missing, with a note."""
        missing = missing_numbers(numbers)
        if not missing or max(numbers) > LARGEST_EXACT:
            return
        self.times = np.array(numbers, dtype=np.float64)
        # after the last frame the first one follows at the shortest interval, which is that without a gap
        self.period = float(numbers[-1] - numbers[0] + min(late - early for early, late in pairwise(numbers)))
        self.notes.append(
            f"there are no frames with the numbers {missing}: the numbers of the others are their times, and the model "
            f"moves smoothly between them; the cycle lasts {self.period:g} where no period is given"
        )

    def with_times(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return options of `track`, with times and period of the files where they are not given."""
        if "times" in options or self.times is None or len(self.times) != len(self.sets):
            return dict(options)
        period = {"period": self.period} if self.period and options.get("period", "auto") == "auto" else {}
        return dict(options) | {"times": self.times} | period

    @property
    def bases(self) -> list[tuple[Array, Array] | None] | None:
        """The base of each frame as `track` takes it; None where none is known."""
        planes = [each.base for each in self.landmarks]
        return [None if plane is None else (plane.point, plane.direction) for plane in planes] or None


def frame_files(inputs: Sequence[Path]) -> list[Path]:
    """Return the files of the frames in the order of time: that of the number in their names, else that of `inputs`.

    The order of `inputs` counts where each file has a name of its own kind. `in_time` has the rules.

    Raises:
        InputError: a folder without any, or an order that is not clear, as of files of a folder without numbers.
    """
    result: list[Path] = []
    for path in inputs:
        is_series = path.is_dir() and not kind_of(path)
        result += _files_in(path) if is_series else [path]
    return in_time(result, by_hand=all(path in inputs for path in result))


def _files_in(folder: Path) -> list[Path]:
    inside = visible_files(folder)
    contours = [file for file in inside if FILE_NAME.fullmatch(file.name)]
    chosen = contours or [file for file in inside if has_points(file)]
    if not chosen:
        raise InputError(f"{str(folder)!r}: the folder contains no contours, points, meshes or images")
    return chosen


def read_frames(
    files: Sequence[Path],
    surfaces: Sequence[str],
    columns: str | None = None,
    affine: str | None = None,
    heart: "LabelledHeart | None" = None,
) -> FrameSeries:
    """Return the frames of files in the order of time: contours, 4-D images, or one file of points or a mesh each.

    Args:
        files: as `frame_files` finds and orders them.
        surfaces: NAME=label:VALUES of label images, such as epi=label:1+2; empty for points of one surface.
        columns: of tables and arrays, as `read_points` takes them.
        affine: which transform of NIfTI headers, as `read_volume` takes it.
        heart: which labels of images are the parts of a ventricle, in place of `surfaces`.

    Raises:
        QuadriformError: a file gives no points, or the frames differ in space or unit.
    """
    from quadriform.imaging.labels import parse_surface

    frames = FrameSeries()
    labels = dict(map(parse_surface, surfaces))
    if files and heart is None and all(map(is_guide_points, files)):
        _add_contours(frames, files, labels)
        return frames
    for file in files:
        if is_guide_points(file):
            raise InputError(f"{str(file)!r}: holds contours, {str(files[0])!r} and others do not; expected one kind")
        if heart is not None:
            _add_ventricles(frames, file, heart, affine)
        elif kind_of(file) == "image":
            _add_image(frames, file, labels, affine)
        else:
            frames.add_sources({ALONE: read_source(file, ReadOptions(columns=columns))})
    if heart is not None:
        _check_ends(frames)
    note_order(frames, files)
    return frames


def note_order(frames: FrameSeries, files: Sequence[Path]) -> None:
    """Note the order of several files; missing numbers in their names determine the times."""
    if len(files) < 2:
        return
    numbers = frame_numbers(files)
    order = "order in which they are given" if numbers is None else "order of the numbers in their names"
    frames.notes.append(f"{len(files)} files are taken in the {order}: {names_of(files)}")
    if numbers is not None and len(frames.sets) == len(files):
        frames.use_numbers(numbers)


def _add_contours(frames: FrameSeries, files: Sequence[Path], labels: "Mapping[str, Labels | Preset]") -> None:
    if labels:
        raise OptionError(
            f"option --surface does not go with contours such as {files[0].name!r}: their types name surfaces"
        )
    every = read_guide_point_frames(files)
    usable = [frame for frame in every if frame.has_any]
    if not usable:
        raise InputError(f"{names_of(files)}: no points of the left ventricle's contours in any frame")
    names = [name for name in WALLS if any(frame.has(name) for frame in usable)]
    for frame in usable:
        found = {name: frame.surface(name) for name in names}
        frames.add({name: PointSet(points) for name, (points, _) in found.items()}, ("LPS", "mm"))
        frames.slice_of_point.append({name: numbers for name, (_, numbers) in found.items()})
        frames.grids.append(None)
    frames.landmarks = landmarks_of_contours(usable)
    _note_contours(frames, files, every)
    if frames.landmarks and frames.landmarks[0].base is None:
        frames.notes.append(NO_BASE)


def _note_contours(frames: FrameSeries, files: Sequence[Path], every: Sequence[GuidePoints]) -> None:
    usable = [frame for frame in every if frame.has_any]
    if len(every) > 1:
        frames.notes.append(
            f"{len(every)} frames of contours are taken in the order of their numbers: {names_of(files)}"
        )
    empty = [str(frame.frame) for frame in every if not frame.has_any]
    if empty:
        frames.notes.append(f"frames without points of the left ventricle's contours: {', '.join(empty)}")
    if any(not set(np.unique(weights)) <= {0, 1} for frame in usable for weights in frame.weights.values()):
        frames.notes.append("weights of the contours other than 0 and 1 are not used")
    if len(usable) > 1:
        frames.use_numbers([frame.frame for frame in usable])


def _add_image(frames: FrameSeries, file: Path, labels: "Mapping[str, Labels | Preset]", affine: str | None) -> None:
    from quadriform.imaging.reading import frame_count, frame_times

    count = frame_count(file)
    if count > 1:
        frames.times = frame_times(file)
    for number in range(count):
        options = replace(ReadOptions(), frame=number if count > 1 else None, affine=affine)
        chosen = {name: options.with_surface(value) for name, value in labels.items()} or {ALONE: options}
        frames.add_sources({name: read_source(file, option) for name, option in chosen.items()})


def _add_ventricles(frames: FrameSeries, file: Path, heart: "LabelledHeart", affine: str | None) -> None:
    from quadriform.imaging.reading import frame_times
    from quadriform.imaging.ventricle_files import read_ventricle_frames

    found = read_ventricle_frames(file, heart, affine)
    if len(found) > 1:
        frames.times = frame_times(file)
    for each in found:
        frames.add_sources(each.surfaces)
        frames.landmarks = (*frames.landmarks, each.landmarks)


def _check_ends(frames: FrameSeries) -> None:
    """Refuse frames whose bases face each other; where one has none, those of the others are dropped, with a note.

    Raises:
        InputError: naming the frames.
    """
    bases = [each.base for each in frames.landmarks]
    known = [base for base in bases if base is not None]
    opposite = [n for n, base in enumerate(bases) if base is not None and base.direction @ known[0].direction <= 0]
    if opposite:
        raise InputError(
            f"frames {', '.join(map(str, opposite))}: the base was found at the other end than in the first one with a "
            "base; expected labels that are wider at the base in all frames"
        )
    if len(known) < len(bases):
        frames.landmarks = ()
        frames.notes.append("the labels of some frames end at no base: volumes are those of the closed surfaces")


def drop_points_between_slices(frames: FrameSeries) -> None:
    """Remove from `frames` the points of images that lie between two slices, with a note of their number.

    Contours have none. Points of caps, beyond the first or the last outline, stay: they determine the surface, and no
    motion of a slice.

    Raises:
        OptionError: frames without slice numbers, or whose numbers do not mean the same slices.
    """
    from quadriform.imaging.image_points import BETWEEN, slice_axis

    if len(frames.slice_of_point) != len(frames.sets):
        raise OptionError("option --shift-slices needs slice numbers in all frames: contours, or images")
    first = frames.grids[0]
    for number, grid in enumerate(frames.grids):
        if not _same_slices(first, grid):
            raise OptionError(f"option --shift-slices: the slices of frame {number} are not those of frame 0")
    if first is None:
        return
    removed = total = 0
    for frame, every in zip(frames.sets, frames.slice_of_point):
        for name, numbers in every.items():
            kept = numbers != BETWEEN
            removed, total = removed + int((~kept).sum()), total + len(kept)
            frame[name], every[name] = frame[name].take(kept), numbers[kept]
    # the points between slices have no slice that could move
    axis = slice_axis(first)
    frames.notes.append(
        f"slices are taken along {'ijk'[axis]}, {np.linalg.norm(first[:3, axis]):.3g} apart; {removed} of {total} "
        "points lie between two slices and are left out"
    )


def _same_slices(one: Array | None, other: Array | None) -> bool:
    """Whether two frames have slices of contours, or images on one grid."""
    if one is None or other is None:
        return one is other
    return np.allclose(one, other, rtol=0, atol=SAME_GRID)
