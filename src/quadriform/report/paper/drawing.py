"""Small pictures that stand side by side on the page: points, surfaces, boxes and arrows in space, and charts."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from quadriform.points import Array
from quadriform.report.parts import image, png, svg
from quadriform.report.slices import COLOURS
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh

ORANGE, BLUE, GREEN, PINK = COLOURS
GREY, INK = "#57606a", "#1b1f24"
BY_PAPER, BY_DEFAULT = BLUE, GREEN
"""One colour for each method, everywhere on the page."""
PALETTE = 128
"""Colours of a picture: a quarter of the bytes of all colours."""
ARROW = "#a0306f"
SHOWN = 3000
"""At most so many points of a cloud are drawn."""
RESOLUTION = 16
"""Cells along an edge of the cube, of the meshes that are drawn."""
VIEW = (18.0, -58.0)
"""Elevation and azimuth in degrees."""
TEXT = 11
"""Size of the text in charts, in points: at least 13 pixels where a chart is drawn 350 pixels wide."""

Artist = Callable[[Any], object]
"""Draws one thing into axes in space."""
Tile = tuple[str, Markup]
"""A title and its picture."""


def in_space(
    title: str,
    window: Array,
    *artists: Artist,
    view: tuple[float, float] = VIEW,
    inches: float = 2.8,
    zoom: float = 1.12,
) -> Tile:
    """A title and a picture of what the artists draw, for `tiles`.

    Args:
        title: also the text alternative of the picture.
        window: (n, 3) points; what lies around them is shown, equal lengths along all axes.
        *artists: of `cloud`, `mesh`, `box`, `arrows`.
        view: elevation and azimuth in degrees.
        inches: width of the picture, 100 pixels each.
        zoom: smaller for windows that are turned against the axes.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(inches, 0.95 * inches))
    axes = figure.add_subplot(projection="3d")
    axes.set_axis_off()
    axes.view_init(*view)
    figure.subplots_adjust(0, 0, 1, 1)
    for draw in artists:
        draw(axes)
    low, high = window.min(axis=0), window.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    # the same scale along all axes, whatever the window
    axes.set_box_aspect(high - low, zoom=zoom)
    return title, _packed(figure, title)


def cloud(points: Array, colour: str = ORANGE, size: float = 2.0) -> Artist:
    """Points, those far away pale; the first, every k-th of many."""
    # rounded up, so that at most SHOWN are left
    some = points[:: -(-len(points) // SHOWN)]
    return lambda axes: axes.scatter(*some.T, s=size, color=colour, linewidths=0, depthshade=True)


def mesh(surface: Mesh, colour: str, alpha: float = 1.0) -> Artist:
    """A shaded surface."""
    return lambda axes: axes.plot_trisurf(
        *surface.vertices.T, triangles=surface.faces, color=colour, alpha=alpha, linewidth=0, antialiased=alpha < 1
    )


def box(lattice: ControlBox, colour: str = GREY) -> Artist:
    """The lines between neighbouring control points."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    # the lines along one axis are the rows when this axis stands last
    rows = [np.moveaxis(lattice.control_points, axis, 2) for axis in range(3)]
    lines = [line for row in rows for line in row.reshape(-1, row.shape[2], 3)]
    return lambda axes: axes.add_collection3d(Line3DCollection(lines, colors=colour, linewidths=0.5))


def arrows(starts: Array, steps: Array) -> Artist:
    """All displacements (n, 3) at points (n, 3)."""
    return lambda axes: axes.quiver(*starts.T, *steps.T, color=ARROW, linewidths=0.6, arrow_length_ratio=0.2)


def chart(
    draw: Callable[[Any], object], words: str, xlabel: str, ylabel: str, xscale: str = "linear", yscale: str = "log"
) -> Markup:
    """A diagram as vectors; `draw` puts curves into its axes."""

    def whole(axes: Any) -> None:
        """Draw, then label the axes."""
        axes.set(xlabel=xlabel, ylabel=ylabel, xscale=xscale, yscale=yscale)
        draw(axes)
        axes.grid(alpha=0.3, which="both")
        _plain(axes)  # last: the tick labels depend on the range of the curves

    return _vectors(whole, words)


def plane(draw: Callable[[Any], object], words: str) -> Markup:
    """A drawing in the plane, without axes and with equal lengths along both, as vectors."""

    def whole(axes: Any) -> None:
        """Draw, with equal lengths along both axes."""
        draw(axes)
        axes.set_aspect("equal")
        axes.set_axis_off()

    return _vectors(whole, words)


def _vectors(draw: Callable[[Any], object], words: str) -> Markup:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"font.size": TEXT}):
        figure = Figure(figsize=(3.9, 3.1))
        draw(figure.subplots())
        return svg(figure, words)


def _plain(axes: Any) -> None:
    """Tick labels of logarithmic axes as plain numbers, at 1, 2 and 5 times the powers of ten where there is room."""
    from matplotlib.ticker import FuncFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "log":
            continue
        low, high = axis.get_view_interval()
        between = "123456789" if high < 4 * low else "25" if high < 100 * low else ""
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(FuncFormatter(lambda x, _, s=between: f"{x:g}" if s and f"{x:e}"[0] in s else ""))
        axis.set_tick_params(which="both", labelsize=TEXT)


def _packed(figure: Any, words: str) -> Markup:
    """A drawing as pixels of few colours inside the page."""
    pixels = Image.open(io.BytesIO(png(figure, 100))).convert("RGB")
    # without dithering, which PNG cannot compress
    pixels = pixels.quantize(PALETTE, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    packed = io.BytesIO()
    pixels.save(packed, format="png", optimize=True)
    return image(packed.getvalue(), words)
