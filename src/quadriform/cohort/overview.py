"""Summaries of each subject and of the cohort from the table of measures, which is read part by part."""

import heapq
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from quadriform.cohort.measures import NOTE, WARNING
from quadriform.cohort.stores import parts, read_measures

SHOWN = ("rms", "min det J", "ejection fraction", "myocardial mass")
"""Quantities of a whole subject that the page shows, where they were measured."""
VOLUME = "volume "


@dataclass(frozen=True, order=True)
class SubjectSummary:
    """One subject; sorted by the number of warnings, then by distance.

    Attributes:
        n_warnings: number of warnings.
        rms: distance of its points to its model.
        id: of the subject.
        warnings: kind -> sentence.
        notes: sentences.
        values: quantity -> value of the subject.
        volumes: surface -> smallest and largest over the frames.
        frames: number of frames.
    """

    n_warnings: int
    rms: float
    id: str
    warnings: dict[str, str] = field(compare=False)
    notes: tuple[str, ...] = field(compare=False)
    values: dict[str, float] = field(compare=False)
    volumes: dict[str, tuple[float, float]] = field(compare=False)
    frames: int = field(compare=False)


@dataclass
class Overview:
    """All subjects of a cohort.

    Attributes:
        worst: the first subjects in descending order.
        kinds: kind of a warning -> number of subjects.
        warned: number of subjects with warnings.
        rms: of all subjects.
        units: of the quantities.
    """

    worst: list[SubjectSummary]
    kinds: Counter[str]
    warned: int
    rms: array
    units: dict[str, str]


def overview(results: Path, most: int) -> Overview:
    """Return the summary of the whole table.

    Args:
        results: folder.
        most: number of subjects to keep.
    """
    found = Overview([], Counter(), 0, array("d"), {})

    def counted() -> Iterator[SubjectSummary]:
        for subject in _subjects(results, found.units):
            found.kinds.update(subject.warnings.keys())
            found.warned += bool(subject.warnings)
            found.rms.append(subject.rms)
            yield subject

    found.worst = heapq.nlargest(most, counted())  # keeps `most` subjects in memory
    return found


def _subjects(results: Path, units: dict[str, str]) -> Iterator[SubjectSummary]:
    for part in parts(results):
        for name, rows in groupby(read_measures(part), key=lambda row: row["subject"]):
            subject = SubjectSummary(0, np.nan, name, {}, (), {}, {}, 0)
            for row in rows:
                units.setdefault(row["quantity"], row["unit"])
                subject = _with_row(subject, row)
            yield replace(subject, n_warnings=len(subject.warnings), rms=subject.values["rms"])


def _with_row(subject: SubjectSummary, row: dict[str, Any]) -> SubjectSummary:
    """The summary with one row of the table more; its dictionaries are updated in place."""
    quantity, value, frame = row["quantity"], row["value"], row["frame"]
    if quantity.startswith(WARNING):
        subject.warnings[quantity.removeprefix(WARNING)] = row.get("text") or ""
    elif quantity == NOTE:
        return replace(subject, notes=(*subject.notes, row.get("text") or ""))
    elif quantity.startswith(VOLUME) and frame is not None:
        surface = quantity.removeprefix(VOLUME)
        low, high = subject.volumes.get(surface, (value, value))
        subject.volumes[surface] = min(low, value), max(high, value)
        return replace(subject, frames=max(subject.frames, frame + 1))
    elif frame is None:
        subject.values[quantity] = value
    return subject
