"""Cavities of 17 patients (data/sunnybrook): volumes and ejection fractions beside the count of the voxels.

Volumes are cut at the outer faces of the slices with labels, because nobody has drawn the ventricle beyond them.
"""

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
    joined_status,
    largest,
    mean,
    percent_ok,
    present,
)
from quadriform.heart.volumes import volume
from quadriform.shapes.landmarks import BasePlane

FIT = ("--heart", "endo=label:1")
TRACK = FIT
"""The options of `quadriform fit` and of `quadriform track` by which a user names the cavity."""
PHASES = ("ED", "ES")
LEAST_ERROR = 0.5
"""Points of ejection fraction; smaller errors are those of the voxel count itself."""
ACCEPTED_EF, ACCEPTED_VOLUME = 2.5, 5.0
"""Points and per cent."""

Faces = tuple[BasePlane, BasePlane]


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """Both phases as images of their own, and as one 4-D image."""
    folder = present(shared / "data" / "sunnybrook")
    patients = sorted(file.name.removesuffix("_4d_endo.nii.gz") for file in folder.glob("*_4d_endo.nii.gz"))[:limit]
    cases = [(patient,) for patient in patients]
    error = "error of EF, points"
    still = partial(_row, _phases, folder)
    moving = partial(_row, _cycle, folder)
    required = ".7 / 2.5 points, 5 %"
    return [
        Benchmark("sunnybrook", error, cases, still, _figure, required, least_error=LEAST_ERROR),
        Benchmark("sunnybrook 4d", error, cases, moving, _figure, "all within 2 points", least_error=LEAST_ERROR),
    ]


def _row(models_of, folder: Path, case: Case, strength: Strength) -> Row:
    images, models, status = models_of(folder, case[0], strength)
    counted = np.array([count(image) for image in images])
    faces = [stack_faces(image) for image in images]
    fitted = np.array([between(model, pair) for model, pair in zip(models, faces)])
    closed = np.array([model.volume("endo") / 1000 for model in models])
    error = abs(_ef(fitted) - _ef(counted))
    volumes = 100 * np.abs(fitted / counted - 1)
    numbers = {
        "EF counted": _ef(counted),
        "EF": _ef(fitted),
        "EF closed": _ef(closed),
        "error of volume %": float(volumes.max()),
        **{
            f"{name} {phase} ml".strip(): v[k]
            for k, phase in enumerate(PHASES)
            for name, v in (("counted", counted), ("", fitted))
        },
        "outside the stack mm": max(outside(model, pair) for model, pair in zip(models, faces)),
    }
    fold = min(model.min_jacobian() for model in models)
    correct = bool(error <= ACCEPTED_EF and volumes.max() <= ACCEPTED_VOLUME)
    return Row(float(error), status, fold, correct, numbers)


def _phases(folder: Path, patient: str, strength: Strength):
    """Images, models and status by one `quadriform fit` for each phase."""
    images, models, statuses = [], [], {}
    for phase in PHASES:
        file = folder / f"{patient}_{phase}_endo.nii.gz"
        with TemporaryDirectory() as made:
            out = Path(made) / "model"
            record = commands.run("fit", file, *FIT, *commands.strength_option(strength), "-o", out)
            models.append(qf.load(out / "model.json"))
        images.append(qf.read_volume(file))
        statuses[phase] = commands.status_of(record)
    return images, models, joined_status(statuses)


def _cycle(folder: Path, patient: str, strength: Strength):
    """The same by one `quadriform track` of the 4-D image; the first volume is end diastole."""
    file = folder / f"{patient}_4d_endo.nii.gz"
    with TemporaryDirectory() as made:
        out = Path(made) / "cycle"
        record = commands.run("track", file, *TRACK, *commands.strength_option(strength), "-o", out)
        moving = qf.load(out / "model.json")
    models = [moving.at(float(time)) for time in moving.frame_times]
    return [qf.read_volume(file, frame) for frame in range(len(models))], models, commands.status_of(record)


def count(image: qf.Volume) -> float:
    """Volume of the voxels with labels, ml."""
    return float((image.values == 1).sum() * abs(np.linalg.det(image.world_from_voxel)) / 1000)


def stack_faces(image: qf.Volume) -> Faces:
    """The planes of the outer faces of the first and the last slice with labels, with outward directions."""
    affine = image.world_from_voxel
    slices = np.flatnonzero((image.values == 1).any(axis=(0, 1)))
    normal = np.cross(affine[:3, 0], affine[:3, 1])
    normal *= np.sign(normal @ affine[:3, 2]) / np.linalg.norm(normal)
    first, last = (affine[:3, 3] + k * affine[:3, 2] for k in (slices[0] - 0.5, slices[-1] + 0.5))
    return BasePlane(first, -normal), BasePlane(last, normal)


def between(model: qf.DeformableModel, faces: Faces) -> float:
    """Volume of the cavity between the faces of the stack, ml."""
    first, last = faces
    outside_first = volume(model, "endo", BasePlane(first.point, -first.direction))
    return (volume(model, "endo", last) - outside_first) / 1000


def outside(model: qf.DeformableModel, faces: Faces) -> float:
    """How far the surface extends over the faces of the stack."""
    vertices = model.mesh("endo").vertices
    return max(float(face.heights(vertices).max()) for face in faces)


def _ef(volumes: np.ndarray) -> float:
    return float(100 * (1 - volumes[1] / volumes[0]))


def _figure(rows: Sequence[Row]) -> str:
    found, volumes = errors(rows), column(rows, "error of volume %")
    closed = np.abs(column(rows, "EF closed") - column(rows, "EF counted"))
    return (
        f"{mean(found):.2f} / {largest(found):.1f} points (closed surface {mean(closed):.1f} / {largest(closed):.1f}), "
        f"largest error of a volume {largest(volumes):.0f} %, {percent_ok(rows):.0f} % ok, {count_folds(rows)}"
    )
