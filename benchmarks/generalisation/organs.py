"""General shapes (data/organs, data/objects): `quadriform fit` on each mesh; the mesh itself is the truth."""

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
    mean,
    percent_ok,
    present,
)
from quadriform.errors import InputError

ACCEPTED_DICE, ACCEPTED_RMS = 0.97, 1.0
"""Of closed meshes; RMS in per cent of the diagonal of those that are open."""


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark for each folder."""
    result = []
    for name in ("organs", "objects"):
        folder = present(shared / "data" / name)
        cases = [(file.stem,) for file in sorted(folder.glob("*.ply"))][:limit]
        required = 'no exit code 2, Dice >= .97 or "unreliable"'
        row = partial(_row, folder)
        result.append(Benchmark(name, "RMS both ways, % of the diagonal", cases, row, _figure, required))
    return result


def _row(folder: Path, case: Case, strength: Strength) -> Row:
    file = folder / f"{case[0]}.ply"
    with TemporaryDirectory() as made:
        out = Path(made) / "model"
        record = commands.run("fit", file, *commands.strength_option(strength), "-o", out)
        model = qf.load(out / "model.json")
    truth = mesh_of(file)
    size = float(np.linalg.norm(np.ptp(truth.vertices, axis=0))) / 100
    ways = qf.surface_distances(model, truth)
    error = float(np.sqrt(np.mean([way.rms**2 for way in ways]))) / size
    numbers = {"largest from the model %": ways[0].largest / size, "largest from the mesh %": ways[1].largest / size}
    overlap = dice_of(model, truth)
    numbers |= {} if overlap is None else {"Dice": overlap}
    correct = error <= ACCEPTED_RMS if overlap is None else overlap >= ACCEPTED_DICE
    return Row(error, commands.status_of(record), record["min_jacobian"], correct, numbers)


def mesh_of(file: Path) -> qf.Mesh:
    """The mesh of a file; of a mesh in metres its coordinates are those of the file, as the model's are."""
    import trimesh

    loaded = trimesh.load(file, process=False)
    return qf.Mesh(np.asarray(loaded.vertices, dtype=float), np.asarray(loaded.faces, dtype=np.int64))


def dice_of(model: qf.DeformableModel, truth: qf.Mesh) -> float | None:
    """The overlap; None where the mesh is open."""
    try:
        return qf.dice(model, truth)
    except InputError:
        return None


def _figure(rows: Sequence[Row]) -> str:
    overlaps, found = column(rows, "Dice"), errors(rows)
    least = -largest(-overlaps)
    accepted = sum(row.correct or row.status.startswith("unreliable") for row in rows)
    return (
        f"{accepted} of {len(rows)} accepted, Dice from {least:.3f}, RMS {mean(found):.2f} / {largest(found):.2f} % of "
        f"the diagonal, {count_folds(rows)}, {percent_ok(rows):.0f} % ok"
    )
