"""Whether the status is true: fits of synthetic bodies seen in part, with five types of noise.

A result is correct where the RMS distance of the model's surface to the truth is at most 2 sigma + .01 r and at most
5 % of its area has no data nearby.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import quadriform as qf
from generalisation.bodies import NOISES, PATTERNS, Observed, observed
from generalisation.rows import (
    Benchmark,
    Case,
    Row,
    Strength,
    column,
    count_folds,
    fraction_within,
    mean,
    status_text,
)

FITS = 300
ACCEPTED_UNSUPPORTED = 5.0
"""Per cent of the area of the model."""
TRUTH_POINTS = 12
"""One of so many vertices of the truth is compared with the uncertainty."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark for each part that is seen; no data is needed."""
    required = '0 "ok" are wrong, < 15 % of the warned are correct, 92-97 % within 2 sigma'
    numbers = range(FITS)[:limit]
    return [
        Benchmark(f"silent {pattern}", "RMS over what is accepted", _cases(numbers, k), _row, _figure, required)
        for k, pattern in enumerate(PATTERNS[: len(numbers)])
    ]


def _cases(numbers: Sequence[int], pattern: int) -> list[Case]:
    """Number and noise of the cases of one pattern."""
    return [(n, NOISES[n // 5 % 5]) for n in numbers if n % 5 == pattern]


def _row(case: Case, strength: Strength) -> Row:
    data = observed(case[0])
    fit = qf.fit(data.points, strength=strength)
    mesh = fit.model.mesh(resolution=48)
    rms = qf.surface_distances(mesh, data.truth)[0].rms
    error = rms / (2 * data.noise + 0.01 * data.radius)
    without_data = unsupported(mesh, data)
    numbers = {
        "RMS": rms,
        "sigma": data.noise,
        "noise found": fit.noise,
        "unsupported %": without_data,
        "within 2 sigma %": fraction_within(fit, data.truth.vertices[::TRUTH_POINTS]),
    }
    correct = error <= 1 and without_data <= ACCEPTED_UNSUPPORTED
    return Row(error, status_text(fit.status, fit.warnings), fit.model.min_jacobian(), correct, numbers)


def unsupported(mesh: qf.Mesh, data: Observed) -> float:
    """Percentage of the area of a mesh that is farther from the nearest point than data of its kind can be."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    return float(100 * areas @ (cKDTree(data.points).query(centres)[0] > data.reach) / areas.sum())


def _figure(rows: Sequence[Row]) -> str:
    ok, warned = ([row for row in rows if (row.status == "ok") == is_ok] for is_ok in (True, False))
    within = mean(column(rows, "within 2 sigma %"))
    return (
        f'{sum(not row.correct for row in ok)} of {len(ok)} "ok" are wrong, {sum(row.correct for row in warned)} of '
        f"{len(warned)} warned are correct, {within:.0f} % within 2 sigma, {count_folds(rows)}"
    )
