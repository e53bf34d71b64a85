"""Contours of hearts with known walls (bench/hearts): `track` of end diastole and end systole."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np

import quadriform as qf
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

SUBJECTS = range(500, 980, 12)
"""Forty of those that no prior is learnt from."""
PHASES = ("ed", "es")
ACCEPTED = {"dense": 0.8, "aligned": 1.0}
"""Largest error in mm that an "ok" may have."""
ACCEPTED_UNSUPPORTED = 5.0
"""And the largest part of the area without data: the contours leave the base open, and no base is given."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark for each kind of contours."""
    bench = bench_module(shared, "hearts", "make_cases")
    present(bench.ATLAS)
    subjects = SUBJECTS[:limit]
    of_kind = {kind: [(kind, subject) for subject in subjects] for kind in ACCEPTED}
    dense, aligned = (partial(_row, bench, name) for name in ("ES mean mm", "ES RMS mm"))
    return [
        Benchmark("hearts dense", "ES mean mm", of_kind["dense"], dense, _figure, "ED / ES .6 / .8 mm, no fold"),
        Benchmark("hearts aligned", "worst ES RMS mm", of_kind["aligned"], aligned, _figure, "worst ES RMS 1.0 mm"),
    ]


def _row(bench: ModuleType, error: str, case: Case, strength: Strength) -> Row:
    kind, subject = case
    cases = [bench.case(subject, phase, kind) for phase in PHASES]
    found = qf.track([each.points for each in cases], slices=[each.slices for each in cases], strength=strength)
    numbers = wall_errors(bench, found.models, subject)
    over = [bench.beyond(model, subject, phase) for phase, model in zip(PHASES, found.models)]
    fold = min(model.min_jacobian() for model in found.models)
    numbers["over the base mm"] = max(over)
    numbers["unsupported %"] = 100 * (1 - found.supported.min())
    correct = bool(numbers[error] <= ACCEPTED[kind] and numbers["unsupported %"] <= ACCEPTED_UNSUPPORTED)
    return Row(float(numbers[error]), status_text(found.status, found.warnings), fold, correct, numbers)


def wall_errors(bench: ModuleType, models: Sequence[qf.DeformableModel], subject: int) -> dict[str, float]:
    """Mean distance of the true walls, and RMS of the worse one, in mm, at end diastole and end systole."""
    numbers = {}
    for phase, model in zip(PHASES, models):
        walls = np.array(list(bench.errors(model, subject, phase).values()))  # mean, RMS, 95 % of endo and epi
        numbers |= {f"{phase.upper()} mean mm": walls[:, 0].mean(), f"{phase.upper()} RMS mm": walls[:, 1].max()}
    return numbers


def _figure(rows: Sequence[Row]) -> str:
    ed, es = (mean(column(rows, f"{phase} mean mm")) for phase in ("ED", "ES"))
    worst, over = (largest(column(rows, name)) for name in ("ES RMS mm", "over the base mm"))
    return (
        f"ED / ES {ed:.2f} / {es:.2f} mm, worst ES RMS {worst:.1f} mm, {over:.0f} mm over the base, "
        f"{count_folds(rows)}, {percent_ok(rows):.0f} % ok"
    )
