"""What `quadriform fit` does: which inputs make which models, and one record for each."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from quadriform.cli.exit_codes import report_error
from quadriform.cli.heart_volumes import supported_volumes, volume_rows, volumes_below
from quadriform.cli.method_options import known_noise
from quadriform.cli.options import Common, check_file_names, stem, surface_file
from quadriform.cli.reporting import REPORT, fit_options, page_of_fit
from quadriform.cli.results import MODEL, earlier_results
from quadriform.cli.screen import closing_rows, note, print_remarks, progress_bar, show, texts, warn
from quadriform.cli.status import check_strict
from quadriform.errors import InputError, OptionError
from quadriform.files import save, write_mesh
from quadriform.files.atomic import write_bytes
from quadriform.files.frame_numbers import natural
from quadriform.files.reading import named_in_errors
from quadriform.files.result_folder import check_results, replaced_together
from quadriform.fitting.result import Fit, flat
from quadriform.imaging.file_points import (
    ReadOptions,
    Source,
    common_space_and_unit,
    has_points,
    kind_of,
    read_source,
    space_to_write,
    without_folders,
)
from quadriform.imaging.fit_files import fit_sources, with_base
from quadriform.imaging.ventricle_files import Heart, read_ventricle
from quadriform.point_sets import ALONE
from quadriform.shapes.landmarks import Landmarks
from quadriform.shapes.record import Estimate, remarks
from quadriform.words import after_number

Record = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """One model to be made.

    Attributes:
        sources: surface name -> file and how to read it.
        folder: for the results.
        space: frame of the world to write in; None is that of the input.
        heart: how the ventricle of the one image is found, or None.
    """

    sources: Mapping[str, tuple[Path, ReadOptions]]
    folder: Path
    space: str | None = None
    heart: Heart | None = None

    def of_heart(self, heart: Heart) -> "Job":
        """The same with the surfaces of a ventricle."""
        source = next(iter(self.sources.values()))
        return replace(self, sources=dict.fromkeys(heart.surfaces, source), heart=heart)

    @property
    def files(self) -> list[Path]:
        """The input files, each once."""
        return list(dict.fromkeys(path for path, _ in self.sources.values()))

    @property
    def name(self) -> str:
        """The inputs as messages show them."""
        return ", ".join(map(str, self.files))

    @property
    def report(self) -> Path:
        """The page."""
        return self.folder / REPORT

    @property
    def targets(self) -> dict[str, Path]:
        """Surface name -> mesh file."""
        return {name: self.folder / surface_file(name, ".ply") for name in self.sources}


# --- which jobs --------------------------------------------------------------------------------------------------


def plan(
    inputs: Sequence[Path], surfaces: Sequence[str], output: Path | None, options: ReadOptions, space: str | None
) -> tuple[list[Job], bool]:
    """The jobs, and whether they are several (a folder always counts as several).

    Raises:
        OptionError: nothing to do, malformed surfaces, or two inputs with one folder for their results.
        InputError: a folder without any file that could be read.
    """
    if surfaces:
        return [replace(_surfaces_job(inputs, surfaces, output, options), space=space)], False
    if not inputs:
        raise OptionError("expected at least one INPUT, or --surface NAME=FILE")
    # a folder of DICOM slices is one image, not a folder of inputs
    folders = {path for path in inputs if path.is_dir() and not kind_of(path)}
    files = [file for path in inputs for file in (_files_in(path) if path in folders else [path])]
    several = len(files) > 1 or bool(folders)
    jobs = []
    for path in files:
        folder = Path(f"{stem(path)}-model") if output is None else output / stem(path) if several else output
        jobs.append(Job({ALONE: (path, options)}, folder, space))
    check_file_names([job.folder for job in jobs], "two inputs")
    return jobs, several


def _files_in(folder: Path) -> list[Path]:
    files = sorted((path for path in folder.iterdir() if path.is_file() and has_points(path)), key=natural)
    if not files:
        raise InputError(f"{str(folder)!r}: the folder holds no points, meshes or images")
    return files


def _surfaces_job(inputs: Sequence[Path], surfaces: Sequence[str], output: Path | None, options: ReadOptions) -> Job:
    sources: dict[str, tuple[Path, ReadOptions]] = {}
    for text in surfaces:
        name, equals, value = text.partition("=")
        surface_file(name, "")  # refuses names that no file can have
        if not equals or not value or name in sources:
            raise OptionError(f"option --surface={text!r}: expected NAME=FILE or NAME=LABEL, each name once")
        chosen = _of_image(text, value, options)
        if chosen is not None and len(inputs) != 1:
            raise OptionError(f"option --surface={text!r}: a label needs exactly one INPUT image, found {len(inputs)}")
        sources[name] = (Path(value), options) if chosen is None else (inputs[0], chosen)
    unused = [path for path in inputs if path not in [file for file, _ in sources.values()]]
    if unused:
        raise OptionError(f"INPUT {str(unused[0])!r} belongs to no --surface; give --surface NAME=LABEL, or omit it")
    first = next(iter(sources.values()))[0]
    job = Job(sources, output or Path(f"{stem(first)}-model"))
    check_file_names(job.targets.values(), "two surfaces")
    return job


def _of_image(text: str, value: str, options: ReadOptions) -> ReadOptions | None:
    """How a surface is read from the one image: label:1+2, preset:acdc, or numbers alone. None for a file."""
    from quadriform.imaging.labels import parse_surface

    if value.startswith(("label:", "preset:")):
        return options.with_surface(parse_surface(text)[1])
    return options.with_label(value) if value.replace(",", "").isdigit() else None


# --- one job -----------------------------------------------------------------------------------------------------


def run_one(job: Job, options: Mapping[str, Any], common: Common) -> None:
    """Do one job and show its record.

    Raises:
        QuadriformError: nothing was written.
    """
    record = _run(job, options, common)
    warn(record["warnings"])
    show(record, common.as_json, _rows(record), job.name)


def run_all(jobs: Sequence[Job], options: Mapping[str, Any], common: Common) -> int:
    """The worst exit code, after every job was done, failed or not, and the closing table was shown."""
    records: list[Record] = []
    for job in jobs:
        try:
            records.append(_run(job, options, common))
            warn(records[-1]["warnings"], job.name)
        except Exception as error:  # one broken input must not stop the others
            code = report_error(error)
            message = " ".join(str(error).split())
            records.append({"input": job.name, "status": "failed", "exit_code": code, "message": message})
    header = ["input", "status", "points", "error RMS", "superquadric alone", "seconds"]
    header += ["cavity volume"] if any("volume_ml" in record for record in records) else []
    lines = [_line(record)[: len(header)] for record in records]
    show(records, common.as_json, lines, f"{len(records)} inputs", header)
    return max(record.get("exit_code", 0) for record in records)


def _run(job: Job, options: Mapping[str, Any], common: Common) -> Record:
    names = [MODEL, *(path.name for path in job.targets.values()), REPORT]
    check_results(job.folder, names, common.force, job.files)
    begin = time.perf_counter()
    with named_in_errors(*job.files):
        sources, landmarks = _read(job, options.get("base"))
        options = with_base(options, None if landmarks is None else landmarks.base)
        assumed = [text for source in sources.values() for text in source.notes]
        for text in dict.fromkeys(assumed):
            note(text)
        found = _fit(job, sources, options, landmarks)
        print_remarks(remarks({}, found.notes, job.name))
        found = replace(found, notes=(*without_folders(assumed, job.files), *found.notes))
        check_strict(common.strict, found.status, found.warnings)
    volumes = {} if job.heart is None else volumes_below(found.model) | supported_volumes(found.support)
    first = next(iter(sources.values()))
    noise = options.get("noise")
    known = known_noise([source.cloud.noise for source in sources.values()], first.unit, noise, first.cloud.factor)
    record = _record(job, found, known, time.perf_counter() - begin) | volumes
    _write(job, found, _page(job, sources, found, record | fit_options(options)), common.force)
    return record


def _read(job: Job, base: Any) -> tuple[dict[str, Source], Landmarks | None]:
    """Points by surface; of a ventricle also where it ends, in the frame of the points."""
    if job.heart is None:
        return {name: read_source(path, options) for name, (path, options) in job.sources.items()}, None
    path, options = next(iter(job.sources.values()))
    found = read_ventricle(path, job.heart, options, base)
    return found.surfaces, found.landmarks


def _write(job: Job, found: Fit, page: bytes, force: bool) -> None:
    with replaced_together(job.folder, MODEL, force, earlier_results(job.folder) if force else ()) as folder:
        save(found.model, folder / MODEL)
        for name, path in job.targets.items():
            mesh, metadata = found.model.mesh(name), found.model.record.metadata
            write_mesh(mesh, folder / path.name, found.model.space, found.model.unit, more=metadata)
        write_bytes(folder / REPORT, page)


def _page(job: Job, sources: Mapping[str, Source], found: Fit, record: Record) -> bytes:
    clouds = {name: source.cloud.points for name, source in sources.items()}
    first = next(iter(sources.values()))
    image = first.image if len(job.files) == 1 else None
    title = ", ".join(path.name for path in job.files)
    return page_of_fit(found, clouds, image, first.space, title, record)


def _fit(job: Job, sources: Mapping[str, Source], options: Mapping[str, Any], landmarks: Landmarks | None) -> Fit:
    space = space_to_write(job.space, common_space_and_unit(sources)[0])
    with progress_bar(job.name) as progress:
        found = fit_sources(job.sources, sources, {**options, "progress": progress})
    model = found.model if landmarks is None else replace(found.model, landmarks=landmarks)
    return replace(found, model=model.in_space(space))


# --- records -----------------------------------------------------------------------------------------------------


def _record(job: Job, found: Fit, known: str, seconds: float) -> Record:
    # percentiles of distances, without the side on which a point lies
    distances = np.abs(flat(found.residuals))
    return {
        "input": job.name,
        "status": found.status,
        "outputs": [str(path) for path in (job.folder / MODEL, *job.targets.values(), job.report)],
        "points": found.n_points,
        "parameters": found.model.n_parameters,
        "compression_ratio": found.compression_ratio,
        "space": found.model.space,
        "unit": found.model.unit,
        "error": {"rms": found.rms, "p95": float(np.percentile(distances, 95)), "max": float(distances.max())},
        "superquadric_rms": found.superquadric_rms,
        "noise": found.noise,
        "known_noise": known,
        "strength": found.strength,
        **({} if found.prior_distance is None else {"prior_distance": found.prior_distance}),
        "supported": found.model.record.supported,
        "extends_beyond": found.model.record.extends_beyond,
        "estimates": {n: asdict(e) | {"observed": e.observed} for n, e in found.model.record.estimates.items()},
        "inliers": int((flat(found.inliers) >= 0.5).sum()),
        "min_jacobian": found.model.min_jacobian(),
        "iterations": found.iterations,
        "seconds": round(seconds, 3),
        "warnings": texts(found.warnings),
        "notes": list(found.notes),
    }


def _rows(record: Record) -> list[tuple[str, str]]:
    unit = after_number(record["unit"])
    error, inliers = record["error"], record["inliers"]
    return [
        ("points", str(record["points"])),
        *([("inliers", str(inliers))] if inliers < record["points"] else []),
        ("parameters", str(record["parameters"])),
        ("compression ratio", f"{record['compression_ratio']:.1f}"),
        ("error RMS", f"{error['rms']:.4g}{unit}"),
        ("error 95 %", f"{error['p95']:.4g}{unit}"),
        ("error max", f"{error['max']:.4g}{unit}"),
        ("supported by data", _by_surface(record["supported"], lambda part: f"{100 * part:.0f} % of the area")),
        ("reach beyond the data", _by_surface(record["extends_beyond"], lambda far: f"{far:.3g}{unit}")),
        *(volume_rows(record) or _estimate_rows(record["estimates"])),
        ("superquadric alone RMS", f"{record['superquadric_rms']:.4g}{unit}"),
        ("noise", f"{record['noise']:.4g}{unit}"),
        ("known noise", record["known_noise"]),
        ("strength", f"{record['strength']:.3g}"),
        *([("distance to the prior", f"{record['prior_distance']:.3g}")] if "prior_distance" in record else []),
        ("min det J", f"{record['min_jacobian']:.3g}"),
        ("iterations", str(record["iterations"])),
        ("time", f"{record['seconds']:.2f} s"),
        ("frame, unit", f"{record['space']}, {record['unit']}"),
        *closing_rows(record),
    ]


def _by_surface(values: Mapping[str, float], text: Callable[[float], str]) -> str:
    """Numbers as lines, with the name of the surface where there are several."""
    return "\n".join(f"{name}: {text(value)}" if len(values) > 1 else text(value) for name, value in values.items())


def _estimate_rows(estimates: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Volumes and areas with the share of them that is extrapolated."""
    return [(n, str(Estimate(e["value"], e["unit"], e["supported"], e["sd"]))) for n, e in estimates.items()]


def _line(record: Record) -> tuple[str, ...]:
    """The cells of a closing table; the last one is that of a ventricle."""
    if record["status"] == "failed":
        return (Path(record["input"]).name, f"failed ({record['exit_code']})", "", "", "", "", "")
    unit = after_number(record["unit"])
    errors = (f"{rms:.4g}{unit}" for rms in (record["error"]["rms"], record["superquadric_rms"]))
    cavity = f"{record['volume_ml']:.4g} ml" if "volume_ml" in record else ""
    name, seconds = Path(record["input"]).name, f"{record['seconds']:.2f}"
    return (name, record["status"], str(record["points"]), *errors, seconds, cavity)
