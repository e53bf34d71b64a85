"""The selection of an object in an image: thresholds and labels."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Percentile:
    """A threshold: `fraction` times the percentile `of` the values in the region.

    Attributes:
        fraction: 0.5 is half of the percentile.
        of: percentile from 0 to 100; 99.9 is robust against a few extreme voxels.
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
