"""Named segments of a label image, which may overlap: one voxel value for each combination of segments."""

import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import OptionError
from quadriform.words import first_of

SEPARATORS = re.compile(r"[,+]")
LISTED = 12
"""The number of segments or labels that a message lists, the largest first."""


@dataclass(frozen=True)
class Segment:
    """A part of an image that its file names.

    Attributes:
        name: of the file.
        number: of the file.
        values: the voxel values of the segment; several where it overlaps others.
    """

    name: str
    number: int
    values: tuple[int, ...]


@dataclass
class SegmentMap:
    """A label image to which segments are added one after the other; they may overlap.

    Attributes:
        values: (i, j, k), 0 where there is no segment.
        segments: so far.
    """

    values: NDArray[np.int32]
    segments: list[Segment] = field(default_factory=list)

    def add(self, name: str, number: int, mask: NDArray[Any]) -> None:
        """Add a segment.

        Args:
            name: of the file.
            number: of the file; its voxel value where no other segment has it.
            mask: (i, j, k) bool, its voxels.
        """
        used = {value for segment in self.segments for value in segment.values}
        own: list[int] = []
        for old in np.unique(self.values[mask]).tolist():
            unused = number if old == 0 and number > 0 and number not in used else max(used | {0}) + 1
            # a combination that lies inside the mask as a whole keeps its value
            inside = bool(old) and not (~mask & (self.values == old)).any()
            new = old if inside else unused
            used.add(new)
            own.append(new)
            self.values[mask & (self.values == old)] = new
            if old not in (0, new):
                self._extend(old, new)
        self.segments.append(Segment(name, number, tuple(own)))

    def _extend(self, old: int, new: int) -> None:
        """Add the value `new`, which some voxels of `old` have now, to the segments of `old`."""
        self.segments = [
            replace(segment, values=(*segment.values, new)) if old in segment.values else segment
            for segment in self.segments
        ]


def values_of(segments: tuple[Segment, ...], label: int | str) -> tuple[int, ...]:
    """Return the voxel values of a segment by number or name, or of several, with `,` or `+` between these.

    Args:
        segments: of the image.
        label: number, which is the voxel value itself where no segment has it; name; or a text of several names or
            numbers.

    Raises:
        OptionError: no segment has this name, or several have this name or number.
    """
    if isinstance(label, str):
        return _by_name(segments, label)
    found = [segment for segment in segments if segment.number == label]
    if len(found) > 1:
        raise OptionError(f"option label={label}: {len(found)} segments have this number; {described(segments)}")
    return found[0].values if found else (label,)


def described(segments: tuple[Segment, ...]) -> str:
    """Return the segments of an image as a message lists them."""
    if not segments:
        return "the image names no segments; give the value of a label"
    return f"the image has the segments {first_of([f'{one.number} {one.name!r}' for one in segments], LISTED)}"


def _by_name(segments: tuple[Segment, ...], name: str) -> tuple[int, ...]:
    name = name.strip()
    found = [segment for segment in segments if segment.name == name]
    found = found or [segment for segment in segments if segment.name.lower() == name.lower()]
    if len(found) == 1:
        return found[0].values
    words = [word.strip() for word in SEPARATORS.split(name)]
    if found or len(words) == 1:
        fault = f"{len(found)} segments have this name; choose by number" if found else "there is no such segment"
        raise OptionError(f"option label={name!r}: {fault}; {described(segments)}")
    parts = (values_of(segments, int(word) if word.isdecimal() else word) for word in words)
    return tuple(dict.fromkeys(value for part in parts for value in part))
