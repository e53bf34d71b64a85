"""Summaries of each subject and of the cohort from the table of measures, which is read part by part."""

import heapq
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from quadriform.cohort.measures import NOTE, PRIOR_DISTANCE, WARNING
from quadriform.cohort.stores import parts, read_measures
from quadriform.errors import WarningKind, status_of

SHOWN = (
    "rms",
    "min det J",
    PRIOR_DISTANCE,
    "end-diastolic volume",
    "end-systolic volume",
    "ejection fraction",
    "myocardial mass",
)
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

    @property
    def status(self) -> str:
        """The reliability of the fit, by its warnings: "ok", "warned" or "unreliable"."""
        status = status_of([WarningKind(kind) for kind in self.warnings if kind in WarningKind.__members__])
        # a kind of a later version is a warning of unknown level
        return "warned" if status == "ok" and self.warnings else status


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
        """The subjects, each counted as it passes."""
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
            yield _summary(name, list(rows), units)


def _summary(name: str, rows: list[dict[str, Any]], units: dict[str, str]) -> SubjectSummary:
    """One subject from its rows of the table."""
    texts, values, volumes = [], {}, defaultdict(list)
    for row in rows:
        quantity, frame = row["quantity"], row["frame"]
        units.setdefault(quantity, row["unit"])
        if quantity == NOTE or quantity.startswith(WARNING):
            texts.append((quantity, row.get("text") or ""))
        elif frame is None:
            values[quantity] = row["value"]
        elif quantity.startswith(VOLUME):
            volumes[quantity.removeprefix(VOLUME)].append(row["value"])
    warnings = {quantity.removeprefix(WARNING): text for quantity, text in texts if quantity != NOTE}
    notes = tuple(text for quantity, text in texts if quantity == NOTE)
    ranges = {surface: (min(each), max(each)) for surface, each in volumes.items()}
    frames = max(map(len, volumes.values()), default=0)
    return SubjectSummary(len(warnings), values["rms"], name, warnings, notes, values, ranges, frames)
