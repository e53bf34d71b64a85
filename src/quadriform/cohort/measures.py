"""What is told of each subject beside its parameters: one number a row, with its unit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.errors import QuadriformError, WarningKind, Warnings
from quadriform.heart.measure import measure
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel

WARNING = "warning "
"""Before the kind of a warning, as a quantity with the value 1."""
LENGTHS = ("rms", "noise")


@dataclass(frozen=True)
class Measure:
    """One number of a subject.

    Attributes:
        quantity: what it is.
        frame: of which frame; None of the subject as a whole.
        value: the number.
        unit: of it; "1" for counts and ratios.
    """

    quantity: str
    frame: int | None
    value: float
    unit: str


def measures_of(
    models: Sequence[DeformableModel],
    times: Array,
    frame_rms: Sequence[float] | Array,
    about: Mapping[str, float],
    warnings: Warnings,
) -> tuple[Measure, ...]:
    """All numbers of a subject.

    Args:
        models: one a frame.
        times: (F,) of the frames.
        frame_rms: (F,) RMS distance of the points of each frame.
        about: of the whole subject: points, rms, noise.
        warnings: of the fit. A ventricle that cannot be measured is no warning: the measures are then not there.
    """
    unit = models[0].unit
    whole = dict(about) | {"parameters": models[0].n_parameters, "min det J": min(m.min_jacobian() for m in models)}
    rows = [Measure(name, None, float(value), unit if name in LENGTHS else "1") for name, value in whole.items()]
    for number, (model, rms) in enumerate(zip(models, frame_rms)):
        rows.append(Measure("frame rms", number, float(rms), unit))
        rows += [Measure(f"volume {name}", number, model.volume(name), f"{unit}^3") for name in model.surfaces]
    rows += [Measure(f"{WARNING}{kind}", None, 1.0, "1") for kind in warnings]
    return (*rows, *_of_the_heart(models, times))


def _of_the_heart(models: Sequence[DeformableModel], times: Array) -> list[Measure]:
    """Volumes, ejection fraction, mass and what else is observed of a ventricle; numbers that are no prior's word."""
    if "endo" not in models[0].surfaces:
        return []
    try:
        found = measure(models, times)
    except QuadriformError:
        return []
    rows = [Measure(row.quantity, None, row.value, row.unit) for row in found.rows if row.observed]
    rows += [Measure(f"{WARNING}{kind}", None, 1.0, "1") for kind in found.warnings if kind in _OF_MEASURES]
    return [row for row in rows if np.isfinite(row.value)]


_OF_MEASURES = (WarningKind.BASE_MISSES, WarningKind.APEX_AMBIGUOUS)
"""Of the measures' warnings those that are about a subject, and not the same for all of them."""
