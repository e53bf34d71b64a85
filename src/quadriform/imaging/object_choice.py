"""The selection of an object in an image, and where none is given: segments, labels, or what is above Otsu's threshold.

Where none is given:

1. A file that names its segments: the one segment; of several one must be chosen.
2. A file that states that its values are labels: a label image.
3. Values that are not all whole numbers, or some below -1: a grey image.
4. At most one value beside 0: a mask, which is a label image with one label.
5. Otherwise the voxels decide. It is a label image where
   - of the pairs of voxels that share a face, both neither 0 nor the most frequent value, a fraction SAME_NEIGHBOURS or
     more are equal, for neighbours mostly have the same label; and
   - of the voxels with six neighbours, none of them 0, at most a fraction ISOLATED equal none of these;
   else it is a grey image, whose noise and shading make neighbours differ.

Of a label image:

6. Its labels are taken together, with a note. One must be chosen where there are more than MAX_LABELS. So it must where
   a value is negative, or there are several labels and no voxel is 0, for then the background is not known: a mask of 0
   and -1 is refused.

Values that are not all whole numbers are refused, and a threshold must be chosen, where the file states that they are
labels (2), and where they are whole except at the edges of regions (3): these are an interpolated label image.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import MaskError
from quadriform.imaging.segments import LISTED
from quadriform.imaging.volume import Volume
from quadriform.words import first_of

NARROW = 1 << 16
"""Whole numbers over a wider range, and all other values, are sorted: a count of each would fill the memory."""
MAX_LABELS = 32
"""More are the organs of a body or the regions of a brain, which are no object together."""
SAME_NEIGHBOURS = 0.4
"""Blocks of 2 x 2 x 2 voxels that touch each other have 0.5. Whole numbers with noise of one unit have 0.28."""
ISOLATED = 0.02
"""Label images of hearts have 0.000, of 117 organs at a resolution that leaves 5 voxels each 0.007; whole numbers with
noise of 0.3 units have 0.07, of 0.6 units 0.12."""
MOSTLY = 0.5
"""Where this fraction of the voxels beside 0 has whole numbers of several values, the others are interpolated."""


@dataclass(frozen=True)
class Percentile:
    """A threshold: a fraction of a percentile of the values in the region.

    Attributes:
        fraction: 0.5 is half of the percentile.
        of: which percentile, from 0 to 100; 99.9 is robust against a few extreme voxels.
    """

    fraction: float
    of: float


@dataclass(frozen=True)
class Labels:
    """The union of some labels of a label image.

    Attributes:
        values: the labels, whole numbers, or names of segments where the file has names.
    """

    values: tuple[int | str, ...]


Select = float | Percentile | Labels | Literal["otsu", "auto"]
"""Which voxels are the object. Objects are strictly above a threshold."""

Choice = tuple[Select, tuple[str, ...]]
"""The selection of the object, and notes of what was assumed."""


def choose_object(volume: Volume) -> Choice:
    """Return the selection of the object by the rules of this module, and notes of what was assumed.

    Raises:
        MaskError: a label or a threshold must be chosen; the candidates are listed with their voxels.
    """
    if volume.segments:
        return _of_segments(volume)
    values = volume.values
    present, counts = counted(values)
    whole = np.array_equal(present, np.round(present))
    if not whole and volume.is_label_map:
        raise MaskError(
            "the file says that its values are labels, and not all are whole numbers: give the object's threshold with "
            "--threshold, as otsu (select='otsu')"
        )
    if not whole:
        _check_interpolated(values, present, counts)
        return _grey()
    mask = len(present[present != 0]) <= 1  # one value, whatever it is
    if not volume.is_label_map and (present[0] < -1 or not (mask or _in_regions(values, present, counts))):
        return _grey()
    labels = tuple(int(value) for value in present if value != 0)
    if ambiguity := _ambiguity(present):
        raise MaskError(f"{ambiguity}: {_candidates(present, counts)}")
    if not labels:
        return 0.5, ()  # all voxels are 0: no threshold finds an object, and `segment` refuses an empty mask
    object_labels = (
        f"labels {', '.join(map(str, labels))} together; --label, or --surface NAME=label:VALUES, chooses"
        if len(labels) > 1
        else f"label {labels[0]}"
    )
    return Labels(labels), (f"taken as a label image, the object is {object_labels}",)


def counted(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the values of an image in increasing order, and the number of voxels of each."""
    if not np.can_cast(values.dtype, np.int64) or int(values.max()) - int(values.min()) >= NARROW:
        return np.unique(values, return_counts=True)
    low = int(values.min())
    all_counts = np.bincount(values.ravel().astype(np.int64) - low)  # faster than a sort
    present = np.flatnonzero(all_counts)
    return present + low, all_counts[present]


def _ambiguity(present: NDArray[Any]) -> str:
    """Why a label must be chosen from these values; empty where all of them but 0 are taken together."""
    labels = len(present[present != 0])
    if labels > MAX_LABELS:
        return f"{labels} values in connected regions, as of a label image"
    if present[0] < 0:
        return f"whole numbers from {present[0]:g} in connected regions, as of a label image"
    return "a label image without a voxel of 0, the background" if present[0] > 0 and labels > 1 else ""


def _grey() -> Choice:
    return "otsu", (
        "taken as a grey image, thresholded by Otsu's method; --threshold or --label of fit or segment choose another",
    )


def _of_segments(volume: Volume) -> Choice:
    present, counts = counted(volume.values)
    voxels = dict(zip(present.tolist(), counts.tolist()))
    sizes = {one: sum(voxels.get(value, 0) for value in one.values) for one in volume.segments}
    filled = {one: size for one, size in sizes.items() if size > 0}
    if len(filled) == 1 and len(present[present != 0]) == len(next(iter(filled)).values):
        one = next(iter(filled))
        return Labels(one.values), (f"the object is the segment {one.name!r}",)
    ordered = sorted(filled.items(), key=lambda item: -item[1])
    shown = first_of([f"{one.name!r} ({one.number}): {size}" for one, size in ordered], LISTED)
    raise MaskError(
        f"the image has {len(filled)} segments with voxels; choose with --label or --surface NAME=label:SEGMENT, "
        f"by name or number, in Python with points_from_image(volume, select=Labels((NAME,))). Voxels: {shown}"
    )


def _in_regions(values: NDArray[Any], present: NDArray[Any], counts: NDArray[np.int64]) -> bool:
    """Whether neighbouring voxels mostly have the same value, without the background, and few are isolated."""
    return _equal_pairs(values, (0, present[counts.argmax()])) >= SAME_NEIGHBOURS and _isolated(values) <= ISOLATED


def _isolated(values: NDArray[Any]) -> float:
    """The fraction of voxels without an equal neighbour, among those with six neighbours, none of them 0."""
    # voxels at the border of the image have fewer than six neighbours
    middle = values[1:-1, 1:-1, 1:-1]
    counted_voxels, alone = middle != 0, np.ones(middle.shape, dtype=bool)
    for axis in range(values.ndim):
        for side in (slice(None, -2), slice(2, None)):
            beside = values[tuple(side if n == axis else slice(1, -1) for n in range(values.ndim))]
            counted_voxels &= beside != 0
            alone &= beside != middle
    return float((counted_voxels & alone).sum() / max(int(counted_voxels.sum()), 1))


def _equal_pairs(values: NDArray[Any], background: tuple[Any, ...]) -> float:
    """The fraction of equal pairs among voxels that share a face and are no background; 1 where there are none."""
    # the background has large regions in every image, grey or labelled
    counted_voxels = ~np.isin(values, background)
    equal = pairs = 0
    for axis in range(values.ndim):
        line, part = np.moveaxis(values, axis, 0), np.moveaxis(counted_voxels, axis, 0)  # neighbours are rows now
        both = part[:-1] & part[1:]
        pairs += int(both.sum())
        equal += int((both & (line[:-1] == line[1:])).sum())
    return equal / pairs if pairs else 1.0


def _check_interpolated(values: NDArray[Any], present: NDArray[Any], counts: NDArray[np.int64]) -> None:
    """Refuse values that are whole numbers except at the edges of regions."""
    # linear interpolation of labels gives fractions only between regions
    whole = (present == np.round(present)) & (present != 0)
    if present[0] < 0 or whole.sum() < 2 or counts[whole].sum() < MOSTLY * counts[present != 0].sum():
        return
    if _equal_pairs(values, (0, *present[~whole])) >= SAME_NEIGHBOURS:
        between = int(counts[present != np.round(present)].sum())
        raise MaskError(
            f"{between} voxels lie between whole numbers, as where a label image was interpolated: take the labels of "
            "the nearest voxels instead, or give a grey image's object with --threshold, as otsu (select='otsu')"
        )


def _candidates(present: NDArray[Any], counts: NDArray[np.int64]) -> str:
    kept = present != 0
    order = np.argsort(-counts[kept], kind="stable")
    shown = first_of([f"{present[kept][n]:g}: {counts[kept][n]}" for n in order], LISTED)
    return (
        "choose with --label or --surface NAME=label:VALUES, in Python with points_from_image(volume, "
        "select=Labels((VALUE,))), or a grey image's object with --threshold, as otsu. Labels and voxels: "
        f"{shown}"
    )
