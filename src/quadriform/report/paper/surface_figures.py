"""Figs. 19 to 22: isosurfaces beside models, how much smaller the models are, and how the iterations went."""

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, Remake, Row, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import Scan, Subject
from quadriform.report.parts import svg
from quadriform.report.slices import COLOURS as SLICE_COLOURS

VIEWS = ((18, -58), (18, 32), (80, -58))
"""Elevation and azimuth, degrees."""
COLOURS = (drawing.ORANGE, drawing.BY_PAPER, drawing.BY_DEFAULT)
ALONE_NUMBERS = 386
"""Of a model of one surface with 5 x 5 x 5 control points."""


def first_surface(results: Results) -> Remake:
    """Fig. 19."""
    scans = [results.brain] if results.first is results.brain else [results.brain, results.first]
    claim = "isosurface of 6,000 points beside the model of 130 points, three views; compression ratio 46."
    return _surface("Fig. 19", "p. 50", claim, ("6,000", "46"), scans, 3)


def second_surface(results: Results) -> Remake:
    """Fig. 20."""
    claim = "isosurface of 1,000 points beside the model of 130 points; compression ratio 7.7."
    return _surface("Fig. 20", "p. 50", claim, ("1,000", "7.7"), [results.second], 1)


def third_surface(results: Results) -> Remake:
    """Fig. 21."""
    claim = (
        "isosurface of the endocardium, 10,000 points, beside the model of 130 points, two views; compression ratio "
        "77. Both walls have 20,000 points, and one box for both has a ratio of 154 (p. 48)."
    )
    return _surface("Fig. 21", "p. 51", claim, ("20,000", "154"), [results.third], 2)


def _surface(name: str, page: str, claim: str, said: tuple[str, str], scans: list[Scan], views: int) -> Remake:
    """The last of the scans stands in the place of the paper's."""
    nothing = (NONE, NONE)
    return Remake(
        name,
        f"isosurface and model, {scans[-1].subject.name}",
        page,
        claim,
        [_beside(scan, views) for scan in scans],
        [row for scan in scans for row in _rows(scan, said if scan is scans[-1] else nothing)],
        "the ratio is arithmetic and the same for both methods: three numbers a point over the numbers of the model. "
        "The paper counts 130 points for its model; its numbers are 386, or 128.7 points. What differs is the error. "
        + scans[-1].subject.note,
    )


def _rows(scan: Scan, said: tuple[str, str]) -> list[Row]:
    name, fits, count = scan.subject.name, scan.subject.fits, sum(scan.vertices.values())
    rows: list[Row] = [
        (f"points of the isosurface, {name}", said[0], *[f"{count:,}"] * 2),
        (f"compression ratio, {name}", said[1], *(f"{3 * count / fit.model.n_parameters:.1f}" for fit in fits)),
    ]
    if len(scan.vertices) > 1:
        one = f"{3 * scan.vertices[scan.subject.surface] / ALONE_NUMBERS:.1f}"
        rows.append((f"the same for {scan.subject.surface} in a box of its own, by count", "77", one, one))
    if count != fits[0].n_points:
        rows.append(
            ("the same of the points that were fitted", NONE, *(f"{fit.compression_ratio:.1f}" for fit in fits))
        )
    return [*rows, (f"error RMS at that ratio, {name}", NONE, *(mm(fit.rms) for fit in fits))]


def _beside(scan: Scan, views: int) -> Markup:
    subject = scan.subject
    figure, places = drawing.scene(3, views, 2.7)
    models = [fit.model.mesh(subject.surface, drawing.RESOLUTION) for fit in subject.fits]
    name = subject.surface if subject.surface in scan.outlines else next(iter(scan.outlines))
    meshes = [scan.outlines[name], *models]
    drawing.look_at(places, np.concatenate([mesh.vertices for mesh in meshes]))
    for row, (up, around) in enumerate(VIEWS[:views]):
        for axes, mesh, colour in zip(places[3 * row :], meshes, COLOURS):
            drawing.draw_mesh(axes, mesh, colour)
            axes.view_init(elev=up, azim=around)
    for axes, title in zip(places, ("isosurface", 'model, method="paper"', "model, default")):
        axes.set_title(title, fontsize=9)
    words = f"The {subject.name}: isosurface and both models."
    return shown(drawing.picture(figure, words), words, subject.source)


def iterations(results: Results) -> Remake:
    """Fig. 22."""
    subjects = _four(results)
    figure = Figure(figsize=(10, 6))
    places = figure.subplots(2, 2)
    for row, method in zip(places, METHODS):
        for axes, quantity, label in zip(row, ("error", "box_motion"), ("error RMS, mm", "motion of the box RMS, mm")):
            _draw_histories(axes, subjects, method, quantity)
            axes.set(xlabel="iteration", ylabel=label, title=METHODS[method])
    figure.legend(*places[0, 0].get_legend_handles_labels(), loc="upper center", ncols=4, frameon=False, fontsize=8)
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    words = "Error and motion of the box of control points in each iteration, four sets of data."
    sources = "; ".join(dict.fromkeys(subject.source for subject in subjects))
    rows = [
        (f"error RMS, first to last iteration, {subject.name}", NONE, *(_fall(subject, method) for method in METHODS))
        for subject in subjects
    ]
    left = ", ".join(f"{subject.paper.history[-1].box_motion:.2g}" for subject in subjects)
    return Remake(
        "Fig. 22",
        "error and motion against the iteration",
        "p. 51",
        "the error and the motion of the box against the iteration, a curve for each of four sets of data, no table; "
        "30 iterations (p. 48).",
        [shown(svg(figure, words), words, sources)],
        rows,
        f"after the last iteration of the paper's method the box still moves by {left} mm a turn. The error of the "
        "default is the noise that it finds. It goes from few control points and few data to all of them, and presses "
        "folds out after that; its curves jump where a stage begins.",
    )


METHODS = {"paper": 'method="paper"', "default": "default"}
"""From the attribute of a subject to how the page calls the method."""


def _draw_histories(axes: Axes, subjects: list[Subject], method: str, quantity: str) -> None:
    for subject, colour in zip(subjects, SLICE_COLOURS):
        history = getattr(subject, method).history
        values = [getattr(record, quantity) for record in history]
        axes.semilogy(np.arange(1, len(history) + 1), values, color=colour, label=subject.name)
    axes.grid(alpha=0.3)
    drawing.plain(axes)


def _fall(subject: Subject, method: str) -> str:
    history = getattr(subject, method).history
    return f"{history[0].error:.3g} to {history[-1].error:.3g} mm in {len(history)}"


def _four(results: Results) -> list[Subject]:
    return [results.crossing, results.first.subject, results.second.subject, results.third.subject]
