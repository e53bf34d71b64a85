"""Ten times more points along the same contours: the surface should stay where it is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

import quadriform as qf
from generalisation.bodies import body
from generalisation.rows import (
    Benchmark,
    Case,
    Row,
    Strength,
    count_folds,
    errors,
    largest,
    mean,
    percent_ok,
    status_text,
)

BODIES = 10
SLICES, POINTS, TIMES = 10, 40, 10
NOISE = 0.5
"""Standard deviation in the plane of a contour, for bodies of 100."""
ACCEPTED = 0.1
SYSTOLE = np.array([0.75, 0.75, 0.9])
"""The second of two frames has these fractions of the extent of the first."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark of single fits and of moving models; no data is needed."""
    cases = [(method, k) for method in METHODS for k in range(BODIES)[:limit]]
    error = "RMS between the surfaces over the noise"
    return [Benchmark("dense", error, cases, _row, _figure, f"within {ACCEPTED}", has_ladder=False)]


def _row(case: Case, strength: Strength) -> Row:
    method, k = case
    loops = contours(k)
    (one, status), (other, dense_status) = (METHODS[method](each) for each in (loops, densified(loops)))
    pairs = [qf.surface_distances(a, b) for a, b in zip(one, other)]
    error = max(way.rms for pair in pairs for way in pair) / NOISE
    numbers = {"largest": max(way.largest for pair in pairs for way in pair)}
    fold = min(model.min_jacobian() for model in (*one, *other))
    status = status if status == dense_status else f"{status}, then {dense_status}"
    return Row(error, status, fold, None, numbers)


def _single(loops: np.ndarray) -> tuple[Sequence[qf.DeformableModel], str]:
    fit = qf.fit(loops.reshape(-1, 3))
    return [fit.model], status_text(fit.status, fit.warnings)


def _moving(loops: np.ndarray) -> tuple[Sequence[qf.DeformableModel], str]:
    points = loops.reshape(-1, 3)
    found = qf.track([points, points * SYSTOLE])
    return found.models, status_text(found.status, found.warnings)


METHODS = {"fit": _single, "track": _moving}


def contours(k: int) -> np.ndarray:
    """Closed contours (slices, points, 3) of a body across its long axis, with noise in their planes."""
    rng = np.random.default_rng([3011, k])
    mesh = body(rng)
    low, extent = mesh.vertices[:, 2].min(), np.ptp(mesh.vertices[:, 2])
    heights = low + extent * (np.arange(SLICES) + 0.5) / SLICES
    angles = np.arange(POINTS) * 2 * np.pi / POINTS
    loops = np.stack([_contour(mesh, height, angles) for height in heights])
    loops[..., :2] += rng.normal(0, NOISE, (*loops.shape[:2], 2))
    return loops


def _contour(mesh: qf.Mesh, height: float, angles: np.ndarray) -> np.ndarray:
    """Where rays at the angles, from the centre of the section, meet the section of a mesh."""
    corners = mesh.vertices[mesh.faces]
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        start, stop = corners[:, a], corners[:, b]
        crosses = (start[:, 2] > height) & (stop[:, 2] <= height)
        t = (height - start[crosses, 2]) / (stop[crosses, 2] - start[crosses, 2])
        ends.append(start[crosses] + t[:, None] * (stop[crosses] - start[crosses]))
    section = np.concatenate(ends)[:, :2]
    centre = (section.min(axis=0) + section.max(axis=0)) / 2
    offset = section - centre
    around = np.arctan2(offset[:, 1], offset[:, 0])
    radius = np.interp(angles, np.sort(around), np.linalg.norm(offset, axis=1)[np.argsort(around)], period=2 * np.pi)
    flat = centre + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.column_stack([flat, np.full(len(flat), height)])


def densified(loops: np.ndarray) -> np.ndarray:
    """The same contours with ten times as many points, on periodic cubic splines through the given ones."""
    closed = np.concatenate([loops, loops[:, :1]], axis=1)
    at = np.arange(POINTS * TIMES) / TIMES
    return CubicSpline(np.arange(POINTS + 1), closed, axis=1, bc_type="periodic")(at)


def _figure(rows: Sequence[Row]) -> str:
    found = errors(rows)
    return f"{mean(found):.2f}, worst {largest(found):.2f}, {count_folds(rows)}, {percent_ok(rows):.0f} % ok both times"
