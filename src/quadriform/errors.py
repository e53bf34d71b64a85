"""One error tree and one enum of named warnings.

Every error message is one sentence chain: what is wrong, where, what was expected, what was found, what to try.
"""

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from enum import StrEnum
from functools import wraps
from inspect import signature
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class QuadriformError(Exception):
    """Root of every error this package raises on purpose; `exit_code` is what the terminal returns."""

    exit_code = 70


class InputError(QuadriformError, ValueError):
    """The input cannot be used."""

    exit_code = 4


class PointsError(InputError):
    """Points, weights or normals are unusable (shape, type, not finite)."""


class MaskError(InputError):
    """A mask, label image or grey image gives no usable object."""


class AffineError(InputError):
    """The transform from voxels to the world is missing, singular or not finite."""


class OptionError(InputError):
    """An option has an unknown name or a value out of its range."""

    exit_code = 2


class DegenerateError(QuadriformError, ValueError):
    """Too few distinct points, or points without three-dimensional extent."""

    exit_code = 4


class FitError(QuadriformError, RuntimeError):
    """The fit is not good enough; raised only on request (`strict`)."""

    exit_code = 3


class FileFormatError(QuadriformError, ValueError):
    """A file is not what its name says, is damaged, or has a field that cannot be."""

    exit_code = 4


class ColumnsError(PointsError, FileFormatError):
    """It is not known which columns of a table are x, y and z; naming them by `columns` helps."""


class FileLimitError(QuadriformError, MemoryError):
    """A file or its declared content is beyond the budget."""

    exit_code = 6


class OutputError(QuadriformError, OSError):
    """An output cannot be written; an earlier file is unchanged."""

    exit_code = 5


class WarningKind(StrEnum):
    """The named warnings. A result carries them as a mapping from the kind to a sentence."""

    PARTIAL_COVERAGE = "PARTIAL_COVERAGE"
    UNSUPPORTED = "UNSUPPORTED"
    RUNAWAY = "RUNAWAY"
    UNCERTAIN = "UNCERTAIN"
    OUTSIDE_POPULATION = "OUTSIDE_POPULATION"
    BASE_NOT_OBSERVED = "BASE_NOT_OBSERVED"
    SEVERAL_BODIES = "SEVERAL_BODIES"
    DOUBLE_WALL = "DOUBLE_WALL"
    FILLED_VOLUME = "FILLED_VOLUME"
    LOW_OVERLAP = "LOW_OVERLAP"
    ILL_CONDITIONED = "ILL_CONDITIONED"
    NEAR_SYMMETRIC = "NEAR_SYMMETRIC"
    OUTLIERS = "OUTLIERS"
    MANY_OUTLIERS = "MANY_OUTLIERS"
    DUPLICATES = "DUPLICATES"
    PRECISION_LOSS = "PRECISION_LOSS"
    AT_BOUND = "AT_BOUND"
    FOLDING = "FOLDING"
    OUTSIDE_LATTICE = "OUTSIDE_LATTICE"
    BORDER_CUT = "BORDER_CUT"
    OPEN_BASE = "OPEN_BASE"
    OPEN_WALL = "OPEN_WALL"
    ANISOTROPIC = "ANISOTROPIC"
    AFFINE_REPAIRED = "AFFINE_REPAIRED"
    MULTIPLE_MINIMA = "MULTIPLE_MINIMA"
    MAX_ITERATIONS = "MAX_ITERATIONS"
    POOR_FIT = "POOR_FIT"
    ONE_FRAME = "ONE_FRAME"
    SEPARATE_FRAMES = "SEPARATE_FRAMES"
    MISSING_SURFACE = "MISSING_SURFACE"
    UNKNOWN_UNIT = "UNKNOWN_UNIT"
    UNREADABLE_FILES = "UNREADABLE_FILES"
    HOLLOW = "HOLLOW"
    BASE_MISSES = "BASE_MISSES"
    APEX_AMBIGUOUS = "APEX_AMBIGUOUS"
    UNANCHORED = "UNANCHORED"

    def __repr__(self) -> str:
        """The word alone: a mapping of warnings prints as words."""
        return str.__repr__(self)


Warnings = dict[WarningKind, str]
"""From the kind of a warning to its sentence; `"FOLDING" in fit.warnings` works, for a kind is a string."""
NOTE, WARNED, UNRELIABLE = LEVELS = ("note", "warned", "unreliable")
"""How much a kind of warning matters: it leaves the status "ok"; the result can be used with its restriction; it must
not be used. What depends on a measured quantity has two kinds, such as OUTLIERS and MANY_OUTLIERS."""
LEVEL: dict[WarningKind, str] = dict.fromkeys(WarningKind, WARNED) | {
    # data as it often is, which the method allows for
    WarningKind.OUTLIERS: NOTE,
    WarningKind.DUPLICATES: NOTE,
    WarningKind.BASE_NOT_OBSERVED: NOTE,
    WarningKind.ANISOTROPIC: NOTE,
    # the surface is not that of the points, or the map folds
    WarningKind.FOLDING: UNRELIABLE,
    WarningKind.UNSUPPORTED: UNRELIABLE,
    WarningKind.RUNAWAY: UNRELIABLE,
    WarningKind.SEVERAL_BODIES: UNRELIABLE,
    WarningKind.DOUBLE_WALL: UNRELIABLE,
    WarningKind.FILLED_VOLUME: UNRELIABLE,
    WarningKind.LOW_OVERLAP: UNRELIABLE,
}
"""The level of each kind; the only place where it is decided."""


def status_of(warnings: Iterable[WarningKind]) -> str:
    """The status that warnings lead to: "ok", "warned" or "unreliable"."""
    worst = max((LEVELS.index(LEVEL[kind]) for kind in warnings), default=0)
    return "ok" if worst == 0 else LEVELS[worst]


def check_strict(strict: str | None, status: str, warnings: Warnings) -> None:
    """Refuse a result by its status.

    Args:
        strict: the mildest status that is refused, "warned" or "unreliable"; None refuses nothing.
        status: of the result.
        warnings: which the message has.

    Raises:
        FitError: the status is refused.
    """
    if strict is not None and status in LEVELS[LEVELS.index(choose(strict, LEVELS[1:], "strict")) :]:
        raise FitError("refused for its warnings: " + "; ".join(f"{kind}: {text}" for kind, text in warnings.items()))


def without_notes(warnings: Warnings) -> tuple[Warnings, tuple[str, ...]]:
    """The warnings that leave no status "ok", and the others as notes, each with its kind."""
    notes = tuple(f"{kind}: {text}" for kind, text in warnings.items() if LEVEL[kind] == NOTE)
    return {kind: text for kind, text in warnings.items() if LEVEL[kind] != NOTE}, notes


def join_warnings(*parts: Warnings) -> Warnings:
    """All warnings as one mapping, in order; different sentences of one kind are joined by "; "."""
    joined: Warnings = {}
    for part in parts:
        for kind, text in part.items():
            before = joined.get(kind)
            if before is None:
                joined[kind] = text
            elif f"; {text}; " not in f"; {before}; ":
                joined[kind] = f"{before}; {text}"
    return joined


def choose(value: object, choices: tuple[str, ...], option: str) -> str:
    """Return `value` when it is one of `choices`.

    Raises:
        OptionError: naming the option, the value and what is allowed.
    """
    if not isinstance(value, str) or value not in choices:
        raise OptionError(f"option {option}={value!r} is unknown; expected one of {', '.join(map(repr, choices))}")
    return value


def known_options(function: Callable[P, R]) -> Callable[P, R]:
    """The function, but an unknown option raises an `OptionError` that names the most similar one."""
    names = tuple(signature(function).parameters)

    @wraps(function)
    def checked(*args: P.args, **options: P.kwargs) -> R:
        """Call the function with options that it has."""
        for name in options.keys() - set(names):
            near = get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(names)}"
            raise OptionError(f"option {name} is unknown; {hint}")
        return function(*args, **options)

    return checked
