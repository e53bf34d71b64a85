"""Figs. 19 to 22: isosurfaces beside models, how much smaller the models are, and how the iterations went."""

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, Remake, Row, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import Scan, Subject
from quadriform.report.parts import svg

VIEWS = ((18, -58), (18, 32), (80, -58))
"""Elevation and azimuth, degrees."""


def first_surface(results: Results) -> Remake:
    """Fig. 19."""
    scans = [results.brain] if results.first is results.brain else [results.brain, results.first]
    claim = "isosurface of 6,000 points beside the model of 130 points, three views; compression ratio 46."
    return _surface("Fig. 19", "p. 50", claim, "46", scans, 3)


def second_surface(results: Results) -> Remake:
    """Fig. 20."""
    claim = "isosurface of 1,000 points beside the model of 130 points; compression ratio 7.7."
    return _surface("Fig. 20", "p. 50", claim, "7.7", [results.second], 1)


def third_surface(results: Results) -> Remake:
    """Fig. 21."""
    claim = (
        "isosurface of the endocardium, 10,000 points, beside the model of 130 points, two views; compression ratio 77, "
        "and 154 when one box carries endocardium and epicardium (p. 48; there the image is said to have 20,000 points)."
    )
    return _surface("Fig. 21", "p. 51", claim, "77; both walls in one box 154", [results.third], 2)


def _surface(name: str, page: str, claim: str, ratio: str, scans: list[Scan], views: int) -> Remake:
    scan = scans[-1]
    subject = scan.subject
    rows: list[Row] = [
        ("points of the isosurface", NONE, *[f"{_vertices(scan):,}"] * 2),
        ("numbers in the model", "386", *(f"{fit.model.n_parameters}" for fit in subject.fits)),
        ("compression ratio of the isosurface", ratio, *(f"{_ratio(scan, n):.1f}" for n in _numbers(subject))),
        ("compression ratio of the points that were fitted", NONE, *(f"{f.compression_ratio:.1f}" for f in subject.fits)),
        ("error RMS at that ratio", NONE, *(mm(fit.rms) for fit in subject.fits)),
    ]
    return Remake(
        name,
        "isosurface and model",
        page,
        claim,
        [_beside(scan, views) for scan in scans],
        rows,
        "the ratio is arithmetic and the same for both methods: three numbers a point over the numbers of the model. The "
        "paper counts 130 points for its model, which are 386 numbers, or 128.7 points. What differs is the error.",
    )


def _numbers(subject: Subject) -> list[int]:
    return [fit.model.n_parameters for fit in subject.fits]


def _vertices(scan: Scan) -> int:
    """Points of the isosurfaces that the model stands for."""
    if len(scan.subject.points) == 1:
        return scan.vertices
    return sum(len(mesh.vertices) for mesh in scan.outlines.values())


def _ratio(scan: Scan, numbers: int) -> float:
    return 3 * _vertices(scan) / numbers


def _beside(scan: Scan, views: int) -> Markup:
    subject = scan.subject
    figure, places = drawing.scene(3, views, 2.7)
    drawing.look_at(places, subject.cloud)
    for row, (up, around) in enumerate(VIEWS[:views]):
        one, two, three = places[3 * row : 3 * row + 3]
        name = subject.surface if subject.surface in scan.outlines else next(iter(scan.outlines))
        drawing.draw_mesh(one, scan.outlines[name], drawing.ORANGE)
        for axes, fit, colour in zip((two, three), subject.fits, (drawing.BY_PAPER, drawing.BY_DEFAULT)):
            drawing.draw_mesh(axes, fit.model.mesh(subject.surface, drawing.RESOLUTION), colour)
        for axes in (one, two, three):
            axes.view_init(elev=up, azim=around)
    for axes, title in zip(places, ("isosurface", 'model, method="paper"', "model, default")):
        axes.set_title(title, fontsize=9)
    words = f"{subject.name}: isosurface and both models."
    return shown(drawing.picture(figure, words), words, subject.source)


def iterations(results: Results) -> Remake:
    """Fig. 22."""
    subjects = _four(results)
    figure = Figure(figsize=(10, 5.6))
    places = figure.subplots(2, 2)
    for row, method in zip(places, ("paper", "default")):
        for axes, quantity, label in zip(row, ("error", "box_motion"), ("error RMS, mm", "motion of the box RMS, mm")):
            for subject, colour in zip(subjects, (*drawing.COLOURS, drawing.GREY)):
                history = getattr(subject, method).history
                steps = np.arange(1, len(history) + 1)
                axes.semilogy(steps, [getattr(h, quantity) for h in history], color=colour, label=subject.name)
            axes.set(xlabel="iteration", ylabel=label, title=f"{label.split(' RMS')[0]}, {_method(method)}")
            axes.grid(alpha=0.3)
    places[0, 0].legend(fontsize=7)
    figure.tight_layout()
    words = "Error and motion of the box of control points in each iteration, four sets of data."
    sources = "; ".join(dict.fromkeys(subject.source for subject in subjects))
    rows = [
        (f"error RMS, first to last iteration, {subject.name}", NONE, *(_fall(subject, method) for method in METHODS))
        for subject in subjects
    ]
    return Remake(
        "Fig. 22",
        "error and motion against the iteration",
        "p. 51",
        "for four models the error and the motion of the box fall quickly and level off; 30 iterations (p. 48).",
        [shown(svg(figure, words), words, sources)],
        rows,
        "the paper's method falls as in the paper, and is not at rest after its 30 iterations: "
        f"the box still moves by {_listed(subjects)} mm a turn. The default's record holds several starts and finer and "
        "finer boxes one after the other, so its curves jump.",
    )


METHODS = ("paper", "default")


def _method(name: str) -> str:
    return 'method="paper"' if name == "paper" else name


def _fall(subject: Subject, method: str) -> str:
    history = getattr(subject, method).history
    return f"{history[0].error:.3g} to {history[-1].error:.3g} mm in {len(history)}"


def _listed(subjects: list[Subject]) -> str:
    return ", ".join(f"{subject.paper.history[-1].box_motion:.2g}" for subject in subjects)


def _four(results: Results) -> list[Subject]:
    return [results.crossing, results.first.subject, results.second.subject, results.third.subject]
