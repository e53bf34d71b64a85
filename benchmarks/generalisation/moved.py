"""Contours of hearts whose slices moved between breath-holds (bench/hearts, kind "moved"): the walls and the slices.

With a prior of shape it is learned from other hearts, of both phases.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

import quadriform as qf
from generalisation.hearts import PHASES, SUBJECTS, wall_errors
from generalisation.learned import learned_prior
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
from quadriform.points import rigid_motion

ACCEPTED = 0.9
"""Largest mean distance at end systole in mm that an "ok" may have."""
LONG_AXES = 3
"""The last slices of a heart are along its axis."""
FEWEST_POINTS = 6
"""Of a slice whose remaining motion is measured."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """Hearts with slices across and along the axis, also with a prior, and with those across alone."""
    bench = bench_module(shared, "hearts", "make_cases")
    present(bench.ATLAS)
    error, row = "ES mean mm", partial(_row, bench, lambda: None)
    with_prior = partial(_row, bench, partial(learned_prior, bench))
    cases = {along: [(subject, along) for subject in SUBJECTS[:limit]] for along in (True, False)}
    required = "ED / ES .7 / .9 mm, slices .5 mm, no fold"
    return [
        Benchmark("hearts moved", error, cases[True], row, _figure, required),
        Benchmark(
            "hearts moved, prior",
            error,
            cases[True],
            with_prior,
            _figure,
            "ED / ES .5 / .6 mm, slices .5 mm, no fold",
            has_ladder=False,
        ),
        Benchmark("hearts moved, no long axis", error, cases[False], row, _figure, "no fold"),
    ]


def _row(bench: ModuleType, prior: Callable[[], qf.ShapePrior | None], case: Case, strength: Strength) -> Row:
    subject, along = case
    cases = [bench.case(subject, phase, "moved") for phase in PHASES]
    if not along:
        cases = [_across(bench, each) for each in cases]
    slices = [each.slices for each in cases]
    found = qf.track([each.points for each in cases], slices=slices, strength=strength, prior=prior())
    numbers = wall_errors(bench, found.models, subject)
    rotation, offset, remaining = remaining_motions(cases, found)
    for phase, model in zip(PHASES, found.models):
        true = bench.heart(subject, phase)
        distances = [np.abs(model.distance((x - offset) @ rotation, wall)).mean() for wall, (x, _) in true.items()]
        numbers[f"{phase.upper()} aligned mm"] = float(np.mean(distances))
    numbers |= remaining
    fold = min(model.min_jacobian() for model in found.models)
    error = float(numbers["ES mean mm"])
    return Row(error, status_text(found.status, found.warnings), fold, error <= ACCEPTED, numbers)


def _across(bench: ModuleType, case: object) -> object:
    """The case without its slices along the axis."""
    kept = {wall: numbers < len(case.planes) - LONG_AXES for wall, numbers in case.slices.items()}
    points, slices = ({wall: of[wall][kept[wall]] for wall in kept} for of in (case.points, case.slices))
    return bench.Case(points, slices, case.planes, case.moves)


def remaining_motions(cases: Sequence, found: qf.Track) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """The best common rigid motion of the corrected slices to where they were cut, and the means of what remains.

    Returns:
        The rotation (3, 3) and offset (3,) that all slices together are off, and the mean over the slices of the
        remaining shift in the plane in mm and of the remaining tilt in degrees.
    """
    cut, corrected, numbers = [], [], []
    for case in cases:
        for wall, points in case.points.items():
            for number, ((point, _), (turn, shift)) in enumerate(zip(case.planes, case.moves)):
                inside = points[case.slices[wall] == number]
                cut.append(Rotation.from_rotvec(-turn).apply(inside - shift - point) + point)
                corrected.append(found.moves[number].apply(inside) if number in found.moves else inside)
                numbers.append(np.full(len(inside), number))
    cut, corrected, numbers = (np.concatenate(each) for each in (cut, corrected, numbers))
    rotation, offset = rigid_motion(corrected, cut)
    corrected = corrected @ rotation.T + offset
    shifts, tilts = [], []
    for number in np.unique(numbers):
        inside, normal = numbers == number, cases[0].planes[number][1]
        if inside.sum() >= FEWEST_POINTS:
            across = np.eye(3) - np.outer(normal, normal)
            shifts.append(np.linalg.norm(across @ (corrected[inside] - cut[inside]).mean(axis=0)))
            turn = Rotation.from_matrix(rigid_motion(corrected[inside], cut[inside])[0]).as_rotvec()
            tilts.append(np.degrees(np.linalg.norm(across @ turn)))
    return rotation, offset, {"slice shift mm": float(np.mean(shifts)), "slice tilt degrees": float(np.mean(tilts))}


def _figure(rows: Sequence[Row]) -> str:
    def pair(name: str) -> str:
        return " / ".join(f"{mean(column(rows, f'{phase} {name}')):.2f}" for phase in ("ED", "ES"))

    worst = largest(column(rows, "ES RMS mm"))
    shift, tilt = (mean(column(rows, name)) for name in ("slice shift mm", "slice tilt degrees"))
    return (
        f"ED / ES {pair('mean mm')} mm, {pair('aligned mm')} after the best rigid motion, worst ES RMS {worst:.1f} mm, "
        f"slices {shift:.2f} mm and {tilt:.1f} degrees off, {count_folds(rows)}, {percent_ok(rows):.0f} % ok"
    )
