"""Points, surfaces, boxes and arrows in space; small pixels in the page."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from PIL import Image

from quadriform.points import Array
from quadriform.report.parts import image
from quadriform.report.slices import COLOURS
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh

ORANGE, BLUE, GREEN, PINK = COLOURS
GREY = "#57606a"
BY_PAPER, BY_DEFAULT = BLUE, GREEN
"""One colour for each method, everywhere on the page."""
PALETTE = 128
"""Colours of a picture: grey, and a few that differ; a quarter of the bytes."""
ARROW = "#a0306f"
SHOWN = 3000
"""So many points of a cloud are drawn at most."""
RESOLUTION = 16
"""Of the meshes that are drawn, cells along an edge of the cube."""


def scene(columns: int, rows: int = 1, width: float = 3.0) -> tuple[Figure, list[Any]]:
    """A figure with a row-by-row list of empty places in space."""
    figure = Figure(figsize=(width * columns, 0.95 * width * rows))
    places = [figure.add_subplot(rows, columns, k + 1, projection="3d") for k in range(rows * columns)]
    for axes in places:
        axes.set_axis_off()
        axes.view_init(elev=18, azim=-58)
    figure.subplots_adjust(0, 0, 1, 0.93, 0, 0.1)
    return figure, places


def look_at(places: Sequence[Any], points: Array, zoom: float = 1.2) -> None:
    """The same window on all places: around these points (n, 3), equal along all axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    for axes in places:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=zoom)


def draw_cloud(axes: Any, points: Array, colour: str = ORANGE, size: float = 2.0) -> None:
    """Points, those far away pale."""
    some = points[:: -(-len(points) // SHOWN)]
    axes.scatter(*some.T, s=size, color=colour, linewidths=0, depthshade=True)


def draw_mesh(axes: Any, mesh: Mesh, colour: str, alpha: float = 1.0) -> None:
    """A shaded surface."""
    axes.plot_trisurf(
        *mesh.vertices.T, triangles=mesh.faces, color=colour, alpha=alpha, linewidth=0, antialiased=alpha < 1
    )


def draw_box(axes: Any, box: ControlBox, colour: str = GREY) -> None:
    """The lines between neighbouring control points."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    rows = [np.moveaxis(box.control_points, axis, 2) for axis in range(3)]
    lines = [line for row in rows for line in row.reshape(-1, row.shape[2], 3)]
    axes.add_collection3d(Line3DCollection(lines, colors=colour, linewidths=0.4))


def draw_arrows(axes: Any, starts: Array, steps: Array, count: int = 400) -> None:
    """Displacements (n, 3) at points (n, 3), some of them."""
    some = slice(None, None, -(-len(starts) // count))
    axes.quiver(*starts[some].T, *steps[some].T, color=ARROW, linewidths=1.0, arrow_length_ratio=0.25)


def picture(drawing: Figure, words: str, dots_per_inch: int = 100) -> Markup:
    """A drawing as pixels of few colours inside the page."""
    pixels = _pixels(drawing, dots_per_inch)
    return _packed(pixels.quantize(PALETTE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE), words)


def grey_picture(drawing: Figure, words: str, dots_per_inch: int = 80) -> Markup:
    """A drawing of images without colours as pixels inside the page."""
    return _packed(_pixels(drawing, dots_per_inch).convert("L"), words)


def _pixels(drawing: Figure, dots_per_inch: int) -> Image.Image:
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=dots_per_inch, facecolor="white")
    return Image.open(stream).convert("RGB")


def _packed(pixels: Image.Image, words: str) -> Markup:
    stream = io.BytesIO()
    pixels.save(stream, format="png", optimize=True)
    return image(stream.getvalue(), words)


def plain(axes: Any) -> None:
    """Tick labels of logarithmic axes as plain numbers, at 1, 2 and 5 times the powers of ten."""
    from matplotlib.ticker import FuncFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))
            axis.set_tick_params(which="minor", labelsize=7)
