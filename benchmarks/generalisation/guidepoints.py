"""Contours of two beating ventricles (data/human_lv_guidepoints and _2): `track` and `measure` on the files."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import quadriform as qf
from generalisation import commands
from generalisation.rows import (
    Benchmark,
    Case,
    Row,
    Strength,
    column,
    count_folds,
    errors,
    largest,
    percent_ok,
    present,
)
from quadriform.heart.base import plane_through

FIRST = {"ejection fraction": 59.7}
SECOND = {"end-diastolic volume": 200.0, "end-systolic volume": 70.0}
"""References: the published reading of the first person, volumes from the contours of the second."""
ACCEPTED = {"ejection fraction": 3.0, "end-diastolic volume": 8.0, "end-systolic volume": 2.8}
"""Largest difference from the reference: points of EF, 4 % of the volumes in ml."""
COLUMNS = {"ejection fraction": "EF %", "end-diastolic volume": "ED ml", "end-systolic volume": "ES ml"}
COMMANDS = {"defaults": (), "shift-slices": ("--shift-slices",)}
"""The command of docs/command_line.md shifts slices."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark for each person, with and without shifts of the slices."""
    cases = [(name,) for name in COMMANDS][:limit]
    one = partial(_row, present(shared / "data" / "human_lv_guidepoints" / "frames"), FIRST)
    two = partial(_row, present(shared / "data" / "human_lv_guidepoints_2"), SECOND)
    first, second = "1.03 mm, EF 59.7 within 3", "1.05 mm, volumes 200 / 70 ml within 4 %, no fold"
    return [
        Benchmark("guidepoints", "RMS to the points mm", cases, one, _figure, first, has_ladder=False),
        Benchmark("guidepoints 2", "RMS to the points mm", cases, two, _figure, second, has_ladder=False),
    ]


def _row(folder: Path, reference: dict[str, float], case: Case, strength: Strength) -> Row:
    files = sorted(folder.glob("GPFile_*.txt"))
    with TemporaryDirectory() as made:
        out = Path(made) / "cycle"
        record = commands.run("track", *files, *COMMANDS[case[0]], "-o", out)
        moving = qf.load(out / "model.json")
        table = commands.run("measure", out / "model.json", "--contours", folder)
    values = {each["quantity"]: each["value"] for each in table["measures"]}
    models = [moving.at(float(time)) for time in moving.frame_times]
    numbers = {text: values[name] for name, text in COLUMNS.items()}
    numbers["EF closed %"] = values["ejection fraction, closed"]
    numbers["over the base mm"] = over_the_base(models, qf.read_guide_point_frames(files))
    correct = all(abs(values[name] - true) <= ACCEPTED[name] for name, true in reference.items())
    return Row(record["rms"], commands.status_of(record), record["min_jacobian"], correct, numbers)


def over_the_base(models: Sequence[qf.DeformableModel], frames: Sequence) -> float:
    """How far the endocardium of any frame extends over the plane of its own mitral points."""
    heights = []
    for model, frame in zip(models, frames):
        vertices = model.mesh("endo").vertices
        heights.append(plane_through(frame.mitral, frame.surface("endo")[0].mean(axis=0)).heights(vertices).max())
    return float(np.max(heights))


def _figure(rows: Sequence[Row]) -> str:
    texts = [f"{largest(errors(rows)):.2f} mm"]
    for name in COLUMNS.values():
        texts.append(f"{name} " + " / ".join(f"{value:.1f}" for value in column(rows, name)))
    over = largest(column(rows, "over the base mm"))
    return ", ".join([*texts, f"{over:.0f} mm over the base", count_folds(rows), f"{percent_ok(rows):.0f} % ok"])
