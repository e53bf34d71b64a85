"""Figs. 19 to 21: isosurfaces beside models, and how much smaller the models are."""

from dataclasses import replace

import numpy as np
from markupsafe import Markup

from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import Remake, Row, beside, in_mm, mm, shown, text
from quadriform.report.paper.scans import Scan
from quadriform.report.paper.space_figures import wall_rows, wall_words
from quadriform.report.parts import tiles

VIEWS = ((18, -58), (18, 32), (80, -58))
"""Elevation and azimuth, degrees."""
COLOURS = (drawing.ORANGE, drawing.BY_PAPER, drawing.BY_DEFAULT)


def third_surface(material: Material) -> Remake:
    """Fig. 21, and both walls of a ventricle in one box and in two."""
    made, walls = surface("21", ("10,000", "77"), material.third, 2), material.walls
    words = made.words | {"walls": text("walls", "comparison", **wall_words(walls))}
    return replace(made, words=words, rows=[*made.rows, *wall_rows(walls)])


def surface(key: str, stated: tuple[str, str], scan: Scan, views: int) -> Remake:
    """Figs. 19 to 21: points and compression ratio as the paper states them, and from how many views it shows them."""
    paper, default = scan.subject.fits
    points = len(scan.subject.cloud)
    words: dict[str, object] = {
        "subject": scan.subject.name,
        "points": points,
        "coordinates": 3 * points,
        "fit": paper,
        "threes": paper.model.n_parameters / 3,
        "compared": beside(default.rms, paper.rms),
        "default": mm(default.rms),
        "paper": mm(paper.rms),
        "walls": "",
    }
    return Remake(key, words, [_beside(key, scan, views)], _rows(scan, stated))


def _rows(scan: Scan, stated: tuple[str, str]) -> list[Row]:
    name, fits, count = scan.subject.name, scan.subject.fits, len(scan.subject.cloud)
    return [
        (f"points of the isosurface, {name}", stated[0], *[f"{count:,}"] * 2),
        (f"compression ratio, {name}", stated[1], *(f"{fit.compression_ratio:.1f}" for fit in fits)),
        in_mm(f"error RMS at that ratio, {name}", [fit.rms for fit in fits]),
    ]


def _beside(key: str, scan: Scan, views: int) -> Markup:
    subject = scan.subject
    models = [fit.model.mesh(subject.surface, drawing.RESOLUTION) for fit in subject.fits]
    meshes = dict(zip(("isosurface", "paper's model", "default's model"), (scan.outline, *models)))
    # one window, so that the three are drawn at one scale
    window = np.concatenate([mesh.vertices for mesh in meshes.values()])
    pictures = [
        drawing.in_space(title, window, drawing.mesh(mesh, colour), view=view, inches=2.4)
        for view in VIEWS[:views]
        for (title, mesh), colour in zip(meshes.items(), COLOURS)
    ]
    count = f"{views} view point{'s' if views > 1 else ''}"
    return shown(key, tiles(pictures, "thirds"), subject.source, subject=subject.name, views=count)
