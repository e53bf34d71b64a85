"""Section 3.4.2: two surfaces in one box or in two, and the deformation of the whole space of a box."""

from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from quadriform.fitting.fit import refine
from quadriform.fitting.result import Fit, rms
from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, SAME, Remake, Row, in_mm, listed, mm, shown
from quadriform.report.paper.subjects import Subject, Walls, before
from quadriform.report.parts import legend, tiles
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

Index = NDArray[np.int64]

LINES = 17
"""Lattice lines along each axis."""
WALL = 40
"""Cells along a cube's edge of the meshes whose sections are drawn."""
WALL_COLOURS = (drawing.ORANGE, drawing.PINK)
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
    for name, own in walls.alone.items():
        rows.append(in_mm(f"error RMS in one box, {name}", [rms(_residuals(fit, name)) for fit in together.fits]))
        rows.append(in_mm(f"error RMS in a box of its own, {name}", [fit.rms for fit in own.fits], "better"))
    return rows


def _residuals(fit: Fit, name: str) -> Array:
    return fit.residuals[name] if isinstance(fit.residuals, dict) else fit.residuals


def wall_words(walls: Walls) -> dict[str, object]:
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
    return {
        "one": walls.together.paper.model.n_parameters,
        "two": sum(subject.paper.model.n_parameters for subject in walls.alone.values()),
        "compared": " ".join(sentences),
        "strength": walls.together.default.strength,
        "strengths": listed([f"{name} {subject.default.strength:.1e}" for name, subject in walls.alone.items()]),
        "note": walls.together.note,
    }


def whole_space(material: Material) -> Remake:
    """The deformation field that 3.4.2 infers over the entire space; no figure shows it."""
    subject = material.walls.together
    models = {
        'method="paper", all singular values': subject.paper.model,
        'method="paper", truncated': _truncated(subject, material.box).model,
        "default": subject.default.model,
    }
    rest = before(subject.paper.model)
    pictures = [
        (name, _picture(_section(model, rest.box), name)) for name, model in ({"undeformed box": rest} | models).items()
    ]
    key = legend(list(zip(subject.points, WALL_COLOURS)))
    folded = [f"{_folded(model.box):.1%}" for model in models.values()]
    kept = round(TRUNCATED * int(np.prod(material.box)))
    rows: list[Row] = [
        (f"volume of the box where det J <= 0, {which} singular values", NONE, by_paper, folded[2])
        for which, by_paper in (("all", folded[0]), (kept, folded[1]))
    ]
    picture = shown("space", tiles(pictures) + key, subject.source, subject=subject.name, lines=LINES)
    return Remake("space", {"folded": folded, "kept": kept, "samples": SAMPLES}, [picture], rows)


def _truncated(subject: Subject, box: tuple[int, int, int]) -> Fit:
    kept = round(TRUNCATED * int(np.prod(box)))
    return refine(
        subject.paper.model.surfaces, subject.points, method="paper", regularity="svd", strength=kept, box=box
    )


def _in_box(box: ControlBox, local: Array) -> Array:
    """World points (n, 3) of the undeformed box from local coordinates (n, 3) in [0, 1]."""
    return np.asarray(box.origin + local @ box.edges)


def _folded(box: ControlBox) -> float:
    """Fraction of the undeformed box where the determinant of the map is not positive."""
    middles = (np.arange(SAMPLES) + 0.5) / SAMPLES  # middles of cells: faces and edges would count too much
    local = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return float((np.linalg.det(box.jacobian(_in_box(box, local))) <= 0).mean())


def _section(model: DeformableModel, like: ControlBox) -> tuple[list[Array], list[Array]]:
    """Deformed lattice lines, (n, 2) each, and segments (m, 2, 2) of each surface, in a middle plane of the box.

    The plane is spanned by the edges nearest to the first and the last of another box, and turned as they are.
    """
    box = model.box
    chosen, plane = _nearest_edges(box, like)
    fine, coarse = np.linspace(0, 1, 101), np.linspace(0, 1, LINES)
    lines = [_line(chosen[order], fine, at) for at in coarse for order in ([0, 1], [1, 0])]
    # the third coordinate is 1/2: the plane through the centre of the box
    middle, normal = box.origin + box.edges.sum(axis=0) / 2, np.cross(*plane.T)
    cuts = [_cut(surface.mesh(WALL), normal, middle) for surface in model.surfaces.values()]
    # the surfaces are cut before the deformation, so that the cut follows the map as the lines do
    deformed = [box.deform(_in_box(box, line)) @ plane for line in lines]
    return deformed, [(box.deform(cut.reshape(-1, 3)) @ plane).reshape(-1, 2, 2) for cut in cuts]


def _nearest_edges(box: ControlBox, like: ControlBox) -> tuple[Index, Array]:
    """Indices (2,) of the edges along the first and the last edge of another box; their directions (3, 2), alike."""
    edges, others = (each.edges / np.linalg.norm(each.edges, axis=1, keepdims=True) for each in (box, like))
    cosines = edges @ others[[0, 2]].T
    # absolute: an edge has no direction of its own; the last axis is chosen first, so that no edge serves twice
    last = int(np.abs(cosines[:, 1]).argmax())
    first = max((k for k in range(3) if k != last), key=lambda k: abs(cosines[k, 0]))
    chosen = np.array([first, last])
    # the signs rotate both pictures alike
    return chosen, (edges[chosen] * np.sign(cosines[chosen, [0, 1]])[:, None]).T


def _line(axes: Index, moving: Array, fixed: float) -> Array:
    """Local coordinates (n, 3) of a line along the first of two axes, at a position along the second, in the middle."""
    local = np.full((len(moving), 3), 0.5)
    local[:, axes[0]], local[:, axes[1]] = moving, fixed
    return local


def _cut(mesh: Mesh, normal: Array, point: Array) -> Array:
    """Segments (m, 2, 3) where a plane cuts a mesh."""
    from trimesh import Trimesh
    from trimesh.intersections import mesh_plane

    return np.asarray(mesh_plane(Trimesh(mesh.vertices, mesh.faces, process=False), normal, point))


def _picture(section: tuple[list[Array], list[Array]], words: str) -> Markup:
    from matplotlib.collections import LineCollection

    lines, walls = section
    every = np.concatenate([wall.reshape(-1, 2) for wall in walls])
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.15 * (high - low).max()

    def draw(axes: Any) -> None:
        """Draw the lines of the box and the walls."""
        axes.add_collection(LineCollection(lines, colors=drawing.GREY, linewidths=0.6))
        for wall, colour in zip(walls, WALL_COLOURS):
            axes.add_collection(LineCollection(list(wall), colors=colour, linewidths=2))
        axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))

    return drawing.plane(draw, words)
