"""The record of a model beside its geometry: the reliability of its fit, and its input."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist

from quadriform.errors import OptionError, WarningKind, Warnings, choose, join_warnings
from quadriform.words import plain, short_repr

STATUSES = ("ok", "warned", "unreliable", "unknown")
"""From good to bad; "unknown" where the status of the fit is not recorded: models built by hand and older files."""
OBSERVED, NAMED = 0.95, 0.995
"""A measure is observed where data supports at least the first share of it; above the second there is no remark."""
MOST_DIGITS = 5
"""Of a value that is printed with its standard deviation."""
SHA256 = re.compile(r"([0-9a-f]{64})?")
"""A hash of a file, or nothing."""
NOT_RECORDED = "the status of its fit is not recorded (made by hand, or by an older version)"


@dataclass(frozen=True)
class InputFile:
    """A file, or a folder of slices, that points of a model came from.

    Attributes:
        name: its name without the folders above it.
        sha256: of its bytes, of a folder of those of its files in the order of their names.
        surface: the surface that its points belong to; empty for all.
        frame: which frame of a file with several, from 0, or which frame of a cycle.
        note: how points were taken from it; empty where they were read as they are.
    """

    name: str
    sha256: str = ""
    surface: str = ""
    frame: int | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if not SHA256.fullmatch(self.sha256):
            raise OptionError(f"sha256={self.sha256!r}: expected 64 hexadecimal digits, or nothing")
        for key in ("name", "note"):
            object.__setattr__(self, key, plain(getattr(self, key)))


def with_deviation(value: float, sd: float | None) -> str:
    """A value with its standard deviation, as in "132 ± 2": this to two digits, the value to the same decimal.

    The value has five digits at most; without a standard deviation, or with one that rounds to zero then, it has four.
    """
    if sd is None or not sd > 0:
        return f"{value:.4g}"
    # of the second digit of the standard deviation: 2 for hundredths, negative before the point
    decimal = 1 - math.floor(math.log10(sd))
    if value:
        decimal = min(decimal, MOST_DIGITS - 1 - math.floor(math.log10(abs(value))))
    digits, rounded = max(decimal, 0), round(sd, decimal)
    return f"{round(value, decimal):.{digits}f} ± {rounded:.{digits}f}" if rounded else f"{value:.4g}"


def extrapolated(supported: float | None) -> str:
    """A phrase with the share of a measure that is extrapolated; empty where it is unknown or rounds to 0 %."""
    if supported is None or supported >= NAMED:
        return ""
    return f"{'' if supported >= OBSERVED else 'not observed, '}{100 * (1 - supported):.0f} % extrapolated"


@dataclass(frozen=True)
class Estimate:
    """A measure with its unit and reliability.

    Attributes:
        value: in `unit`.
        unit: "mm^3", "ml", "1" and so on.
        supported: share [0, 1] of the measure that data supports, where it is known.
        sd: one standard deviation, where it is known: by the posterior of all parameters of the fit.
    """

    value: float
    unit: str
    supported: float | None = None
    sd: float | None = None

    def __str__(self) -> str:
        number = f"{with_deviation(self.value, self.sd)} {self.unit}".rstrip()
        return ", ".join(filter(None, [number, extrapolated(self.supported)]))

    @property
    def observed(self) -> bool:
        """Whether data supports at least 95 % of the measure, or its support is not known."""
        return self.supported is None or self.supported >= OBSERVED

    def interval(self, level: float = 0.95) -> tuple[float, float] | None:
        """The two ends of the interval that contains the true value with a probability, by a normal distribution.

        None where the standard deviation is not known.

        Args:
            level: the probability, above 0 and below 1.

        Raises:
            OptionError: another probability.
        """
        if not 0 < level < 1:
            raise OptionError(f"level={level!r}: expected a probability above 0 and below 1, such as 0.95")
        if self.sd is None:
            return None
        half = NormalDist().inv_cdf((1 + level) / 2) * self.sd
        return self.value - half, self.value + half


@dataclass(frozen=True, repr=False)
class ModelRecord:
    """The status of a model's fit, and its input; it is never changed, and is stored with the model.

    Attributes:
        status: "ok"; "warned", usable where data supports it; "unreliable", not to be used; or "unknown".
        warnings: kind -> sentence; none exactly where the status is "ok" or "unknown".
        notes: remarks that leave the status "ok", one sentence each.
        title: what was modelled, plain text, such as the names of the input files.
        sources: the input files.
        coverage: surface -> share [0, 1] of the directions from its centre that have data.
        supported: surface -> share [0, 1] of its area that data supports.
        extends_beyond: surface -> its largest reach beyond the data, a length.
        estimates: name -> estimate, such as that of the volume.

    Raises:
        OptionError: an unknown status or kind of warning, a status that the warnings contradict, or a share or length
            that cannot be.
    """

    __repr__ = short_repr

    status: str = "unknown"
    warnings: Warnings = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    title: str = ""
    sources: tuple[InputFile, ...] = ()
    coverage: Mapping[str, float] = field(default_factory=dict)
    supported: Mapping[str, float] = field(default_factory=dict)
    extends_beyond: Mapping[str, float] = field(default_factory=dict)
    estimates: Mapping[str, Estimate] = field(default_factory=dict)

    def __post_init__(self) -> None:
        choose(self.status, STATUSES, "status")
        if bool(self.warnings) != (self.status in ("warned", "unreliable")):
            found = ", ".join(self.warnings) or "no warnings"
            raise OptionError(f"status={self.status!r}: expected warnings exactly where it is not good, found {found}")
        for name, most in (("coverage", 1.0), ("supported", 1.0), ("extends_beyond", math.inf)):
            values = {surface: float(value) for surface, value in getattr(self, name).items()}
            if not all(0 <= value <= most and math.isfinite(value) for value in values.values()):
                raise OptionError(f"{name}={values}: expected finite numbers from 0 to {most:g}")
            object.__setattr__(self, name, values)
        kinds = {choose(kind, tuple(WarningKind), "warnings"): plain(text) for kind, text in self.warnings.items()}
        object.__setattr__(self, "warnings", {WarningKind(kind): text for kind, text in kinds.items()})
        object.__setattr__(self, "notes", tuple(map(plain, self.notes)))
        object.__setattr__(self, "title", plain(self.title))

    @property
    def metadata(self) -> dict[str, str]:
        """Status and kinds of warnings by the names under which files of other formats carry them."""
        kinds = {"WARNINGS": ",".join(self.warnings)} if self.warnings else {}
        return {"STATUS": self.status} | kinds


@dataclass(frozen=True)
class Remark:
    """A warning or a note as a terminal, a table or a page shows it.

    Attributes:
        text: the sentence.
        kind: of the warning; empty for a note.
        about: its subject, such as "from the fit"; may be empty.
    """

    text: str
    kind: str = ""
    about: str = ""

    def __str__(self) -> str:
        return ": ".join(filter(None, [self.about, self.kind, self.text]))


def remarks(warnings: Warnings, notes: Sequence[str] = (), about: str = "") -> list[Remark]:
    """Warnings, then notes, each ready to be shown."""
    every = [Remark(text, str(kind), about) for kind, text in warnings.items()]
    return every + [Remark(text, about=about) for text in notes]


def remarks_of(record: ModelRecord) -> list[Remark]:
    """All remarks of a record on the fit of its model, to be repeated with all results of the model."""
    unknown = [Remark(NOT_RECORDED)] if record.status == "unknown" else []
    return remarks(record.warnings, record.notes, "from the fit") + unknown


def together(records: Mapping[str, ModelRecord]) -> ModelRecord:
    """One record of several models: the worst status, and all warnings and notes, each under the name of its model.

    Models that share one record, such as the states of a moving model, have that record.
    """
    every = list(records.values())
    if all(one == every[0] for one in every):
        return every[0]
    return ModelRecord(
        status=worst(*(one.status for one in every)),
        warnings=join_warnings(*({k: f"{n}: {t}" for k, t in one.warnings.items()} for n, one in records.items())),
        notes=tuple(f"{name}: {note}" for name, one in records.items() for note in one.notes),
        sources=tuple(dict.fromkeys(source for one in every for source in one.sources)),
    )


def worst(*statuses: str) -> str:
    """The worst of statuses; one that is not known counts as worse than "ok" alone."""
    return max(statuses, key=("ok", "unknown", "warned", "unreliable").index)


class Recorded:
    """Status, warnings and notes of models with a record."""

    record: ModelRecord

    @property
    def status(self) -> str:
        """The reliability of the fit: "ok", "warned", "unreliable", or "unknown"."""
        return self.record.status

    @property
    def warnings(self) -> Warnings:
        """The warnings of the fit: kind -> sentence."""
        return self.record.warnings

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks that leave the status "ok"."""
        return self.record.notes
