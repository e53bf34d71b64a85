"""The work behind `quadriform track`: the frames' points from files of any kind, the moving model, and its record."""

import csv
import io
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.cli.inputs import ImageOptions, files_of, kind_of, naming, read_source, refuse, space_to_write
from quadriform.cli.options import stem
from quadriform.cli.reporting import REPORT, page_of_track, track_options
from quadriform.cli.screen import emit_json, emit_table, progress_bar, say, warn
from quadriform.errors import InputError, OptionError, Warnings
from quadriform.files import save, sha256_of
from quadriform.files.atomic import check_folder, check_writable, make_folder, write_bytes
from quadriform.files.guide_points import FRAME_FILE, read_guide_points
from quadriform.fitting.fit import ALONE
from quadriform.points import Array

if TYPE_CHECKING:
    from quadriform.motion.tracking import Track

Record = dict[str, Any]

SAME_GRID = 1e-3
"""Transforms of images whose entries differ by less, in the unit of the image, are the same."""


@dataclass
class _Frames:
    """What the files hold.

    Attributes:
        clouds: for each frame its points by surface.
        slices: the slice number of each point, in the same form; for frames of contours and images alone.
        grids: for these frames world from voxel of the image, (4, 4); None for contours.
        marks: frames of the world and units that were found.
        times: of the frames, where a file tells.
        warnings: of the reading.
        notes: what was assumed, one sentence each.
    """

    clouds: list[dict[str, Array]] = field(default_factory=list)
    slices: list[dict[str, NDArray[np.int64]]] = field(default_factory=list)
    grids: list[Array | None] = field(default_factory=list)
    marks: set[tuple[str, str]] = field(default_factory=set)
    times: Array | None = None
    warnings: Warnings = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def follow(
    inputs: Sequence[Path],
    surfaces: Sequence[str],
    output: Path | None,
    shift_slices: bool,
    space: str | None,
    options: dict[str, Any],
    strict: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Read, fit, write and show.

    Raises:
        QuadriformError: nothing was written.
    """
    files = _files(inputs)
    folder = output or Path(f"{stem(inputs[0])}-track")
    targets = [folder / "model.json", folder / "frames.csv", folder / REPORT]
    check_folder(folder)
    if folder.exists():
        for path in targets:
            check_writable(path, force, inputs=files)
    begin = time.perf_counter()
    with naming(*inputs):
        frames = _read(files, surfaces)
        if shift_slices:
            _keep_slices(frames)
        for note in dict.fromkeys(frames.notes):
            say(f"note: {note}")
        found = _track(frames, shift_slices, space, options, files)
        if strict:
            refuse(found.warnings)
    record = _record(inputs, targets, found, time.perf_counter() - begin)
    title = ", ".join(path.name for path in inputs[:3]) + (" ..." if len(inputs) > 3 else "")
    space = next(iter(frames.marks))[0]
    page = page_of_track(found, frames.clouds, frames.slices, space, title, record | track_options(options))
    make_folder(folder)
    if found.moving is None:
        targets[0] = folder / "frame_000.json"
        for number, model in enumerate(found.models):
            save(model, folder / f"frame_{number:03d}.json", force)
        record["outputs"][0] = f"{targets[0]} and the others"
    else:
        save(found.moving, targets[0], force)
    write_bytes(targets[1], _csv(record["frames"]), force)
    write_bytes(targets[2], page, force)
    warn(record["warnings"])
    if as_json:
        emit_json(record)
    else:
        emit_table(_rows(record), title=", ".join(map(str, inputs)))


def _files(inputs: Sequence[Path]) -> list[Path]:
    """The files of the frames in order; those of a folder by name.

    Raises:
        InputError: a folder without any.
    """
    result = []
    for path in inputs:
        if not path.is_dir() or kind_of(path):
            result.append(path)
            continue
        inside = sorted(file for file in path.iterdir() if file.is_file())
        chosen = [file for file in inside if FRAME_FILE.fullmatch(file.name)] or [
            file for file in inside if kind_of(file)
        ]
        if not chosen:
            raise InputError(f"{str(path)!r}: the folder holds no contours, points, meshes or images")
        result += chosen
    return result


def _read(files: Sequence[Path], surfaces: Sequence[str]) -> _Frames:
    frames = _Frames()
    labels = dict(_label(text) for text in surfaces)
    for file in files:
        if FRAME_FILE.fullmatch(file.name):
            _add_contours(frames, file, labels)
        elif kind_of(file) == "image":
            _add_image(frames, file, labels)
        else:
            source = read_source(file, ImageOptions())
            _add(frames, {ALONE: source.points}, (source.space, source.unit), source.warnings, source.notes)
    if len(frames.marks) > 1:
        raise InputError(f"the frames differ in frame of the world or unit: {sorted(frames.marks)}")
    return frames


def _add(
    frames: _Frames, clouds: dict[str, Array], marks: tuple[str, str], warnings: Warnings, notes: Sequence[str]
) -> None:
    frames.clouds.append(clouds)
    frames.marks.add(marks)
    for kind, text in warnings.items():
        if text not in frames.warnings.get(kind, ""):
            frames.warnings[kind] = "; ".join(filter(None, [frames.warnings.get(kind), text]))
    frames.notes += notes


def _add_contours(frames: _Frames, file: Path, labels: Mapping[str, str]) -> None:
    if labels:
        raise OptionError(
            f"option --surface does not go with contours such as {file.name!r}: their types name surfaces"
        )
    read = read_guide_points(file)
    found = {name: read.surface(name) for name in ("endo", "epi")}
    frames.slices.append({name: slices for name, (_, slices) in found.items()})
    frames.grids.append(None)
    _add(frames, {name: points for name, (points, _) in found.items()}, ("LPS", "mm"), {}, ())


def _add_image(frames: _Frames, file: Path, labels: Mapping[str, str]) -> None:
    from quadriform.imaging.reading import frame_count, frame_times

    count = frame_count(file)
    if count > 1:
        frames.times = frame_times(file)
    for number in range(count):
        options = replace(ImageOptions(), frame=number if count > 1 else None)
        chosen = {name: options.with_label(value) for name, value in labels.items()} or {ALONE: options}
        sources = {name: read_source(file, option) for name, option in chosen.items()}
        first = next(iter(sources.values()))
        notes = [note for source in sources.values() for note in source.notes]
        warnings: Warnings = {}
        for source in sources.values():
            warnings |= source.warnings
        clouds = {name: source.points for name, source in sources.items()}
        frames.slices.append({name: source.slices for name, source in sources.items() if source.slices is not None})
        frames.grids.append(None if first.image is None else first.image.world_from_voxel)
        _add(frames, clouds, (first.space, first.unit), warnings, notes)


def _label(text: str) -> tuple[str, str]:
    """A surface's name and its labels, as --label takes them."""
    from quadriform.imaging.labels import parse_surface

    name, labels = parse_surface(text)
    return name, ",".join(map(str, labels.values))


def _keep_slices(frames: _Frames) -> None:
    """Leave out the points of images that are of no slice; how many is said.

    Raises:
        OptionError: frames without slice numbers, or whose numbers do not mean the same slices.
    """
    from quadriform.imaging.slice_numbers import BETWEEN, slice_axis

    if len(frames.slices) != len(frames.clouds):
        raise OptionError("option --shift-slices needs slice numbers in all frames: contours, or images")
    first = frames.grids[0]
    for number, grid in enumerate(frames.grids):
        if not _same_slices(first, grid):
            raise OptionError(f"option --shift-slices: the slices of frame {number} are not those of frame 0")
    if first is None:
        return
    left = total = 0
    for clouds, slices in zip(frames.clouds, frames.slices):
        for name, numbers in slices.items():
            kept = numbers != BETWEEN
            left, total = left + int((~kept).sum()), total + len(kept)
            clouds[name], slices[name] = clouds[name][kept], numbers[kept]
    axis = slice_axis(first)
    frames.notes.append(
        f"slices are taken along {'ijk'[axis]}, {np.linalg.norm(first[:3, axis]):.3g} apart; {left} of {total} points "
        "lie between two slices and are left out"
    )


def _same_slices(one: Array | None, other: Array | None) -> bool:
    """Whether two frames have slices of contours, or images on one grid."""
    if one is None or other is None:
        return one is other
    return np.allclose(one, other, rtol=0, atol=SAME_GRID)


def _track(
    frames: _Frames, shift_slices: bool, asked: str | None, options: dict[str, Any], files: Sequence[Path]
) -> "Track":
    from quadriform.motion.tracking import track

    space, unit = next(iter(frames.marks))
    wanted = space_to_write(asked, space)
    given = dict(options)
    if frames.times is not None and len(frames.times) == len(frames.clouds):
        given.setdefault("times", frames.times)
    with progress_bar("cycle") as progress:
        found = track(frames.clouds, slices=frames.slices if shift_slices else None, progress=progress, **given)
    sha256 = sha256_of(*dict.fromkeys(file for path in files for file in files_of(path)))
    moving = found.moving
    marked = replace(
        found,
        moving=None if moving is None else replace(moving, space=space, unit=unit, input_sha256=sha256),
        models=tuple(replace(model, space=space, unit=unit, input_sha256=sha256) for model in found.models),
        warnings=frames.warnings | found.warnings,
    )
    return marked.in_space(wanted)


def _record(inputs: Sequence[Path], targets: Sequence[Path], found: "Track", seconds: float) -> Record:
    frames = []
    for number, (at, model, rms) in enumerate(zip(found.times, found.models, found.frame_rms)):
        volumes = {f"volume_{name}": model.volume(name) for name in model.surfaces}
        frames.append({"frame": number, "time": float(at), "rms": float(rms), **volumes})
    model = found.models[0]
    return {
        "input": ", ".join(map(str, inputs)),
        "status": found.status,
        "outputs": [str(path) for path in targets],
        "strategy": found.strategy,
        "frames": frames,
        "points": int(sum(len(values) for frame in found.residuals for values in frame.values())),
        "parameters": found.moving.n_parameters if found.moving else sum(m.n_parameters for m in found.models),
        "rms": found.rms,
        "noise": found.noise,
        "strengths": list(found.strengths),
        "shifts": {str(number): shift.tolist() for number, shift in found.shifts.items()},
        "min_jacobian": min(model.min_jacobian() for model in found.models),
        "space": model.space,
        "unit": model.unit,
        "seconds": round(seconds, 3),
        "warnings": {str(kind): text for kind, text in found.warnings.items()},
    }


def _csv(frames: Sequence[Mapping[str, Any]]) -> bytes:
    """A row a frame, each with the number of all rows: a table that was cut shows it."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, [*frames[0], "rows"], lineterminator="\n")
    writer.writeheader()
    writer.writerows({**frame, "rows": len(frames)} for frame in frames)
    return stream.getvalue().encode()


def _rows(record: Record) -> list[tuple[str, str]]:
    unit = "" if record["unit"] == "unknown" else f" {record['unit']}"
    frames = record["frames"]
    worst = max(frames, key=lambda frame: frame["rms"])
    shifts = [float(np.linalg.norm(shift)) for shift in record["shifts"].values()]
    volumes = [name for name in frames[0] if name.startswith("volume_")]
    ranges = []
    for name in volumes:
        low, high = (of(frame[name] for frame in frames) for of in (min, max))
        ranges.append((name.replace("_", " "), f"{low:.5g} to {high:.5g}" + (f"{unit}^3" if unit else "")))
    return [
        ("frames", str(len(frames))),
        ("points", str(record["points"])),
        ("parameters", str(record["parameters"])),
        ("strategy", record["strategy"]),
        ("error RMS", f"{record['rms']:.4g}{unit}"),
        ("worst frame", f"{worst['frame']}: {worst['rms']:.4g}{unit}"),
        ("noise", f"{record['noise']:.4g}{unit}"),
        *([("largest shift of a slice", f"{max(shifts):.3g}{unit}")] if shifts else []),
        *ranges,
        ("min det J", f"{record['min_jacobian']:.3g}"),
        ("time", f"{record['seconds']:.2f} s"),
        ("warnings", ", ".join(record["warnings"]) or "none"),
        ("written", "\n".join(record["outputs"])),
    ]
