"""Figs. 3 and 6 to 9: from points to the superellipsoid to the final model, and from fewer points."""

import numpy as np

from quadriform.fitting.result import rms
from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.drawing import Tile
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, Remake, Row, beside, in_mm, listed, mm, shown, similar, warnings
from quadriform.report.paper.subjects import Sparse, Subject, before, displacement_field
from quadriform.report.parts import tiles

METHODS = ('method="paper"', "default")
MODELS = ("paper's model", "default's model")
COLOURS = (drawing.BY_PAPER, drawing.BY_DEFAULT)

STEPS = ("superellipsoid and box", "displacement field", "final model")
WHEN = ("superellipsoid to data", "final model to data")


def crossing_superquadrics(material: Material) -> Remake:
    """Fig. 3."""
    subject = material.crossing
    count = f"{len(subject.cloud):,} points"
    pictures = [drawing.in_space(count, subject.cloud, drawing.cloud(subject.cloud))]
    for fit, name, colour in zip(subject.fits, METHODS, COLOURS):
        mesh = drawing.mesh(fit.model.superquadric().mesh(drawing.RESOLUTION), colour)
        pictures.append(drawing.in_space(f"superellipsoid, {name}", subject.cloud, mesh))
    errors = [fit.superquadric_rms for fit in subject.fits]
    radius = np.linalg.norm(subject.cloud - subject.cloud.mean(axis=0), axis=1)
    words: dict[str, object] = {
        "paper": mm(errors[0]),
        "default": mm(errors[1]),
        "part": errors[0] / rms(radius),
        "compared": beside(errors[1], errors[0]),
    }
    picture = shown("3", tiles(pictures), subject.source, subject=subject.name)
    return Remake("3", words, [picture], [in_mm("error RMS of the superellipsoid", errors)])


def from_start_to_end(key: str, subject: Subject) -> Remake:
    """Figs. 6 and 7."""
    errors = [[fit.superquadric_rms for fit in subject.fits], [fit.rms for fit in subject.fits]]
    ratios = [f"{end / start:.0%}" for start, end in zip(*errors)]
    return Remake(
        key,
        {"ratios": ratios, "compared": beside(errors[1][1], errors[1][0]), "note": subject.note},
        [shown(key, tiles(_four_steps(subject)), subject.source, subject=subject.name)],
        [
            in_mm("error RMS of the superellipsoid", errors[0]),
            in_mm("error RMS of the model", errors[1]),
            ("error after refinement, relative to before", NONE, *ratios),
            ("parameters of the model", "11 + 375", *(f"{fit.model.n_parameters}" for fit in subject.fits)),
            ("compression ratio", "40 to 150", *(f"{fit.compression_ratio:.1f}" for fit in subject.fits)),
            warnings("", subject.fits),
        ],
    )


def _four_steps(subject: Subject) -> list[Tile]:
    starts = [before(fit.model) for fit in subject.fits]
    # one window for both methods, so that their pictures can be compared
    around = np.concatenate([subject.cloud, *(start.mesh(subject.surface, 8).vertices for start in starts)])
    pictures = [drawing.in_space("points", around, drawing.cloud(subject.cloud))]
    for fit, start, name, colour in zip(subject.fits, starts, METHODS, COLOURS):
        mesh = start.mesh(subject.surface, drawing.RESOLUTION)
        final = fit.model.mesh(subject.surface, drawing.RESOLUTION)
        # boxes reach farther than surfaces; the fields beside them would be small in the same window
        corners = np.concatenate([start.box.control_points.reshape(-1, 3), around])
        in_box = (drawing.mesh(mesh, colour, 0.5), drawing.box(start.box))
        steps = displacement_field(start, subject.cloud, subject.surface)
        first, field, last = (f"{what}, {name}" for what in STEPS)
        pictures += [
            drawing.in_space(first, corners, *in_box, zoom=0.9),
            drawing.in_space(field, around, drawing.arrows(*steps)),
            drawing.in_space(last, around, drawing.mesh(final, colour)),
        ]
    return pictures


def displacement_fields(material: Material) -> Remake:
    """Fig. 8."""
    subject = material.crossing
    pictures: list[Tile] = []
    lengths: list[list[Array]] = []
    for fit, name in zip(subject.fits, METHODS):
        both = []
        for model, when in ((before(fit.model), "superellipsoid"), (fit.model, "final model")):
            at, steps = displacement_field(model, subject.cloud, subject.surface)
            both.append(np.linalg.norm(steps, axis=1))
            pictures.append(drawing.in_space(f"{when} to data, {name}", subject.cloud, drawing.arrows(at, steps)))
        lengths.append(both)
    count = len(lengths[0][0])
    rows = [in_mm(f"displacement RMS, {when}", [rms(both[k]) for both in lengths]) for k, when in enumerate(WHEN)]
    rows += [in_mm(f"longest displacement, {when}", [b[k].max() for b in lengths]) for k, when in enumerate(WHEN)]
    ratios = [rms(both[1]) / rms(both[0]) for both in lengths]
    words = {"count": count, "ratios": ratios, "iterations": subject.paper.iterations}
    return Remake("8", words, [shown("8", tiles(pictures), subject.source, count=count)], rows)


def sparse_data(material: Material) -> Remake:
    """Fig. 9."""
    sets = [sparse for sparse in (material.sparse, material.sparse_heart) if sparse is not None]
    pictures = [
        shown("9", tiles(_sparse_pictures(each), "thirds"), each.whole.source, subject=each.whole.name) for each in sets
    ]
    words: dict[str, object] = {
        "compared": " ".join(_sparse_comparison(sparse) for sparse in sets),
        "missing": "" if material.real else " No real heart was given, so there is no medical example here.",
    }
    return Remake("9", words, pictures, [row for sparse in sets for row in _sparse_rows(sparse)])


def _sparse_rows(sparse: Sparse) -> list[Row]:
    whole = sparse.whole
    rows: list[Row] = []
    for part, stated in zip(sparse.parts, ("600 of 6,000", "900 of 6,000")):
        count = f"{len(part.cloud):,} of {len(whole.cloud):,}"
        rows.append((f"points, {whole.name}, {part.name}", stated, count, count))
        both = f"{whole.name}, {part.name}"
        distances = [sparse.distance(part, method) for method in (0, 1)]
        rows.append(in_mm(f"RMS distance to the model of all points, {both}", distances, "similar"))
        rows.append(warnings(both, part.fits))
    return rows


def _sparse_comparison(sparse: Sparse) -> str:
    length, parts = sparse.whole.length, []
    for part in sparse.parts:
        paper, default = (sparse.distance(part, method) for method in (0, 1))
        parts.append(
            f"from {'a' if part is sparse.grid else 'the'} {part.name} {mm(paper)} by the paper's method, "
            f"{similar(paper, length)}, and {mm(default)} by default, {similar(default, length)}"
        )
    return f"The {sparse.whole.name}, {mm(length)} long: {listed(parts)}."


def _sparse_pictures(sparse: Sparse) -> list[Tile]:
    """A row for each cloud: its points and both models, all at one scale."""
    rows = {part.name: part for part in sparse.parts} | {"all": sparse.whole}
    meshes = {
        name: [fit.model.mesh(each.surface, drawing.RESOLUTION) for fit in each.fits] for name, each in rows.items()
    }
    window = np.concatenate([sparse.whole.cloud, *(mesh.vertices for pair in meshes.values() for mesh in pair)])
    pictures: list[Tile] = []
    for name, each in rows.items():
        cloud = drawing.cloud(each.cloud, size=4)
        pictures.append(drawing.in_space(f"{name}, {len(each.cloud):,} points", window, cloud))
        for mesh, method, colour in zip(meshes[name], MODELS, COLOURS):
            pictures.append(drawing.in_space(f"{name}, {method}", window, drawing.mesh(mesh, colour)))
    return pictures
