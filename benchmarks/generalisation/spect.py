"""Perfusion images (data/spect_mpi): a fit by threshold and region, and both surfaces of the wall, without a truth."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import rms

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
    mean,
    percent_ok,
    present,
    status_text,
)

REGION = ((17, 53), (12, 52), (10, 34))
OPTIONS = ("--threshold", "50%p99.9", "--region", ",".join(f"{first}:{last}" for first, last in REGION))


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark of the command for one surface, one of both walls."""
    folder = present(shared / "data" / "spect_mpi" / "nifti")
    cases = [(file.name.split(".")[0],) for file in sorted(folder.glob("*.nii.gz"))][:limit]
    names = {"spect": _one_surface, "spect perfusion": _both_walls}
    return [
        Benchmark(
            name, "RMS to the points mm", cases, partial(row, folder), _figure, "no fold, .6 mm", has_ladder=False
        )
        for name, row in names.items()
    ]


def _one_surface(folder: Path, case: Case, strength: Strength) -> Row:
    with TemporaryDirectory() as made:
        record = commands.run("fit", folder / f"{case[0]}.nii.gz", *OPTIONS, "-o", Path(made) / "lv")
    return _judged(record["error"]["rms"], commands.status_of(record), record["min_jacobian"], {})


def _both_walls(folder: Path, case: Case, strength: Strength) -> Row:
    found = qf.ventricle_from_perfusion(qf.read_volume(folder / f"{case[0]}.nii.gz"), region=REGION)
    fit = qf.fit(found.clouds, base=found.base)
    distances = {name: fit.model.distance(points, name) for name, points in found.unthinned.items()}
    numbers = {f"{name} mm": rms(each) for name, each in distances.items()} | {"crossings": len(fit.model.crossings())}
    status = status_text(fit.status, fit.warnings)
    return _judged(rms(np.concatenate([*distances.values()])), status, fit.model.min_jacobian(), numbers)


def _judged(error: float, status: str, fold: float, numbers: dict[str, float]) -> Row:
    return Row(error, status, fold, None, numbers)


def _figure(rows: Sequence[Row]) -> str:
    found = errors(rows)
    crossings = int(np.sum(column(rows, "crossings") > 0))
    return (
        f"{count_folds(rows)}, {crossings} self-intersect, {mean(found):.2f} mm, worst {largest(found):.2f}, "
        f"{percent_ok(rows):.0f} % ok"
    )
