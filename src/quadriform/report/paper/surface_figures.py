"""Figs. 19 to 21: isosurfaces beside models, and how much smaller the models are."""

import numpy as np
from markupsafe import Markup

from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, Remake, Row, beside, mm, shown
from quadriform.report.paper.scans import Scan
from quadriform.report.paper.space_figures import wall_rows, wall_verdict

VIEWS = ((18, -58), (18, 32), (80, -58))
"""Elevation and azimuth, degrees."""
COLOURS = (drawing.ORANGE, drawing.BY_PAPER, drawing.BY_DEFAULT)


def first_surface(material: Material) -> Remake:
    """Fig. 19."""
    claim = "left the isosurface (6,000 points), right the parametric model (130 points), three view points; "
    claim += "compression ratio 46."
    return _surface("Fig. 19", "p. 50", claim, ("6,000", "46"), material.first, 3)


def second_surface(material: Material) -> Remake:
    """Fig. 20."""
    claim = "left the isosurface (1,000 points), right the parametric model (130 points); compression ratio 7.7."
    return _surface("Fig. 20", "p. 50", claim, ("1,000", "7.7"), material.second, 1)


def third_surface(material: Material) -> Remake:
    """Fig. 21."""
    claim = (
        "left the isosurface of the endocardium (10,000 points; 20,000 on p. 48), right the parametric model (130 "
        "points), two view points; compression ratio 77. One box for epicardium and endocardium together has a ratio "
        "of 154 (p. 48); two boxes approximate better, one has half the parameters (3.4.2)."
    )
    made = _surface("Fig. 21", "p. 51", claim, ("10,000", "77"), material.third, 2)
    walls = material.walls
    return Remake(
        made.name,
        made.title,
        made.page,
        made.claim,
        made.pictures,
        [*made.rows, *wall_rows(walls)],
        f"{made.verdict} {wall_verdict(walls)}",
    )


def _surface(name: str, page: str, claim: str, stated: tuple[str, str], scan: Scan, views: int) -> Remake:
    fits, points = scan.subject.fits, len(scan.subject.cloud)
    errors = [fit.rms for fit in fits]
    count, ratio = fits[0].model.n_parameters, fits[0].compression_ratio
    return Remake(
        name,
        f"isosurface and model, {scan.subject.name}",
        page,
        claim,
        [_beside(scan, views)],
        _rows(scan, stated),
        f"{points:,} points are {3 * points:,} coordinates, and both models have {count} parameters: a ratio of "
        f"{ratio:.1f}. {count} parameters are {count / 3:.1f} times three coordinates; the paper says 130 points for "
        f"5 x 5 x 5 control points. The default's error at this ratio is {beside(errors[1], errors[0])} "
        f"({mm(errors[1])} and {mm(errors[0])}).",
    )


def _rows(scan: Scan, stated: tuple[str, str]) -> list[Row]:
    name, fits, count = scan.subject.name, scan.subject.fits, len(scan.subject.cloud)
    return [
        (f"points of the isosurface, {name}", stated[0], *[f"{count:,}"] * 2),
        (f"compression ratio, {name}", stated[1], *(f"{fit.compression_ratio:.1f}" for fit in fits)),
        (f"error RMS at that ratio, {name}", NONE, *(mm(fit.rms) for fit in fits)),
    ]


def _beside(scan: Scan, views: int) -> Markup:
    subject = scan.subject
    models = [fit.model.mesh(subject.surface, drawing.RESOLUTION) for fit in subject.fits]
    meshes = dict(zip(("isosurface", "paper's model", "default's model"), (scan.outline, *models)))
    window = np.concatenate([mesh.vertices for mesh in meshes.values()])
    pictures = [
        (title, drawing.in_space(window, title, drawing.mesh(mesh, colour), view=view, inches=2.4))
        for view in VIEWS[:views]
        for (title, mesh), colour in zip(meshes.items(), COLOURS)
    ]
    words = f"The {subject.name}: isosurface and both models, {views} view point{'s' if views > 1 else ''}."
    return shown(drawing.tiles(pictures, "thirds"), words, subject.source)
