"""Figs. 3, 6 to 9: from points to the superellipsoid to the final model, and from fewer points."""

import numpy as np
from matplotlib.figure import Figure

from quadriform.fitting.outcome import Fit, rms
from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, Remake, Row, beside, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import Reduced, Subject

METHODS = ('method="paper"', "default")
COLOURS = (drawing.BY_PAPER, drawing.BY_DEFAULT)


def crossing_superquadrics(results: Results) -> Remake:
    """Fig. 3."""
    subject = results.crossing
    figure, places = drawing.scene(3)
    drawing.look_at(places, subject.cloud)
    drawing.draw_cloud(places[0], subject.cloud)
    places[0].set_title(f"{len(subject.cloud)} points", fontsize=9)
    for axes, fit, name, colour in zip(places[1:], subject.fits, METHODS, COLOURS):
        drawing.draw_mesh(axes, fit.model.superquadric().mesh(drawing.RESOLUTION), colour)
        axes.set_title(f"superellipsoid, {name}", fontsize=9)
    words = f"The {subject.name}, and the superellipsoid that each method starts from."
    errors = [fit.superquadric_rms for fit in subject.fits]
    return Remake(
        "Fig. 3",
        "a superellipsoid for three crossing ones",
        "p. 42",
        "a superellipsoid fitted to three crossing tapered superquadrics is a rough estimate that has to be refined.",
        [shown(drawing.picture(figure, words), words, subject.source)],
        [_row("error RMS of the superellipsoid", errors)],
        f"rough it is: {_share(errors[0], subject)} of the cloud's RMS radius. The default's is "
        f"{beside(errors[1], errors[0])}: it is the start of the refinement, chosen among several.",
    )


def _share(error: float, subject: Subject) -> str:
    radius = np.linalg.norm(subject.cloud - subject.cloud.mean(axis=0), axis=1)
    return f"{error / rms(radius):.1%}"


def _row(name: str, errors: list[float]) -> Row:
    return name, NONE, mm(errors[0]), mm(errors[1])


def synthetic_example(results: Results) -> Remake:
    """Fig. 6."""
    return _from_start_to_end(results.crossing, "Fig. 6", "synthetic", "; synthetic data.")


def medical_example(results: Results) -> Remake:
    """Fig. 7."""
    claim = "; a medical image. Clouds have 5,000 to 20,000 points, models 40 to 150 times fewer numbers."
    return _from_start_to_end(results.first.subject, "Fig. 7", "medical", claim)


def _from_start_to_end(subject: Subject, name: str, kind: str, claim: str) -> Remake:
    errors = [[fit.superquadric_rms for fit in subject.fits], [fit.rms for fit in subject.fits]]
    shares = [f"{end / start:.0%}" for start, end in zip(*errors)]
    words = f"The {subject.name}: points; superellipsoid and box; displacements; final model."
    return Remake(
        name,
        f"from the superellipsoid to the model, {kind}",
        "p. 45",
        f"points, the superellipsoid in its box, the displacements between them, and the final model{claim}",
        [shown(drawing.picture(_four_steps(subject), words), words, subject.source)],
        [
            _row("error RMS of the superellipsoid", errors[0]),
            _row("error RMS of the model", errors[1]),
            ("what the refinement leaves of it", NONE, *shares),
            ("numbers in the model", "11 + 375", *(f"{fit.model.n_parameters}" for fit in subject.fits)),
            ("compression ratio", "40 to 150", *(f"{fit.compression_ratio:.1f}" for fit in subject.fits)),
            ("status", NONE, *(_status(fit) for fit in subject.fits)),
        ],
        f"both models have equally many numbers; the default's error is {beside(errors[1][1], errors[1][0])}. "
        + subject.note,
    )


def _status(fit: Fit) -> str:
    return ", ".join(fit.warnings) or "ok"


def _four_steps(subject: Subject) -> Figure:
    figure, places = drawing.scene(4, 2, 2.5)
    drawing.look_at(places, np.concatenate([subject.cloud, *(_start(subject, fit) for fit in subject.fits)]))
    for row, fit, name, colour in zip((places[:4], places[4:]), subject.fits, METHODS, COLOURS):
        start, model = fit.model.superquadric(subject.surface), fit.model
        drawing.draw_cloud(row[0], subject.cloud)
        drawing.draw_mesh(row[1], start.mesh(drawing.RESOLUTION), colour, 0.5)
        drawing.draw_box(row[1], model.box.with_control_points(model.box.rest))
        drawing.look_at(row[1:2], model.box.rest.reshape(-1, 3), 1.0)
        _draw_displacements(row[2], subject, fit, before=True)
        drawing.draw_mesh(row[3], model.mesh(subject.surface, drawing.RESOLUTION), colour)
        for axes, title in zip(row, ("points", "superellipsoid", "displacements", "model")):
            axes.set_title(f"{title}, {name}" if axes is not row[0] else title, fontsize=8)
    return figure


def _start(subject: Subject, fit: Fit) -> np.ndarray:
    return fit.model.superquadric(subject.surface).grid(drawing.RESOLUTION)[0]


def _draw_displacements(axes: object, subject: Subject, fit: Fit, before: bool) -> None:
    """From the closest points of the surface, before or after the deformation, to the data."""
    model = fit.model
    rest = type(model)(model.surfaces, model.box.with_control_points(model.box.rest))
    some = subject.cloud[:: -(-len(subject.cloud) // 500)]
    feet = (rest if before else model).closest(some, subject.surface)
    drawing.draw_arrows(axes, feet, some - feet)


def displacement_fields(results: Results) -> Remake:
    """Fig. 8."""
    subject = results.crossing
    figure, places = drawing.scene(4, width=2.7)
    drawing.look_at(places, subject.cloud)
    for axes, (fit, name, before) in zip(
        places, ((fit, name, before) for fit, name in zip(subject.fits, METHODS) for before in (True, False))
    ):
        _draw_displacements(axes, subject, fit, before)
        axes.set_title(f"{'before' if before else 'after'}, {name}", fontsize=9)
    words = f"The {subject.name}: displacements from the surface to the points, before and after the deformation."
    largest = [float(np.abs(fit.residuals).max()) for fit in subject.fits]  # type: ignore[arg-type]
    errors = [fit.rms for fit in subject.fits]
    return Remake(
        "Fig. 8",
        "displacements before and after",
        "p. 45",
        "the displacements between superellipsoid and data, and between data and final model; a box of 5 x 5 x 5.",
        [shown(drawing.picture(figure, words), words, subject.source)],
        [
            _row("RMS before", [fit.superquadric_rms for fit in subject.fits]),
            _row("RMS after", errors),
            _row("longest after", largest),
        ],
        f"both shorten them; the default leaves an RMS {beside(errors[1], errors[0])}.",
    )


def sparse_data(results: Results) -> Remake:
    """Fig. 9."""
    reduced = results.ventricle
    rows: list[Row] = []
    for part, size in ((reduced.planes, "600 of 6,000"), (reduced.part, "900 of 6,000")):
        count, name = len(part.cloud), part.name
        rows.append((f"points, {name}", size, *[f"{count} of {len(reduced.whole.cloud)}"] * 2))
        rows.append(_row(f"RMS to the model of all points, {name}", [_apart(reduced, part, k) for k in (0, 1)]))
    extra = ""
    if results.human is not None:
        rows.append(_row(f"RMS of {len(results.human.cloud)} points of a real heart", _errors(results.human)))
        extra = " Of the real contours nobody has the complete surface, so their own error alone is given."
    flat, thin = ([_apart(reduced, p, k) for k in (0, 1)] for p in (reduced.planes, reduced.part))
    words = f"Sparse points of the {reduced.whole.name}, 100 mm long with noise of 0.5 mm, and both models."
    pictures = [shown(drawing.picture(_sparse(reduced), words), words, reduced.whole.source)]
    if results.human is not None:
        words = "Real sparse data: contours in a few planes, and both models."
        pictures.append(shown(drawing.picture(_row_of(results.human), words), words, results.human.source))
    return Remake(
        "Fig. 9",
        "from sparse data",
        "p. 46",
        "a shape similar to that of the complete data comes out of three orthogonal planes and out of a subsample.",
        pictures,
        rows,
        f"similar, measured here: to the model of all points the default's distance is {beside(flat[1], flat[0])} "
        f"from three planes, and {beside(thin[1], thin[0])} from the subsample.{extra}",
    )


def _errors(subject: Subject) -> list[float]:
    return [fit.rms for fit in subject.fits]


def _apart(reduced: Reduced, part: Subject, method: int) -> float:
    """RMS distance in mm from the surface of the complete data to that of a part, by the same method."""
    return rms(part.fits[method].model.distance(reduced.whole.fits[method].model.mesh(resolution=20).vertices))


def _sparse(reduced: Reduced) -> Figure:
    figure, places = drawing.scene(4, 2, 2.5)
    drawing.look_at(places, reduced.whole.cloud)
    _draw_row(places[:4], reduced.planes)
    _draw_row(places[4:], reduced.part)
    for axes in (places[3], places[7]):
        drawing.draw_mesh(axes, reduced.whole.default.model.mesh(resolution=drawing.RESOLUTION), drawing.ORANGE)
        axes.set_title(f"all {len(reduced.whole.cloud)} points, default", fontsize=8)
    return figure


def _row_of(subject: Subject) -> Figure:
    figure, places = drawing.scene(3)
    drawing.look_at(places, subject.cloud)
    _draw_row(places, subject)
    return figure


def _draw_row(places: list, subject: Subject) -> None:
    drawing.draw_cloud(places[0], subject.cloud, size=4)
    places[0].set_title(f"{len(subject.cloud)} points", fontsize=8)
    for axes, fit, name, colour in zip(places[1:], subject.fits, METHODS, COLOURS):
        drawing.draw_mesh(axes, fit.model.mesh(subject.surface, drawing.RESOLUTION), colour)
        axes.set_title(f"model, {name}", fontsize=8)
