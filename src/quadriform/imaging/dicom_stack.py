"""A stack of slices from the images of a series: slices sorted by position, frames by time.

What does not make a regular grid is refused, and the images are named; nothing is filled in or left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.errors import InputError
from quadriform.imaging.dicom_spacing import (
    LISTED,
    ROUNDING,
    ImagePlane,
    check_same_grid,
    names,
    slice_step,
    world_from_voxel,
)
from quadriform.points import Array

Slices = list[list[ImagePlane]]
"""Images by position along the normal; those at one position are the frames."""


@dataclass(frozen=True)
class SliceStack:
    """Images on a regular grid.

    Attributes:
        frames: by frame, then by slice along the normal of the images.
        world_from_voxel: (4, 4), LPS mm; i runs along a row, j down the rows, k over the slices.
        times: (frames,) ms, the mean trigger time of each frame; None where the headers have none.
    """

    frames: tuple[tuple[ImagePlane, ...], ...]
    world_from_voxel: Array
    times: Array | None


def stack_slices(planes: Sequence[ImagePlane]) -> SliceStack:
    """Return the images of one series, sorted by position, then by time.

    Times are trigger times, else acquisition times, else the count of the scanner: the first that every image has, and
    that differs among the images of each position.

    Args:
        planes: all images of the series, in any order.

    Raises:
        InputError: sizes, orientations or spacings differ, a slice or frame is missing or contained twice, or there is
            one slice position alone.
    """
    check_same_grid(planes)
    slices = _by_position(planes)
    _check_counts(slices)
    slices, times = _by_time(slices)
    first = slices[0][0]
    step = slice_step([group[0] for group in slices])
    return SliceStack(tuple(zip(*slices, strict=True)), world_from_voxel(first, step, first.origin), times)


def _by_position(planes: Sequence[ImagePlane]) -> Slices:
    # positions along the normal of the slices; nothing is rounded before it is compared
    heights = np.array([plane.origin for plane in planes]) @ planes[0].normal
    order = np.argsort(heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order]) > ROUNDING) + 1
    slices = [[planes[n] for n in group] for group in np.split(order, starts)]
    for first, *others in slices:
        shifted = [plane for plane in others if np.linalg.norm(plane.origin - first.origin) > 2 * ROUNDING]
        if shifted:
            raise InputError(
                f"{first.name} and {shifted[0].name} lie in the same plane, but begin at {first.position} and "
                f"{shifted[0].position}; keep one stack of slices"
            )
    if len(slices) == 1:
        raise InputError(
            f"one slice position alone, at {planes[0].position} ({len(planes)} images); expected a stack of slices"
        )
    return slices


def _check_counts(slices: Slices) -> None:
    # each position needs one image of each frame
    counts = [len(group) for group in slices]
    usual = max(set(counts), key=counts.count)
    odd = [f"{len(group)} at {group[0].position} ({names(group)})" for group in slices if len(group) != usual]
    if odd:
        raise InputError(
            f"a ragged series: {counts.count(usual)} of {len(slices)} slice positions have {usual} images; others have "
            f"{'; '.join(odd[:LISTED])}; fetch what is missing, or remove what is contained twice"
        )


def _by_time(slices: Slices) -> tuple[Slices, Array | None]:
    # TriggerTime (C.7.6.18.1) is relative to the R wave; the other two only order the images
    for key in ("trigger_time", "acquisition_time", "number"):
        times = np.array([[getattr(plane, key) for plane in group] for group in slices], dtype=np.float64)
        if not (np.isfinite(times).all() and all(len(set(row)) == len(row) for row in times.tolist())):
            continue
        order = np.argsort(times, axis=1)
        ordered = [[group[n] for n in row] for group, row in zip(slices, order)]
        if key != "trigger_time":
            return ordered, None
        times = np.sort(times, axis=1)
        _check_phases(times, ordered)
        return ordered, times.mean(axis=0)
    first = slices[0]
    if len(first) == 1:
        return slices, None
    raise InputError(
        f"{len(first)} images at each position and no trigger time, acquisition time or instance number that "
        f"distinguishes them, as {names(first)} at {first[0].position}; are these copies?"
    )


def _check_phases(times: Array, slices: Slices) -> None:
    """Refuse slices of which different frames are missing: the counts are equal, the phases of the cycle are not.

    Heart rates differ from breath-hold to breath-hold. So times are counted from the first frame of each slice, in mean
    frame intervals of that slice: each must agree with the median over the slices to half an interval. So must the
    times of the first frames.
    """
    n = times.shape[1]
    if n < 3:
        return
    # times in units of the mean frame interval of each slice
    step = np.ptp(times, axis=1) / (n - 1)
    phases = (times - times[:, :1]) / step[:, None]
    late = np.abs(phases - np.median(phases, axis=0)).max(axis=1) > 0.5
    late |= np.abs(times[:, 0] - np.median(times[:, 0])) > 0.5 * step
    if late.any():
        odd = [f"{slices[k][0].name} at {slices[k][0].position}" for k in np.flatnonzero(late)]
        raise InputError(
            f"a ragged series: the trigger times of {int(late.sum())} of {len(slices)} slices do not fit the others', "
            f"so frames are missing; they begin with {'; '.join(odd[:LISTED])}"
        )
