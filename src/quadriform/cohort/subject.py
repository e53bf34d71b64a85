"""The task of a worker: one subject is read, fitted or tracked, measured and written; repeating it changes nothing.

The folder of a subject contains `model.json`, which is the source of truth, and `record.json` with its measures, its
warnings, and a hash of the input by which a later run detects changes.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from quadriform import __version__
from quadriform.cohort.layout import Layout
from quadriform.cohort.manifest import READING, Row
from quadriform.cohort.measures import PRIOR_DISTANCE, Measure, measures_of
from quadriform.cohort.prior_file import PriorFile
from quadriform.cohort.subject_files import files_by_surface, read_subject
from quadriform.errors import InputError, OutputError, QuadriformError, check_strict, join_warnings
from quadriform.files import save, sha256_of
from quadriform.files.atomic import make_folder, write_bytes
from quadriform.files.models import parse_json, read_any_model
from quadriform.files.reading import quoted, read_bytes
from quadriform.files.strict import Field
from quadriform.fitting.fit import fit
from quadriform.fitting.result import Fit
from quadriform.heart.base_reach import reach_notes
from quadriform.imaging.file_points import files_of, input_files, without_folders
from quadriform.imaging.fit_files import with_base
from quadriform.imaging.frame_series import FrameSeries, drop_points_between_slices
from quadriform.motion.track import Track
from quadriform.motion.tracking import track
from quadriform.points import Array
from quadriform.shapes.landmarks import NONE_KNOWN
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import ModelRecord

MODEL, RECORD = "model.json", "record.json"
FORMAT = "quadriform-cohort-record"
VERSION = 4
"""Of a record; subjects with older ones are processed again. Since 2 with the sentences of warnings, and with notes;
since 3 a single frame is fitted with all that its files state about the points; since 4 with standard deviations."""
ONE_FRAME = ("method", "iterations")
SEVERAL_FRAMES = ("strategy", "period", "shift_slices")
"""Options that apply only to subjects of one frame, or of several."""
FITTED, KEPT, FAILED = "fitted", "kept", "failed"
AnyModel = DeformableModel | MovingModel
FitOrTrack = TypeVar("FitOrTrack", Fit, Track)


@dataclass(frozen=True)
class Task:
    """The arguments of a worker.

    Attributes:
        row: of the list.
        folder: to which its paths are relative.
        results: in which the subject's folder is created.
        layout: of the cohort.
        resume: keep the result of an earlier run when nothing has changed since.
        strict: the mildest status that is refused, or None.
        prior: of shape, of all subjects; or None.
    """

    row: Row
    folder: Path = field(repr=False)
    results: Path = field(repr=False)
    layout: Layout = field(repr=False)
    resume: bool = False
    strict: str | None = None
    prior: PriorFile | None = None

    @property
    def target(self) -> Path:
        """The folder of the subject."""
        return subject_folder(self.results, self.row.id)


@dataclass(frozen=True)
class Parameters:
    """The parameters of a subject, (F, ...) over its frames.

    Attributes:
        superquadrics: (F, S, 11), surfaces in the order of the layout, values as `Superquadric.parameters`.
        origin: (F, 3), corner of the undeformed box.
        edges: (F, 3, 3), its sides.
        control_points: (F, l+1, m+1, n+1, 3).
        time: (F,).
    """

    superquadrics: Array
    origin: Array
    edges: Array
    control_points: Array
    time: Array


@dataclass(frozen=True)
class Failure:
    """Why a subject has no result.

    Attributes:
        kind: name of the error.
        error: its sentence.
    """

    kind: str
    error: str

    @classmethod
    def of(cls, error: BaseException, folder: Path) -> "Failure":
        """Return the failure of an exception, in one line; paths are relative to the list, as in all results."""
        text = str(error) if isinstance(error, QuadriformError) else f"internal error: {error!r}"
        return cls(type(error).__name__, " ".join(text.replace(f"{folder}{os.sep}", "").split()))

    @classmethod
    def of_worker(cls, error: BaseException) -> "Failure":
        """Return the failure of a task without a result; the text of the executor may contain the id."""
        return cls(type(error).__name__, "no result was returned; the worker may have died of this subject")


@dataclass(frozen=True)
class Outcome:
    """The result of a worker: parameters and measures, or a failure.

    Attributes:
        number: of the subject in the list.
        id: its name.
        how: "fitted", "kept" from an earlier run, or "failed".
        parameters: None when it failed.
        measures: empty when it failed.
        failure: None when it did not fail.
    """

    number: int
    id: str = field(repr=False)
    how: str
    parameters: Parameters | None = field(default=None, repr=False)
    measures: tuple[Measure, ...] = field(default=(), repr=False)
    failure: Failure | None = field(default=None, repr=False)


def subject_folder(results: Path, name: str) -> Path:
    """Return the folder of the results of a subject."""
    return results / "subjects" / name


def work(task: Task) -> Outcome:
    """Return the outcome of one subject; errors are rows of the table of failures and are not raised.

    Some executors print what a worker raises together with its arguments, which contain the id of the subject.
    """
    try:
        with threadpool_limits(1):  # one subject a core: threads are no faster on small matrices
            return _work(task)
    except Exception as error:
        return Outcome(task.row.number, task.row.id, FAILED, failure=Failure.of(error, task.folder))


def _work(task: Task) -> Outcome:
    files = [path for many in files_by_surface(task.row, task.folder).values() for path in many]
    key = _input_hash(task, [file for path in files for file in files_of(path)])
    kept = _kept(task, key) if task.resume else None
    if kept is not None:
        return kept
    _remove(task)  # otherwise an outdated result would remain if this task fails
    frames, read = read_subject(task.row, task.folder)
    frames.notes = list(without_folders(frames.notes, files))
    model, measures = _fitted_or_tracked(frames, task)
    check_strict(task.strict, model.status, model.warnings)
    record = replace(model.record, title=task.row.id, sources=input_files(files_by_surface(task.row, task.folder)))
    model = replace(model, input_sha256=sha256_of(read[0], *read[1:]), record=record)
    parameters = parameters_of(model, task.layout)
    make_folder(task.target)
    write_bytes(task.target / RECORD, _record(key, measures, model.record, task.prior), force=True)
    save(model, task.target / MODEL, force=True)  # the last file marks the subject as done
    return Outcome(task.row.number, task.row.id, FITTED, parameters, measures)


# --- model -------------------------------------------------------------------------------------------------------


def _fitted_or_tracked(frames: FrameSeries, task: Task) -> tuple[AnyModel, tuple[Measure, ...]]:
    options = {name: value for name, value in task.row.options if name not in READING}
    several = len(frames.sets) > 1  # one frame is fitted, several are tracked
    for name in ONE_FRAME if several else SEVERAL_FRAMES:
        options.pop(name, None)  # an option of the cohort that does not apply to this subject
    return (_tracked if several else _fitted)(frames, task, options)


def _fitted(frames: FrameSeries, task: Task, options: dict[str, Any]) -> tuple[AnyModel, tuple[Measure, ...]]:
    landmarks = frames.landmarks[0] if frames.landmarks else NONE_KNOWN
    if task.prior is not None:
        options |= {"prior": task.prior.read(), "space": frames.space_and_unit[0]}
    found = _with_reading(fit(frames.sets[0], **with_base(options, landmarks.base)), frames)
    model = _with_metadata(replace(found.model, landmarks=landmarks), frames, task.layout)
    model = replace(found, model=model).with_estimates().model
    about = {"points": found.n_points, "rms": found.rms, "noise": found.noise}
    if found.prior_distance is not None:
        about[PRIOR_DISTANCE] = found.prior_distance
    return model, measures_of([model], np.zeros(1), [found.rms], about, model.record)


def _tracked(frames: FrameSeries, task: Task, options: dict[str, Any]) -> tuple[AnyModel, tuple[Measure, ...]]:
    if options.pop("shift_slices", False):
        drop_points_between_slices(frames)
        options["slices"] = frames.slice_of_point
    if task.prior is not None:
        options["prior"] = task.prior.read()
    found = _with_reading(track(frames.sets, base=frames.bases, **frames.with_times(options)), frames)
    if found.moving is None:
        raise InputError("expected a strategy that gives one moving model")
    model = _with_metadata(replace(found.moving, landmarks=frames.landmarks), frames, task.layout)
    count = sum(len(values) for frame in found.residuals for values in frame.values())
    about = {"points": count, "rms": found.rms, "noise": found.noise}
    if found.prior_distances:
        about[PRIOR_DISTANCE] = max(found.prior_distances)
    models = [model.at(time) for time in found.times]  # each with the landmarks of its frame
    record = replace(model.record, notes=(*model.record.notes, *reach_notes(models)))
    return replace(model, record=record), measures_of(models, found.times, found.frame_rms, about, record)


def _with_reading(found: FitOrTrack, frames: FrameSeries) -> FitOrTrack:
    """The same result with the warnings and notes of reading before its own."""
    warnings = join_warnings(frames.warnings, found.warnings)
    return replace(found, warnings=warnings, notes=(*frames.notes, *found.notes))


def _with_metadata(model: Any, frames: FrameSeries, layout: Layout) -> Any:
    """The model with its space and unit, transformed to the space of the cohort.

    Raises:
        InputError: in another unit, or in a space that cannot be transformed to that of the cohort.
    """
    space, unit = frames.space_and_unit
    if unit != layout.unit:
        raise InputError(f"lengths in {unit}; expected {layout.unit} as in the rest of the cohort")
    model = replace(model, space=space, unit=unit)
    return model if space == layout.space else model.in_space(layout.space)


def parameters_of(model: AnyModel, layout: Layout) -> Parameters:
    """Return the parameters of a model, in the order of the cohort.

    Raises:
        InputError: other surfaces, another box, or more frames than the store has.
    """
    times = model.frame_times if isinstance(model, MovingModel) else np.zeros(1)
    models = [model.at(time) for time in times] if isinstance(model, MovingModel) else [model]
    if set(model.surfaces) != set(layout.surfaces) or len(times) > layout.frames:
        raise InputError(
            f"surfaces {', '.join(model.surfaces)} in {len(times)} frames; expected {', '.join(layout.surfaces)} in "
            f"{layout.frames} frames at most, as in the rest of the cohort"
        )
    shape = models[0].box.control_points.shape[:3]
    if shape != layout.box or any(not surface.is_radial for surface in model.surfaces.values()):
        raise InputError(f"box {shape}; expected {layout.box} around ellipsoids, as in the rest of the cohort")
    return Parameters(
        superquadrics=np.array([[m.surfaces[name].parameters for name in layout.surfaces] for m in models]),
        origin=np.array([m.box.origin for m in models]),
        edges=np.array([m.box.edges for m in models]),
        control_points=np.array([m.box.control_points for m in models]),
        time=times,
    )


# --- record ------------------------------------------------------------------------------------------------------


def _input_hash(task: Task, files: list[Path]) -> str:
    """A hash of everything that determines the result: options, version, and name, size and time of each file."""
    row, layout = task.row, task.layout
    about = [repr(part) for part in (__version__, row.options, row.surfaces, layout.space, layout.unit, task.strict)]
    if task.prior is not None:
        about.append(task.prior.sha256)
    for file in files:
        try:
            status = file.stat()
        except OSError as error:
            raise InputError(f"{quoted(file)}: cannot be read: {error.strerror}") from error
        about.append(f"{file.name} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(about).encode()).hexdigest()


def _record(key: str, measures: tuple[Measure, ...], fit: ModelRecord, prior: PriorFile | None) -> bytes:
    of_prior = {} if prior is None else {"prior": {"name": prior.path.name, "sha256": prior.sha256}}
    document = {
        "format": FORMAT,
        "version": VERSION,
        "key": key,
        "status": fit.status,
        "warnings": {str(kind): text for kind, text in fit.warnings.items()},
        "notes": list(fit.notes),
        **of_prior,
        "measures": [[m.quantity, m.frame, m.value, m.unit, m.text] for m in measures],
    }
    return (json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n").encode()


def _kept(task: Task, key: str) -> Outcome | None:
    """The outcome of an earlier run of the same task; None when there is none, or it cannot be used."""
    path = task.target / RECORD
    try:
        record = Field(parse_json(read_bytes(path), quoted(path)), "", "record")
        if record.member("version").whole() != VERSION or record.member("key").text() != key:
            return None
        model = read_any_model(task.target / MODEL)
        measures = tuple(_measures(record.member("measures")))
        return Outcome(task.row.number, task.row.id, KEPT, parameters_of(model, task.layout), measures)
    except (QuadriformError, ValueError):
        return None


def _measures(field: Field) -> Iterator[Measure]:
    for item in field.items():
        quantity, frame, value, unit, text = item.items()
        at = None if frame.value is None else frame.whole()
        yield Measure(quantity.text(), at, value.number(), unit.text(), text.text())


def _remove(task: Task) -> None:
    """Remove the model before its record: never a model with the record of another run."""
    for name in (MODEL, RECORD):
        try:
            (task.target / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{quoted(task.target / name)}: cannot be replaced: {error.strerror}") from error
