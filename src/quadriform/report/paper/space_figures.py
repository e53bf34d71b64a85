"""Section 3.4.2: two surfaces in one box or in two, and the deformation of the whole space of a box."""

from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.fitting.fit import refine
from quadriform.fitting.result import Fit, rms
from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, SAME, Remake, Row, listed, mm, shown
from quadriform.report.paper.subjects import Subject, Walls
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel

LINES = 17
"""Of the lattice along each axis."""
SAMPLES = 21
"""Along each axis of the box, for the share of the space that is folded."""
TRUNCATED = 0.512
"""Share of the singular values for the regularised box: 64 of 125."""


def wall_rows(walls: Walls) -> list[Row]:
    """One box against two in numbers."""
    count = sum(map(len, walls.together.points.values()))
    together, alone = walls.together, walls.alone.values()
    ratios = [
        (
            f"{3 * count / fit.model.n_parameters:.1f}",
            f"{3 * count / sum(one.fits[k].model.n_parameters for one in alone):.1f}",
        )
        for k, fit in enumerate(together.fits)
    ]
    both = f"{together.name}, {count:,} points"
    rows: list[Row] = [
        (f"compression ratio in one box: {both}", "154", *(one for one, _ in ratios)),
        (f"compression ratio in a box each: {both}", "77", *(two for _, two in ratios)),
    ]
    for name in walls.alone:
        rows.append((f"error RMS in one box, {name}", NONE, *(mm(rms(_residuals(fit, name))) for fit in together.fits)))
        rows.append(
            (f"error RMS in a box of its own, {name}", "better", *(mm(fit.rms) for fit in walls.alone[name].fits))
        )
    return rows


def _residuals(fit: Fit, name: str) -> Array:
    return fit.residuals[name] if isinstance(fit.residuals, dict) else fit.residuals


def wall_verdict(walls: Walls) -> str:
    """Whether two boxes approximate better, by each method, from the errors of both walls."""
    sentences = []
    for k, method in enumerate(("the paper's method", "the default")):
        parts, better = [], []
        for name, subject in walls.alone.items():
            one, two = rms(_residuals(walls.together.fits[k], name)), subject.fits[k].rms
            better.append(two < (1 - SAME) * one)
            parts.append(f"{name} {mm(two)} against {mm(one)}")
        word = "on both walls" if all(better) else "on one wall only" if any(better) else "on neither wall"
        sentences.append(f"With {method} a box each is nearer by more than {SAME:.0%} {word}: {listed(parts)}.")
    counts = walls.together.paper.model.n_parameters, sum(s.paper.model.n_parameters for s in walls.alone.values())
    why = " The default estimates a strength of regularisation for each fit: its two boxes need not be nearer."
    return f"One box has {counts[0]} parameters, two have {counts[1]}. {' '.join(sentences)}{why} {walls.together.note}"


def whole_space(material: Material) -> Remake:
    """The deformation field that 3.4.2 infers over the entire space; no figure shows it."""
    subject = material.walls.together
    models = {
        'method="paper", all singular values': subject.paper.model,
        'method="paper", truncated': _truncated(subject, material.box).model,
        "default": subject.default.model,
    }
    section = {name: _section(model) for name, model in models.items()}
    rest = DeformableModel(subject.paper.model.surfaces, _at_rest(subject.paper.model.box))
    pictures = [("undeformed box", _picture(_section(rest), "undeformed box"))]
    pictures += [(name, _picture(found, name)) for name, found in section.items()]
    folded = [_folded(model.box) for model in models.values()]
    words = f"The {subject.name}: {LINES} x {LINES} lines in the middle plane of the box, and both walls in it."
    kept = round(TRUNCATED * int(np.prod(material.box)))
    return Remake(
        "Section 3.4.2",
        "deformation of the whole space",
        "p. 46",
        "a single free-form deformation of two surfaces gives a deformation field over the entire space, because it is "
        "volumetric. No figure shows it; an irregular box does not allow quantitative conclusions from it (section 4).",
        [shown(drawing.tiles(pictures, "charts"), words, subject.source)],
        [
            ("volume of the box where det J <= 0, all singular values", NONE, f"{folded[0]:.1%}", f"{folded[2]:.1%}"),
            (
                f"volume of the box where det J <= 0, {kept} singular values",
                NONE,
                f"{folded[1]:.1%}",
                f"{folded[2]:.1%}",
            ),
        ],
        f"the map folds (det J <= 0) in {folded[0]:.1%} of the box with all singular values, in "
        f"{folded[1]:.1%} with {kept} of them, and in {folded[2]:.1%} by default, at {SAMPLES}^3 places; where "
        f"it folds "
        "it is no deformation of tissue.",
    )


def _truncated(subject: Subject, box: tuple[int, int, int]) -> Fit:
    kept = round(TRUNCATED * int(np.prod(box)))
    return refine(
        subject.paper.model.surfaces, subject.points, method="paper", regularity="svd", strength=kept, box=box
    )


def _at_rest(box: ControlBox) -> ControlBox:
    return box.with_control_points(box.rest)


def _in_box(box: ControlBox, local: Array) -> Array:
    """World points (n, 3) of the undeformed box from local coordinates (n, 3) in [0, 1]."""
    return np.asarray(box.origin + local @ box.edges)


def _folded(box: ControlBox) -> float:
    """Share of the undeformed box where the determinant of the map is not positive."""
    middles = (np.arange(SAMPLES) + 0.5) / SAMPLES
    local = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return float((np.linalg.det(box.jacobian(_in_box(box, local))) <= 0).mean())


def _section(model: DeformableModel) -> tuple[list[Array], list[Array]]:
    """Deformed lattice lines and sections of the surfaces in the plane of two edges of the box, (n, 2) each."""
    box = model.box
    across, along = box.edges[0], box.edges[2]
    plane = np.stack([across / np.linalg.norm(across), along / np.linalg.norm(along)], axis=1)
    fine, coarse = np.linspace(0, 1, 101), np.linspace(0, 1, LINES)
    lines = [np.column_stack(pair) for at in coarse for pair in _both_ways(fine, np.full_like(fine, at))]
    turn = np.linspace(-np.pi, np.pi, 181)
    rays = np.column_stack([np.cos(turn), np.zeros_like(turn), np.sin(turn)])
    walls = [surface.surface(rays) for surface in model.surfaces.values()]
    deformed = [box.deform(_in_box(box, line)) for line in lines]
    return [points @ plane for points in deformed], [box.deform(wall) @ plane for wall in walls]


def _both_ways(moving: Array, fixed: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    half = np.full_like(moving, 0.5)
    return (moving, half, fixed), (fixed, half, moving)


def _picture(section: tuple[list[Array], list[Array]], words: str) -> Markup:
    lines, walls = section
    every = np.concatenate(walls)
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.15 * (high - low).max()

    def draw(axes: Any) -> None:
        for line in lines:
            axes.plot(*line.T, color=drawing.GREY, linewidth=0.6)
        for wall, colour in zip(walls, (drawing.ORANGE, drawing.PINK)):
            axes.plot(*wall.T, color=colour, linewidth=2)
        axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))

    return drawing.plane(draw, words)
