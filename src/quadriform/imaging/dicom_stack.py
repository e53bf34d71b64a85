"""Separate images of a series put in order: slices along their normal, frames in time, and nothing guessed.

The distance of slices is that of their positions, never a thickness or a location that the header also states; what
does not make a regular grid is refused with the images named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadriform.errors import InputError
from quadriform.points import Array

ROUNDING = 0.02
"""mm; positions are written with two decimals at the worst."""
UNEVEN = 0.01
"""A step from slice to slice may differ from the usual one by this share, and by `ROUNDING`."""
TURNED = 0.1
"""Two images have the same orientation when no corner moves by more than this many pixels."""
LISTED = 6
"""So many images are named in a message."""


@dataclass(frozen=True)
class ImagePlane:
    """One image of a series: where it lies in the world, when it was taken, and where its pixels are.

    Attributes:
        origin: (3,) centre of the first pixel, LPS mm.
        along_row: (3,) mm, the step to the next pixel of the same row.
        along_column: (3,) mm, the step to the next row.
        size: pixels in a row, rows.
        file: where the pixels are.
        index: which image of the file, from 0.
        alone: whether it is the only one there.
        slope: of the stored values.
        intercept: of the stored values.
        trigger_time: ms after the R wave, where known.
        acquisition_time: seconds of the day, where known.
        number: place in the series by the scanner's own count, where known.
    """

    origin: Array
    along_row: Array
    along_column: Array
    size: tuple[int, int]
    file: Path
    index: int = 0
    alone: bool = True
    slope: float = 1.0
    intercept: float = 0.0
    trigger_time: float | None = None
    acquisition_time: float | None = None
    number: float | None = None

    @property
    def name(self) -> str:
        """How messages call it."""
        return self.file.name if self.alone else f"image {self.index} of {self.file.name}"


@dataclass(frozen=True)
class SliceStack:
    """Planes on a regular grid.

    Attributes:
        frames: by frame, then by slice along the normal of the planes.
        world_from_voxel: (4, 4), LPS mm; i runs along a row, j down the rows, k over the slices.
        times: (frames,) ms, the mean trigger time of each frame; None where the headers have none.
    """

    frames: tuple[tuple[ImagePlane, ...], ...]
    world_from_voxel: Array
    times: Array | None


def stack_slices(planes: Sequence[ImagePlane], where: str) -> SliceStack:
    """Sort the planes of one series by position, then by time.

    Times are trigger times, else acquisition times, else the scanner's count: the first that every plane has, and that
    tells the planes of each position apart.

    Args:
        planes: all images of the series, in any order.
        where: how error messages name the series.

    Raises:
        InputError: sizes, orientations or spacings differ, a slice or frame is missing or there twice, or there is
            one slice position alone.
    """
    check_alike(planes, where)
    slices = _by_position(planes, where)
    _check_counts(slices, where)
    slices, times = _in_time(slices, where)
    step = _step(slices, where)
    affine = np.eye(4)
    first = slices[0][0]
    affine[:3] = np.column_stack([first.along_row, first.along_column, step, first.origin])
    return SliceStack(tuple(zip(*slices, strict=True)), affine, times)


def check_alike(planes: Sequence[ImagePlane], where: str) -> None:
    """Refuse planes of different sizes, orientations or spacings.

    Raises:
        InputError: naming the planes.
    """
    first = planes[0]
    _refuse(where, "images of different sizes", planes, lambda plane: plane.size != first.size, lambda p: f"{p.size}")
    allowed = TURNED * min(np.linalg.norm(first.along_row), np.linalg.norm(first.along_column)) / max(first.size)

    def turned(plane: ImagePlane) -> bool:
        moved = (plane.along_row - first.along_row, plane.along_column - first.along_column)
        return bool(np.linalg.norm(moved, axis=1).max() > allowed)

    def steps(plane: ImagePlane) -> str:
        return f"steps {plane.along_row.round(4).tolist()} and {plane.along_column.round(4).tolist()}"

    _refuse(where, "images of different orientations or pixel sizes", planes, turned, steps)


def _refuse(
    where: str,
    fault: str,
    planes: Sequence[ImagePlane],
    differs: Callable[[ImagePlane], bool],
    say: Callable[[ImagePlane], str],
) -> None:
    others = [plane for plane in planes if differs(plane)]
    if others:
        raise InputError(
            f"{where}: {fault}: {planes[0].name} has {say(planes[0])}, {others[0].name} has {say(others[0])}; "
            f"{len(others)} of {len(planes)} differ from the first: {_names(others)}; keep one stack of slices"
        )


def _by_position(planes: Sequence[ImagePlane], where: str) -> list[list[ImagePlane]]:
    """Planes of the same place together, places in the order of the normal."""
    normal = np.cross(planes[0].along_row, planes[0].along_column)
    normal /= np.linalg.norm(normal)
    heights = np.array([plane.origin @ normal for plane in planes])
    order = np.argsort(heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order]) > ROUNDING) + 1
    slices = [[planes[n] for n in group] for group in np.split(order, starts)]
    for group in slices:
        apart = [plane for plane in group if np.linalg.norm(plane.origin - group[0].origin) > 2 * ROUNDING]
        if apart:
            raise InputError(
                f"{where}: {group[0].name} and {apart[0].name} lie in the same plane, but begin at {_at(group[0])} "
                f"and {_at(apart[0])}; keep one stack of slices"
            )
    if len(slices) == 1:
        raise InputError(
            f"{where}: one slice position alone, at {_at(planes[0])} ({len(planes)} images); expected a stack of slices"
        )
    return slices


def _check_counts(slices: list[list[ImagePlane]], where: str) -> None:
    counts = [len(group) for group in slices]
    usual = max(set(counts), key=counts.count)
    odd = [f"{len(group)} at {_at(group[0])} ({_names(group)})" for group in slices if len(group) != usual]
    if odd:
        raise InputError(
            f"{where}: a ragged series: {counts.count(usual)} of {len(slices)} slice positions have {usual} images; "
            f"others have {'; '.join(odd[:LISTED])}; fetch what is missing, or take out what is there twice"
        )


def _in_time(slices: list[list[ImagePlane]], where: str) -> tuple[list[list[ImagePlane]], Array | None]:
    for key in ("trigger_time", "acquisition_time", "number"):
        times = np.array([[getattr(plane, key) for plane in group] for group in slices], dtype=np.float64)
        if not (np.isfinite(times).all() and all(len(set(row)) == len(row) for row in times.tolist())):
            continue
        order = np.argsort(times, axis=1)
        ordered = [[group[n] for n in row] for group, row in zip(slices, order)]
        if key != "trigger_time":
            return ordered, None
        times = np.sort(times, axis=1)
        _check_phases(times, ordered, where)
        return ordered, times.mean(axis=0)
    if len(slices[0]) == 1:
        return slices, None
    raise InputError(
        f"{where}: {len(slices[0])} images at each position and no trigger time, acquisition time or instance number "
        f"that tells them apart, as {_names(slices[0])} at {_at(slices[0][0])}; are these copies?"
    )


def _check_phases(times: Array, slices: list[list[ImagePlane]], where: str) -> None:
    """Refuse slices of which different frames are missing: the counts are equal, the phases of the cycle are not.

    Heart rates differ from breath-hold to breath-hold, so it is the share of each slice's own span that must agree,
    to half a frame; and the first frame, in time.
    """
    n = times.shape[1]
    if n < 3:
        return
    step = np.ptp(times, axis=1) / (n - 1)
    phases = (times - times[:, :1]) / step[:, None]
    late = np.abs(phases - np.median(phases, axis=0)).max(axis=1) > 0.5
    late |= np.abs(times[:, 0] - np.median(times[:, 0])) > 0.5 * step
    if late.any():
        odd = [f"{slices[k][0].name} at {_at(slices[k][0])}" for k in np.flatnonzero(late)]
        raise InputError(
            f"{where}: a ragged series: the trigger times of {int(late.sum())} of {len(slices)} slices do not fit the "
            f"others', so frames are missing; they begin with {'; '.join(odd[:LISTED])}"
        )


def _step(slices: list[list[ImagePlane]], where: str) -> Array:
    """The vector from slice to slice, when it is one."""
    origins = np.array([group[0].origin for group in slices])
    steps = np.diff(origins, axis=0)
    usual = np.median(steps, axis=0)
    off = np.linalg.norm(steps - usual, axis=1) > UNEVEN * np.linalg.norm(usual) + ROUNDING
    if off.any():
        gaps = [
            f"{np.linalg.norm(steps[k]):.4g} mm between {slices[k][0].name} at {_at(slices[k][0])} and "
            f"{slices[k + 1][0].name} at {_at(slices[k + 1][0])}"
            for k in np.flatnonzero(off)
        ]
        raise InputError(
            f"{where}: uneven spacing: slices are {np.linalg.norm(usual):.4g} mm apart, but "
            f"{'; '.join(gaps[:LISTED])}; is a slice missing, or there twice?"
        )
    return np.asarray((origins[-1] - origins[0]) / (len(origins) - 1))


def _names(planes: Sequence[ImagePlane]) -> str:
    more = f" and {len(planes) - LISTED} more" if len(planes) > LISTED else ""
    return ", ".join(plane.name for plane in planes[:LISTED]) + more


def _at(plane: ImagePlane) -> str:
    return f"({', '.join(f'{value:.2f}' for value in plane.origin)})"
