"""What the object of an image is where the caller does not say: segments, labels, or what is above Otsu's threshold.

1. A file that names its segments: the one segment; of several one must be chosen.
2. Values that are not all whole numbers, or some below 0: a grey image.
3. One value beside 0: a mask.
4. Otherwise the voxels decide. In a label image neighbours mostly have the same label; in a grey image noise and
   shading make them differ. Counted are pairs of voxels that share a side, both neither 0 nor the most frequent value.
   Where fewer than SAME_NEIGHBOURS of them are equal, it is a grey image. A file that states that its values are
   labels is believed without counting.
5. Up to FEW labels are taken together, which is said; of more one must be chosen.

Values that are whole numbers but for the edges of regions are an interpolated label image: a label or a threshold must
be chosen.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import MaskError
from quadriform.imaging.segments import LISTED
from quadriform.imaging.selection import Labels, Select
from quadriform.imaging.volume import Volume

FEW = 32
"""So many labels are taken together; more are the organs of a body or the regions of a brain, which make no object."""
SAME_NEIGHBOURS = 0.4
"""Blocks of 2 x 2 x 2 voxels that touch each other have 0.5. Whole numbers with noise of one unit have 0.28."""
MOSTLY = 0.5
"""Where this share of the voxels beside 0 has whole numbers of several values, the others come from interpolation."""

Choice = tuple[Select, tuple[str, ...]]
"""What the object is, and what was assumed."""


def choose_object(volume: Volume) -> Choice:
    """How the object is told from its background, by the rules of this module, and what is to be said of it.

    Raises:
        MaskError: a label or a threshold must be chosen; the candidates are listed with their voxels.
    """
    if volume.segments:
        return _of_segments(volume)
    values = volume.values
    present, counts = counted(values)
    if not volume.is_label_map:
        if not np.array_equal(present, np.round(present)):
            _check_interpolated(values, present, counts)
            return _grey()
        if present[0] < 0 or not (len(present[present != 0]) <= 1 or _in_regions(values, present, counts)):
            return _grey()
    labels = tuple(int(value) for value in present if value != 0)
    if len(labels) > FEW:
        raise MaskError(f"{len(labels)} values in connected regions, as of a label image: {_ask(present, counts)}")
    if not labels:
        return 0.5, ()  # refused there as an empty mask, with the values listed
    together = (
        f"labels {', '.join(map(str, labels))} together; --label chooses" if len(labels) > 1 else f"label {labels[0]}"
    )
    return Labels(labels), (f"taken as a label image, the object is {together}",)


def counted(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """The values of an image in increasing order, and the number of voxels of each."""
    if values.dtype.kind in "bu" and values.dtype.itemsize <= 2:
        all_counts = np.bincount(values.ravel())
        present = np.flatnonzero(all_counts)
        return present, all_counts[present]
    return np.unique(values, return_counts=True)


def _grey() -> Choice:
    return "otsu", ("taken as a grey image, thresholded by Otsu's method; --threshold or --label chooses otherwise",)


def _of_segments(volume: Volume) -> Choice:
    present, counts = counted(volume.values)
    voxels = dict(zip(present.tolist(), counts.tolist()))
    sizes = {one: sum(voxels.get(value, 0) for value in one.values) for one in volume.segments}
    filled = {one: size for one, size in sizes.items() if size > 0}
    if len(filled) == 1 and len(present[present != 0]) == len(next(iter(filled)).values):
        one = next(iter(filled))
        return Labels(one.values), (f"the object is the segment {one.name!r}",)
    ordered = sorted(filled.items(), key=lambda item: -item[1])
    shown = ", ".join(f"{one.name!r} ({one.number}): {size}" for one, size in ordered[:LISTED])
    raise MaskError(
        f"the image has {len(filled)} segments with voxels; choose with --label NAME, in Python with "
        f"Labels((NAME,)). Voxels: {shown}{_more(len(ordered))}"
    )


def _in_regions(values: NDArray[Any], present: NDArray[Any], counts: NDArray[np.int64]) -> bool:
    """Whether neighbouring voxels mostly have the same value, background left out."""
    return _equal_pairs(values, (0, present[counts.argmax()])) >= SAME_NEIGHBOURS


def _equal_pairs(values: NDArray[Any], background: tuple[Any, ...]) -> float:
    """The share of equal pairs among voxels that share a side and are no background; 1 where there are none."""
    shown = ~np.isin(values, background)
    equal = pairs = 0
    for axis in range(values.ndim):
        low, high = np.s_[:-1], np.s_[1:]
        first = (slice(None),) * axis
        both = shown[(*first, low)] & shown[(*first, high)]
        pairs += int(both.sum())
        equal += int((both & (values[(*first, low)] == values[(*first, high)])).sum())
    return equal / pairs if pairs else 1.0


def _check_interpolated(values: NDArray[Any], present: NDArray[Any], counts: NDArray[np.int64]) -> None:
    """Refuse what is a label image but for the edges of its regions."""
    whole = (present == np.round(present)) & (present != 0)
    if present[0] < 0 or whole.sum() < 2 or counts[whole].sum() < MOSTLY * counts[present != 0].sum():
        return
    if _equal_pairs(values, (0, *present[~whole])) >= SAME_NEIGHBOURS:
        raise MaskError(
            f"{int(counts[~whole].sum())} voxels lie between whole numbers, as where a label image was interpolated: "
            f"{_ask(present[whole], counts[whole])}"
        )


def _ask(present: NDArray[Any], counts: NDArray[np.int64]) -> str:
    kept = present != 0
    order = np.argsort(-counts[kept], kind="stable")
    shown = ", ".join(f"{present[kept][n]:g}: {counts[kept][n]}" for n in order[:LISTED])
    return (
        "choose with --label, in Python with Labels((VALUE,)), or a grey image's object with --threshold, as otsu. "
        f"Labels and voxels: {shown}{_more(len(order))}"
    )


def _more(count: int) -> str:
    return f" and {count - LISTED} more" if count > LISTED else ""
