"""The measures of a subject for the table: one number a row, with its unit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.errors import QuadriformError, WarningKind, Warnings
from quadriform.heart.measure import measure
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import ModelRecord

WARNING = "warning "
"""Prefix of the kind of a warning; such a quantity has the value 1 and the sentence as its text."""
SD = " sd"
"""Suffix of a quantity for its standard deviation, which is a row of its own."""
NOTE = "note"
"""The quantity of a note, with the value 1."""
PRIOR_DISTANCE = "prior distance"
"""The Mahalanobis distance of a subject to the mean of the prior."""
LENGTHS = ("rms", "noise")
OF_SUBJECTS = (WarningKind.BASE_MISSES, WarningKind.APEX_AMBIGUOUS)
"""Warnings of measuring that depend on the subject; the others are the same for the whole cohort."""


@dataclass(frozen=True)
class Measure:
    """One number of a subject.

    Attributes:
        quantity: name.
        frame: number of the frame; None for the whole subject.
        value: in `unit`.
        unit: "1" for counts and ratios.
        text: the sentence of a warning or a note; empty for numbers.
    """

    quantity: str
    frame: int | None
    value: float
    unit: str
    text: str = ""


def measures_of(
    models: Sequence[DeformableModel],
    times: Array,
    frame_rms: Sequence[float] | Array,
    about: Mapping[str, float],
    record: ModelRecord,
) -> tuple[Measure, ...]:
    """Return all measures of a subject.

    Args:
        models: one a frame.
        times: (F,) of the frames.
        frame_rms: (F,) RMS distance of the points of each frame.
        about: of the whole subject: points, rms, noise, with a prior its distance.
        record: of the fit. A ventricle that cannot be measured is no warning: its measures are left out.
    """
    unit = models[0].unit
    whole = dict(about) | {"parameters": models[0].n_parameters, "min det J": min(m.min_jacobian() for m in models)}
    rows = [Measure(name, None, float(value), unit if name in LENGTHS else "1") for name, value in whole.items()]
    for number, (model, rms) in enumerate(zip(models, frame_rms)):
        rows.append(Measure("frame rms", number, float(rms), unit))
        rows += [Measure(f"volume {name}", number, model.volume(name), f"{unit}^3") for name in model.surfaces]
    rows += _warning_rows(record.warnings) + [Measure(NOTE, None, 1.0, "1", note) for note in record.notes]
    return (*rows, *_of_the_heart(models, times))


def _of_the_heart(models: Sequence[DeformableModel], times: Array) -> list[Measure]:
    """The observed measures of a ventricle, without those that are determined by the regularisation only."""
    if "endo" not in models[0].surfaces:
        return []
    try:
        found = measure(models, times)
    except QuadriformError:
        return []
    # values that are determined by the regularisation only would look like differences between subjects
    observed = [row for row in found.rows if row.observed]
    rows = [Measure(row.quantity, None, row.value, row.unit) for row in observed]
    rows += [Measure(f"{row.quantity}{SD}", None, row.sd, row.unit) for row in observed if row.sd is not None]
    rows += _warning_rows({kind: text for kind, text in found.own_warnings.items() if kind in OF_SUBJECTS})
    return [row for row in rows if np.isfinite(row.value)]


def kinds_of(measures: Sequence[Measure]) -> tuple[str, ...]:
    """Return the kinds of the warnings among the measures of a subject, each once and in order."""
    return tuple({m.quantity.removeprefix(WARNING): None for m in measures if m.quantity.startswith(WARNING)})


def _warning_rows(warnings: Warnings) -> list[Measure]:
    return [Measure(f"{WARNING}{kind}", None, 1.0, "1", text) for kind, text in warnings.items()]
