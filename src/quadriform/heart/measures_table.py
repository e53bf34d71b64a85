"""The table of measures, and its files in CSV and JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

from quadriform.errors import OptionError, Warnings, join_warnings, status_of
from quadriform.files.atomic import write_bytes
from quadriform.files.reading import suffix_of
from quadriform.points import Array
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.record import Estimate, ModelRecord, Remark, remarks, remarks_of, with_deviation, worst
from quadriform.words import csv_bytes, summary

TABLE_SUFFIXES = (".csv", ".json")
SCHEMA = "quadriform-measures-3"
"""Since 2 with status and notes, and with the warnings of the models' fits among the warnings; since 3 with standard
deviations."""


@dataclass(frozen=True)
class Row:
    """One measure.

    Attributes:
        quantity: what it is.
        value: the number, in `unit`.
        unit: "ml", "g", "%", "mm", "deg", "deg/mm" or "1".
        how: definition, frames and base; starts with "not observed" where the data does not determine it.
        observed: False where the number is determined by the regularisation only.
        sd: one standard deviation in `unit`, by the posterior of the models; None where that is not known.
    """

    quantity: str
    value: float
    unit: str
    how: str
    observed: bool = True
    sd: float | None = None

    @property
    def estimate(self) -> Estimate:
        """The value with its standard deviation, and with intervals by it."""
        return Estimate(self.value, self.unit, sd=self.sd)

    @property
    def number(self) -> str:
        """The value as text, with its standard deviation where it is known: "132 ± 2"."""
        return with_deviation(self.value, self.sd)


@dataclass(frozen=True, repr=False)
class Measures:
    """The measures of a beating heart.

    Attributes:
        rows: the table.
        own_warnings: of measuring, kind -> sentence.
        times: (F,) of the frames.
        curves: quantity -> (F,) over the cycle, units as in the rows; volume, thickness, strains and twist.
        ed: frame of end diastole.
        es: frame of end systole, None when there is one frame.
        fit: the record of the models' fits, those of all frames together.
        planes: the base of each frame, below which volumes count; None for a closed surface.
        curves_sd: quantity -> (F,) standard deviations of its curve, of the volume alone, where they are known.
    """

    rows: tuple[Row, ...]
    own_warnings: Warnings
    times: Array
    curves: dict[str, Array]
    ed: int
    es: int | None
    fit: ModelRecord = field(default_factory=ModelRecord)
    planes: tuple[BasePlane | None, ...] = ()
    curves_sd: dict[str, Array] = field(default_factory=dict)

    def __repr__(self) -> str:
        frames = f"{len(self.times)} frames, end diastole {self.ed}, end systole {self.es}"
        rows = [f"{row.quantity}: {row.number} {row.unit}" for row in self.rows]
        return summary(f"Measures: {self.status}", frames, *rows)

    @property
    def warnings(self) -> Warnings:
        """Warnings of the models' fits and of measuring: kind -> sentence."""
        return join_warnings(self.fit.warnings, self.own_warnings)

    @property
    def status(self) -> str:
        """Reliability of the numbers: "ok", "warned", "unreliable", or "unknown"."""
        return worst(self.fit.status, status_of(self.own_warnings))

    @property
    def remarks(self) -> list[Remark]:
        """Warnings and notes of the models' fits, then the warnings of measuring."""
        return [*remarks_of(self.fit), *remarks(self.own_warnings)]

    def __getitem__(self, quantity: str) -> float:
        """Return the value of a quantity.

        Raises:
            OptionError: it was not measured.
        """
        return self.estimate(quantity).value

    def estimate(self, quantity: str) -> Estimate:
        """Return a quantity with its standard deviation, where that is known.

        Raises:
            OptionError: it was not measured.
        """
        for row in self.rows:
            if row.quantity == quantity:
                return row.estimate
        raise OptionError(f"quantity {quantity!r} was not measured; there are {', '.join(self)}")

    def __iter__(self) -> Iterator[str]:
        """Return the quantities, in order."""
        return (row.quantity for row in self.rows)

    def record(self) -> dict[str, Any]:
        """Return everything as lists, numbers and texts, for JSON."""
        return {
            "schema": SCHEMA,
            "measures": [asdict(row) for row in self.rows],
            "ed_frame": self.ed,
            "es_frame": self.es,
            "times": self.times.tolist(),
            "curves": {name: values.tolist() for name, values in self.curves.items()},
            "curves_sd": {name: values.tolist() for name, values in self.curves_sd.items()},
            "status": self.status,
            "warnings": {str(kind): text for kind, text in self.warnings.items()},
            "notes": [remark.text for remark in self.remarks if not remark.kind],
        }


def write_measures(measures: Measures, path: str | os.PathLike[str], force: bool = False) -> None:
    """Write the table as .csv, or everything as .json, all or nothing.

    Each row of a .csv has the number of all rows, by which a truncated table is recognised, and the status and all
    warnings, so that no number is read without them.

    Args:
        measures: what to write.
        path: of the file; its suffix determines the format.
        force: replace an existing file.

    Raises:
        FileFormatError: another suffix.
        OutputError: the file cannot be written; an earlier one is unchanged.
    """
    if suffix_of(path, TABLE_SUFFIXES, "a table of measures") == ".csv":
        data = _csv(measures)
    else:
        data = (json.dumps(measures.record(), indent=2, allow_nan=False) + "\n").encode()
    write_bytes(path, data, force)


def _csv(measures: Measures) -> bytes:
    header = ("quantity", "value", "sd", "unit", "how", "observed", "rows", "status", "warnings")
    warnings = "; ".join(str(remark) for remark in measures.remarks if remark.kind)
    rows, whole = measures.rows, (len(measures.rows), measures.status, warnings)
    lines = [
        (r.quantity, repr(r.value), _or_nothing(r.sd), r.unit, r.how, "yes" if r.observed else "no", *whole)
        for r in rows
    ]
    return csv_bytes(header, lines)


def _or_nothing(value: float | None) -> str:
    return "" if value is None else repr(value)
