"""What the table says of each subject, and of all together: read part by part, so that any cohort has room."""

import heapq
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from quadriform.cohort.measures import NOTE, WARNING
from quadriform.cohort.stores import parts, read_measures

SHOWN = ("rms", "min det J", "ejection fraction", "myocardial mass")
"""Quantities of a whole subject that the page shows, where they were measured."""
VOLUME = "volume "


@dataclass(frozen=True, order=True)
class SubjectSummary:
    """One subject, in the order of trouble: warnings first, then distance.

    Attributes:
        trouble: how many warnings.
        rms: distance of its points to its model.
        id: name.
        warnings: kind -> sentence.
        notes: sentences.
        values: quantity -> number of the subject.
        volumes: surface -> smallest and largest over the frames.
        frames: how many.
    """

    trouble: int
    rms: float
    id: str
    warnings: dict[str, str] = field(compare=False)
    notes: tuple[str, ...] = field(compare=False)
    values: dict[str, float] = field(compare=False)
    volumes: dict[str, tuple[float, float]] = field(compare=False)
    frames: int = field(compare=False)


@dataclass
class Overview:
    """All subjects together.

    Attributes:
        worst: the most troubled ones, the worst first.
        kinds: of warnings, how many subjects have each.
        warned: subjects with any.
        rms: of all.
        units: of the quantities.
    """

    worst: list[SubjectSummary]
    kinds: Counter[str]
    warned: int
    rms: array
    units: dict[str, str]


def overview(results: Path, most: int) -> Overview:
    """Read the whole table once.

    Args:
        results: folder.
        most: how many subjects to keep.
    """
    found = Overview([], Counter(), 0, array("d"), {})

    def told() -> Iterator[SubjectSummary]:
        for verdict in _verdicts(results, found.units):
            found.kinds.update(verdict.warnings.keys())
            found.warned += bool(verdict.warnings)
            found.rms.append(verdict.rms)
            yield verdict

    found.worst = heapq.nlargest(most, told())
    return found


def _verdicts(results: Path, units: dict[str, str]) -> Iterator[SubjectSummary]:
    for part in parts(results):
        for name, rows in groupby(read_measures(part), key=lambda row: row["subject"]):
            warnings, notes, values = {}, [], {}
            volumes: dict[str, tuple[float, float]] = {}
            frames = 0
            for row in rows:
                quantity, value = row["quantity"], row["value"]
                units.setdefault(quantity, row["unit"])
                if quantity.startswith(WARNING):
                    warnings[quantity.removeprefix(WARNING)] = row.get("text") or ""
                elif quantity == NOTE:
                    notes.append(row.get("text") or "")
                elif quantity.startswith(VOLUME) and row["frame"] is not None:
                    surface = quantity.removeprefix(VOLUME)
                    low, high = volumes.get(surface, (value, value))
                    volumes[surface] = min(low, value), max(high, value)
                    frames = max(frames, row["frame"] + 1)
                elif row["frame"] is None:
                    values[quantity] = value
            yield SubjectSummary(len(warnings), values["rms"], name, warnings, tuple(notes), values, volumes, frames)
