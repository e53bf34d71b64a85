"""Hearts from a few long-axis planes, with a prior of shape learned from other hearts and without (bench/hearts)."""

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from types import ModuleType

import numpy as np

import quadriform as qf
from generalisation.hearts import PHASES, SUBJECTS, wall_errors
from generalisation.rows import (
    Benchmark,
    Case,
    Row,
    Strength,
    bench_module,
    column,
    count_folds,
    largest,
    mean,
    percent_ok,
    present,
    status_text,
)
from quadriform.errors import OptionError

LEARNED_FROM = range(500)
ACCEPTED = {"three": 0.35, "two": 0.45}
"""Largest mean distance in mm that an "ok" may have."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """Hearts from three planes, and from two."""
    bench = bench_module(shared, "hearts", "make_cases")
    present(bench.ATLAS)
    error, row = "mean mm of the worse phase", partial(_row, bench)
    return [
        Benchmark(f"hearts {kind} planes, prior", error, _cases(kind, limit), row, _figure, required, has_ladder=False)
        for kind, required in (("three", ".35 mm, worst RMS .9"), ("two", ".45 mm, worst RMS 1.0"))
    ]


def _cases(kind: str, limit: int | None) -> list[Case]:
    return [(kind, subject) for subject in SUBJECTS[:limit]]


@cache
def learned_prior(bench: ModuleType) -> qf.ShapePrior:
    """The prior of both phases of the first 500 hearts, which are none of `SUBJECTS`."""
    hearts = [bench.heart(subject, phase) for phase in PHASES for subject in LEARNED_FROM]
    return qf.learn_prior([{wall: qf.Mesh(*mesh) for wall, mesh in heart.items()} for heart in hearts])


def _row(bench: ModuleType, case: Case, strength: Strength) -> Row:
    if strength != "auto":
        raise OptionError("a prior has no strength of its own")
    kind, subject = case
    points = [bench.case(subject, phase, kind).points for phase in PHASES]
    fits = [qf.fit(each, prior=learned_prior(bench)) for each in points]
    numbers = wall_errors(bench, [fit.model for fit in fits], subject)
    without = wall_errors(bench, [qf.fit(each).model for each in points], subject)
    error = max(float(numbers[f"{phase.upper()} mean mm"]) for phase in PHASES)
    for phase in ("ED", "ES"):
        numbers[f"{phase} without mm"] = without[f"{phase} mean mm"]
    fold = min(fit.model.min_jacobian() for fit in fits)
    status = ", ".join(dict.fromkeys(status_text(fit.status, fit.warnings) for fit in fits))
    return Row(error, status, fold, error <= ACCEPTED[kind], numbers)


def _figure(rows: Sequence[Row]) -> str:
    def pair(name: str) -> str:
        return " / ".join(f"{mean(column(rows, f'{phase} {name}')):.2f}" for phase in ("ED", "ES"))

    worst = max(largest(column(rows, f"{phase} RMS mm")) for phase in ("ED", "ES"))
    every = [mean(column(rows, f"{phase} {name}")) for name in ("mean mm", "without mm") for phase in ("ED", "ES")]
    ratio = float(np.mean(every[:2]) / np.mean(every[2:]))
    return (
        f"ED / ES {pair('mean mm')} mm, worst RMS {worst:.1f} mm, without the prior {pair('without mm')} mm, "
        f"ratio {ratio:.2f}, {count_folds(rows)}, {percent_ok(rows):.0f} % ok"
    )
