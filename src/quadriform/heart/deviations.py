"""Standard deviations of measures, from samples of the posterior of the models.

Each sample is a set of models, one a frame, and is measured as the estimate is, at a fraction of its deviations
(`shapes/posterior.py`).

Frames of end diastole and end systole, the base where it is a given plane, and the RV insertions are those of the
estimate; their own errors are not known here. A base that is a fraction of the long axis moves with the sample.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from quadriform.errors import QuadriformError
from quadriform.heart.measures_table import Row
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.posterior import STEP

MOST_FAILED = 0.25
"""Where more than this share of the samples cannot be measured, the standard deviation is not known."""
Models = Sequence[DeformableModel]
RowsOf = Callable[[Models], Sequence[Row]]


def aligned_samples(models: Sequence[DeformableModel]) -> list[Models]:
    """For each sample of the posteriors the models of all frames, at `STEP`; none where a model has no posterior.

    Models of one source, such as the frames of a moving model, have their samples in common. The samples of different
    sources come from the same random numbers: each source after the first is shifted by one more, so that the samples
    that are put together are independent.
    """
    known = [model.posterior for model in models if model.posterior is not None]
    if len(known) < len(models):
        return []
    sources = list(dict.fromkeys(each.source for each in known))
    every = [deque(model.samples(STEP)) for model in models]
    for samples, each in zip(every, known):
        samples.rotate(sources.index(each.source))
    return list(zip(*every))


def with_deviations(rows: Sequence[Row], models: Models, rows_of: RowsOf) -> list[Row]:
    """The rows with standard deviations, where the models have posteriors.

    Args:
        rows: of the estimate.
        models: the frames that the rows are about.
        rows_of: measures a sample of them.
    """
    samples = aligned_samples(models)
    if not samples:
        return list(rows)
    sampled: dict[str, list[float]] = {row.quantity: [] for row in rows}
    for sample in samples:
        try:
            measured = rows_of(sample)
        except QuadriformError:  # a sample that a base misses, for instance
            continue
        for row in measured:
            sampled.setdefault(row.quantity, []).append(row.value)
    return [replace(row, sd=_deviation(sampled.get(row.quantity, []), len(samples))) for row in rows]


def curve_deviations(models: Models, curves_of: Callable[[Models], dict[str, Array]]) -> dict[str, Array]:
    """Quantity -> standard deviations (F,) of its curve over the cycle; none where the models have no posteriors.

    Args:
        models: of all frames.
        curves_of: measures a sample of them.
    """
    found: dict[str, list[Array]] = {}
    samples = aligned_samples(models)
    for sample in samples:
        try:
            curves = curves_of(sample)
        except QuadriformError:
            continue
        for quantity, values in curves.items():
            found.setdefault(quantity, []).append(values)
    enough = [quantity for quantity, each in found.items() if len(each) >= _fewest(len(samples))]
    return {quantity: np.std(found[quantity], axis=0, ddof=1) / STEP for quantity in enough}


def _fewest(count: int) -> float:
    """How many of the samples must have been measured."""
    return max(2, (1 - MOST_FAILED) * count)


def _deviation(sampled: Sequence[float], count: int) -> float | None:
    """Standard deviation by values of samples; None where too many of all have no value, or it is not finite."""
    if len(sampled) < _fewest(count):
        return None
    found = float(np.std(sampled, ddof=1)) / STEP
    return found if np.isfinite(found) else None
