"""What a report on any model says: summary, errors, convergence, parameters, methods, configuration."""

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.fitting.result import Iteration
from quadriform.motion.slice_move import SliceMove
from quadriform.points import Array
from quadriform.report import charts
from quadriform.report.page import Section, rendered, report_text
from quadriform.report.parts import figure, table
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import Remark

HERE = ("input", "outputs", "seconds")
LIBRARIES = ("numpy", "scipy")
Clouds = Mapping[str, Array]


def summary(sentence: str, status: str, remarks: Sequence[Remark]) -> Section:
    """The result in a sentence, with status, warnings and notes; it stands before any picture.

    Args:
        sentence: the result.
        status: "ok", "warned", "unreliable" or "unknown".
        remarks: warnings and notes.
    """
    return Section("Summary", rendered("summary.html.j2", sentence=sentence, status=status, remarks=remarks))


def errors(residuals: Clouds, before: Clouds | None, unit: str, voxel: float | None) -> Section:
    """A table and a histogram of the distances of the data points.

    Args:
        residuals: surface -> signed distances (n,) to the model.
        before: the same to the superquadric alone, or None.
        unit: of the distances.
        voxel: longest side of the image's voxels, or None.
    """
    rows = [_error_row(name, values, unit, voxel) for name, values in residuals.items()]
    if len(residuals) > 1:
        rows.append(_error_row("all", np.concatenate(list(residuals.values())), unit, voxel))
    if before is not None:
        rows.append(_error_row("superquadric alone, all", np.concatenate(list(before.values())), unit, voxel))
    header = ["surface", "points", f"RMS {unit}", f"median {unit}", f"95 % {unit}", f"largest {unit}"]
    header += ["RMS in voxels"] if voxel is not None else []
    body = table(header, rows) + figure(charts.histogram(residuals, unit, voxel), report_text("captions", "errors"))
    return Section("Errors", body)


def _error_row(name: str, residuals: Array, unit: str, voxel: float | None) -> list[str]:
    # a median of signed distances would be near zero whatever the error
    away = np.abs(residuals)
    rms = float(np.sqrt((away**2).mean()))
    numbers = [rms, float(np.median(away)), float(np.percentile(away, 95)), float(away.max())]
    return [
        name,
        str(len(away)),
        *(f"{n:.4g}" for n in numbers),
        *([f"{rms / voxel:.3g}"] if voxel is not None else []),
    ]


def convergence(history: Sequence[Iteration], unit: str) -> Section:
    """The convergence of the fit as a chart."""
    return Section("Convergence", figure(charts.convergence(history, unit), report_text("captions", "convergence")))


def parameters(model: DeformableModel | MovingModel, n_points: int | None) -> Section:
    """The parameters of the model, their number and the compression ratio."""
    unit = model.unit.replace("unknown", "units")
    shape = model.control_points.shape if isinstance(model, MovingModel) else model.box.control_points.shape
    rows = [["parameters", str(model.n_parameters)], ["control points", " x ".join(map(str, shape[:-1]))]]
    if n_points is not None:
        rows.append(["data points", str(n_points)])
        rows.append(["compression ratio, 3 n / parameters", f"{3 * n_points / model.n_parameters:.1f}"])
    rows.append(["frame, unit", f"{model.space}, {model.unit}"])
    surfaces = [
        [
            name,
            s.kind,
            " ".join(f"{a:.4g}" for a in s.semi_axes),
            " ".join(f"{e:.3g}" for e in s.exponents),
            " ".join(f"{t:.4g}" for t in s.translation),
        ]
        for name, s in model.surfaces.items()
    ]
    header = ["superquadric", "kind", f"semi-axes {unit}", "exponents", f"centre {unit}"]
    return Section("Parameters", table((), rows) + table(header, surfaces))


def slice_motions(moves: Mapping[int, SliceMove], unit: str) -> list[Section]:
    """The motion of each slice with its standard deviations along the axes of the slice; nothing without motions."""
    rows = []
    for number, move in moves.items():
        sizes = f"{np.linalg.norm(move.shift):.3g}", f"{np.degrees(np.linalg.norm(move.rotation)):.3g}"
        deviations = (" ".join(f"{each:.2g}" for each in part) for part in (move.sd[3:], np.degrees(move.sd[:3])))
        rows.append([str(number), *sizes, *deviations])
    axes = "along the axes of the slice, its normal last"
    header = ["slice", f"shift {unit}", "rotation degrees", f"sd of the shift {axes}", "sd of the rotation"]
    return [Section("Motions of slices", table(header, rows))] if rows else []


def description(text: str) -> Section:
    """A paragraph on the method for a publication: what was done, with versions and citation."""
    used = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    whole = report_text("methods", "paper", text=text, version=version("quadriform"), used=used)
    return Section("Description of the method", Markup('<p class="description">{}</p>').format(whole))


def configuration(record: Mapping[str, Any]) -> Section:
    """All that was in effect, options and results, as JSON can hold them.

    Folders of this machine and the time that it took are left out: they are private, and the same input gives the same
    page.
    """
    kept = {name: value for name, value in record.items() if name not in HERE}
    return Section("Configuration and record", Markup("<pre>{}</pre>").format(json.dumps(kept, indent=1, default=str)))
