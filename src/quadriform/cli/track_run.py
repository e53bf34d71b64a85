"""What `quadriform track` does: points of the frames from files of any kind, the moving model, and its record."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from quadriform.cli.heart_volumes import cycle_rows, cycle_volumes
from quadriform.cli.method_options import known_noise
from quadriform.cli.options import Common, stem
from quadriform.cli.reporting import REPORT, measures_of, page_of_track, track_options
from quadriform.cli.results import FRAMES, MODEL, earlier_results, frame_model
from quadriform.cli.screen import closing_rows, note, progress_bar, show, texts, warn
from quadriform.cli.status import check_strict
from quadriform.cli.track_options import FrameReading, Motion
from quadriform.errors import join_warnings
from quadriform.files import save, sha256_of
from quadriform.files.atomic import write_bytes
from quadriform.files.reading import named_in_errors
from quadriform.files.result_folder import check_results, replaced_together
from quadriform.fitting.population.checks import check_world
from quadriform.heart.base_reach import reach_notes, reach_over_base
from quadriform.imaging.file_points import files_of, input_files, space_to_write, title_of, without_folders
from quadriform.imaging.frame_series import FrameSeries, drop_points_between_slices, frame_files, read_frames
from quadriform.shapes.landmarks import NONE_KNOWN
from quadriform.shapes.record import remarks
from quadriform.words import after_number, csv_bytes

if TYPE_CHECKING:
    from quadriform.heart.measures_table import Measures
    from quadriform.motion.slice_move import SliceMove
    from quadriform.motion.track import Track

Record = dict[str, Any]


def run(
    inputs: Sequence[Path],
    output: Path | None,
    reading: FrameReading,
    motion: Motion,
    space: str | None,
    common: Common,
) -> None:
    """Read the frames, fit a moving model, write and show the results.

    Raises:
        QuadriformError: nothing was written.
    """
    options = motion.options()
    files = frame_files(inputs)
    # a folder is shown by its name, not by its hundred files
    shown = inputs if any(map(Path.is_dir, inputs)) else files  # in the order of time
    folder = output or Path(f"{stem(inputs[0])}-track")
    earlier = earlier_results(folder)
    check_results(folder, [MODEL, FRAMES, REPORT, *earlier], common.force, files)
    begin = time.perf_counter()
    with named_in_errors(*inputs):
        frames = _read(files, reading, motion.shift_slices)
        if motion.strategy == "alone":
            check_results(folder, [frame_model(n) for n in range(len(frames.sets))], common.force, files)
        found = _track(frames, motion.shift_slices, space, options, shown, files)
        check_strict(common.strict, found.status, found.warnings)
    models = {MODEL: found.moving} if found.moving else {frame_model(n): m for n, m in enumerate(found.models)}
    measures = measures_of(found.models, found.times if found.moving is not None else None)
    targets = [folder / name for name in (*models, FRAMES, REPORT)]
    every = [each for frame in frames.sets for each in frame.values()]
    noise = [each.noise for each in every]
    stated = known_noise(noise, found.models[0].unit, options.get("noise"), every[0].factor)
    record = _record(shown, targets, found, measures, time.perf_counter() - begin) | {"known_noise": stated}
    page = page_of_track(found, frames, title_of(shown), record | track_options(options), measures)
    with replaced_together(folder, next(iter(models)), common.force, earlier) as staging:
        for name, model in models.items():
            save(model, staging / name)
        write_bytes(staging / FRAMES, _csv(record["frames"], found))
        write_bytes(staging / REPORT, page)
    warn(record["warnings"])
    show(record, common.as_json, _rows(record), record["input"])


def _read(files: Sequence[Path], reading: FrameReading, shift_slices: bool) -> FrameSeries:
    frames = read_frames(files, reading.surface or [], reading.columns, reading.affine, reading.labelled_heart)
    if shift_slices:
        drop_points_between_slices(frames)
    for text in dict.fromkeys(frames.notes):
        note(text)
    return frames


def _track(
    frames: FrameSeries,
    shift_slices: bool,
    asked: str | None,
    options: dict[str, Any],
    inputs: Sequence[Path],
    files: Sequence[Path],
) -> "Track":
    """The moving model with frame, unit, input files, warnings and notes, in the frame to write in."""
    from quadriform.motion.tracking import track

    space, unit = frames.space_and_unit
    target = space_to_write(asked, space)
    with progress_bar("cycle") as progress:
        slices = frames.slice_of_point if shift_slices else None
        options = frames.with_times(options)
        if "prior" in options:
            check_world(options["prior"], unit, space)
        found = track(frames.sets, slices=slices, base=frames.bases, progress=progress, **options)
    # an image of several files counts as all of them, each once
    sha256 = sha256_of(*dict.fromkeys(file for path in files for file in files_of(path)))
    record = replace(found.models[0].record, title=title_of(inputs), sources=input_files({"": files}))
    metadata: dict[str, Any] = {"space": space, "unit": unit, "input_sha256": sha256, "record": record}
    each = frames.landmarks or (NONE_KNOWN,) * len(found.models)
    found = replace(
        found,
        moving=None if found.moving is None else replace(found.moving, **metadata, landmarks=frames.landmarks),
        models=tuple(replace(model, **metadata, landmarks=one) for model, one in zip(found.models, each)),
        warnings=join_warnings(frames.warnings, found.warnings),
        notes=(*without_folders(frames.notes, files), *found.notes),
    )
    return replace(found, notes=(*found.notes, *reach_notes(found.models))).in_space(target)


def _record(
    inputs: Sequence[Path], targets: Sequence[Path], found: "Track", measures: "Measures | None", seconds: float
) -> Record:
    model = found.models[0]
    return {
        "input": ", ".join(map(str, inputs)),
        "status": found.status,
        "outputs": [str(path) for path in targets],
        "strategy": found.strategy,
        "frames": _frame_records(found, measures),
        "points": int(sum(len(values) for frame in found.residuals for values in frame.values())),
        "parameters": found.moving.n_parameters if found.moving else sum(m.n_parameters for m in found.models),
        "rms": found.rms,
        **cycle_volumes(measures),
        "extends_beyond_base": reach_over_base(found.models),
        "noise": found.noise,
        "strengths": list(found.strengths),
        "shifts": {str(number): shift.tolist() for number, shift in found.shifts.items()},
        "moves": {str(number): _move_record(move) for number, move in found.moves.items()},
        "min_jacobian": min(model.min_jacobian() for model in found.models),
        "space": model.space,
        "unit": model.unit,
        "seconds": round(seconds, 3),
        "warnings": texts(found.warnings),
        "notes": list(found.notes),
    }


def _frame_records(found: "Track", measures: "Measures | None") -> list[Record]:
    frames = []
    each = zip(found.times, found.models, found.frame_rms, found.supported)
    for number, (at, model, rms, supported) in enumerate(each):
        volumes = {f"volume_{name}": model.volume(name) for name in model.surfaces}
        cavity = {} if measures is None else {"cavity_ml": float(measures.curves["cavity volume"][number])}
        to_prior = {"prior_distance": found.prior_distances[number]} if found.prior_distances else {}
        measured = {"time": float(at), "rms": float(rms), "supported": float(supported)}
        frames.append({"frame": number, **measured, **volumes, **cavity, **to_prior})
    return frames


def _move_record(move: "SliceMove") -> dict[str, Any]:
    """The motion of a slice: rotation in degrees; standard deviations along the axes of the slice, its normal last."""
    return {
        "rotation_degrees": np.degrees(move.rotation).tolist(),
        "centre": move.centre.tolist(),
        "shift": move.shift.tolist(),
        "axes": move.axes.tolist(),
        "rotation_sd_degrees": np.degrees(move.sd[:3]).tolist(),
        "shift_sd": move.sd[3:].tolist(),
    }


def _distance_rows(frames: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """The largest distance of a frame to the population of a prior."""
    if "prior_distance" not in frames[0]:
        return []
    farthest = max(frames, key=lambda frame: frame["prior_distance"])
    return [("distance to the prior", f"{farthest['prior_distance']:.3g} in frame {farthest['frame']}, the largest")]


def _move_rows(moves: Mapping[str, Mapping[str, Any]], unit: str) -> list[tuple[str, str]]:
    """The largest shift and rotation of a slice, with the largest standard deviation of their components."""
    rows = []
    for words, key, sd, of in (
        ("shift", "shift", "shift_sd", unit),
        ("rotation", "rotation_degrees", "rotation_sd_degrees", " degrees"),
    ):
        sizes = {number: float(np.linalg.norm(move[key])) for number, move in moves.items()}
        if sizes:
            slice_number = max(sizes, key=lambda number: sizes[number])
            found = f"{sizes[slice_number]:.3g}{of} of slice {slice_number}, sd {max(moves[slice_number][sd]):.2g}{of}"
            rows.append((f"largest {words} of a slice", found))
    return rows


def _csv(frames: Sequence[Mapping[str, Any]], found: "Track") -> bytes:
    """A row a frame with status, warnings and the number of all rows, by which a truncated table is recognised."""
    whole = {"rows": len(frames), "status": found.status, "warnings": "; ".join(map(str, remarks(found.warnings)))}
    return csv_bytes([*frames[0], *whole], [[*frame.values(), *whole.values()] for frame in frames])


def _rows(record: Record) -> list[tuple[str, str]]:
    unit = after_number(record["unit"])
    frames = record["frames"]
    worst, least = max(frames, key=lambda frame: frame["rms"]), min(frames, key=lambda frame: frame["supported"])
    cubed = f"{unit}^3" if unit else ""
    ranges = []
    for name in (name for name in frames[0] if name.startswith("volume_")):
        low, high = (of(frame[name] for frame in frames) for of in (min, max))
        closed = ", closed surface" if "closed_ejection_fraction" in record else ""
        ranges.append((f"{name.replace('_', ' ')}{closed}", f"{low:.5g} to {high:.5g}{cubed}"))
    return [
        ("frames", str(len(frames))),
        ("points", str(record["points"])),
        ("parameters", str(record["parameters"])),
        ("strategy", record["strategy"]),
        ("error RMS", f"{record['rms']:.4g}{unit}"),
        ("worst frame", f"{worst['frame']}: {worst['rms']:.4g}{unit}"),
        ("supported by data", f"{100 * least['supported']:.0f} % of the area or more, least in frame {least['frame']}"),
        ("noise", f"{record['noise']:.4g}{unit}"),
        ("known noise", record["known_noise"]),
        *_distance_rows(frames),
        *_move_rows(record["moves"], unit),
        *cycle_rows(record),
        *ranges,
        ("min det J", f"{record['min_jacobian']:.3g}"),
        ("time", f"{record['seconds']:.2f} s"),
        *closing_rows(record),
    ]
