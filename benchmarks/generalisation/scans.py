"""Scans of one side of a superquadric on a table (bench/scans): its semi-axes and their standard deviations."""

from collections.abc import Sequence
from functools import partial
from itertools import islice
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
    errors,
    mean,
    percent_ok,
    status_text,
)

SCENES = 200
ACCEPTED = 5.0
"""Per cent of a semi-axis."""
DUAL_EXPONENT, ALIKE = 1.5, 0.1
"""A section with a larger exponent and semi-axes that differ by a smaller fraction is a square turned by 45 degrees."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark of the scenes whose data determines the semi-axes."""
    bench = bench_module(shared, "scans", "make_scans")
    cases = [(k,) for k in islice(_scored(bench), limit)]
    required = "90 % of scenes within 5 %, 93-97 % within 2 sigma, outliers kept by fit"
    row = partial(_row, bench)
    return [Benchmark("scans", "largest error of a semi-axis %", cases, row, _figure, required, has_ladder=False)]


def _scored(bench: ModuleType):
    return (k for k in range(SCENES) if bench.scored([k]))


def _row(bench: ModuleType, case: Case, strength: Strength) -> Row:
    scan = bench.scan(*case)
    found = qf.fit_superquadric(scan.points)
    axes, deviations = standard_form(found.superquadric, np.sqrt(np.diag(found.covariance)[:3]))
    worst = 100 * float(bench.axis_errors(axes, scan.truth).max())
    order = np.argsort(axes)
    within = np.abs(axes[order] - np.sort(scan.truth["semi_axes"])) <= 2 * deviations[order]
    found_outliers = (found.inliers < 0.5) & ~scan.is_object
    kept = (qf.fit(scan.points).inliers < 0.5)[found_outliers]
    numbers = {
        "within 2 sigma %": 100 * float(within.mean()),
        "clutter rejected %": 100 * float((found.inliers < 0.5)[~scan.is_object].mean()),
        "kept by fit %": 100 * mean(kept),
    }
    return Row(worst, status_text(found.status, found.warnings), float("nan"), worst <= ACCEPTED, numbers)


def standard_form(shape: qf.Superquadric, deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Semi-axes (3,) and their standard deviations, of a square section in the dual orientation those of its sides."""
    axes = shape.semi_axes.copy()
    if shape.exponents[1] > DUAL_EXPONENT and abs(axes[0] / axes[1] - 1) < ALIKE:
        # the corners of the square lie on the axes: half its side is the distance over the root of two
        shrink = np.array([np.sqrt(0.5), np.sqrt(0.5), 1.0])
        return axes * shrink, deviations * shrink
    return axes, deviations


def _figure(rows: Sequence[Row]) -> str:
    good = 100 * mean(np.array([float(row.correct) for row in rows]))
    within, kept = (mean(column(rows, name)) for name in ("within 2 sigma %", "kept by fit %"))
    return (
        f"{good:.0f} % of {len(errors(rows))} scenes within {ACCEPTED:.0f} %, "
        f"{within:.0f} % of the semi-axes within 2 sigma, {kept:.0f} % of the outliers kept by fit, "
        f"{percent_ok(rows):.0f} % ok"
    )
