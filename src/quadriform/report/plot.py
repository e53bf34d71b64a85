"""Surfaces of a model in three dimensions, by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError
from quadriform.fitting.fit import Clouds
from quadriform.points import Array, check_points
from quadriform.report.drawable import Drawable, surfaces_of
from quadriform.report.slices import COLOURS
from quadriform.shapes.mesh import Mesh

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

SEEN_THROUGH = 0.25
"""Opacity of surfaces with something inside them or dots around them."""


def plot(
    model: Drawable,
    axes: Axes3D | None = None,
    *,
    points: Clouds | None = None,
    surface: str | None = None,
    time: float | None = None,
    colour: str | ArrayLike | None = None,
    resolution: int = 24,
) -> Axes3D:
    """Draw surfaces, and points if there are any, with equal scales along all axes.

    Nothing is shown and pyplot is not touched: `plot(fit).figure` is displayed by a notebook under `%matplotlib
    inline`, and saved by its `savefig`. For a window give axes of a figure of pyplot, and call `pyplot.show`.

    Args:
        model: a model, a fit, a moving model at a `time`, or a mesh.
        axes: three-dimensional axes to draw on; those of a new figure unless given.
        points: (n, 3), or clouds by name, drawn as dots; in the unit and frame of the model.
        surface: the name of one surface; all of them unless given, those around others translucent.
        time: of a moving model, in the unit of its knots.
        colour: a colour of matplotlib, or a number for each vertex, (n,), of the surface's mesh at this resolution,
            shown by the default colour map; `axes.figure.colorbar(axes.collections[-1])` is its legend.
        resolution: 1 to 512, as in `DeformableModel.mesh`.

    Returns:
        The axes. Their labels carry the unit where the model knows it.

    Raises:
        OptionError: nothing that has a surface, axes without depth, an unknown surface or colour, a colour array of
            the wrong length, a time too many or too few.
        PointsError: points that are not finite or not (n, 3).
    """
    found = surfaces_of(model, surface, time, resolution)
    values = None if colour is None or isinstance(colour, str) else _values(colour, found.only)
    clouds = [] if points is None else _clouds(points)
    tints = (_tint(colour),) if isinstance(colour, str) else COLOURS
    target = _new_axes() if axes is None else _deep(axes)
    # the largest extent orders surfaces inside each other; only the innermost hides nothing
    innermost = min(found.meshes, key=lambda name: float(np.ptp(found.meshes[name].vertices, axis=0).max()))
    if clouds:
        target.scatter(*np.concatenate(clouds).T, s=2, c="black", depthshade=False, label="points")
    for tint, (name, mesh) in zip(cycle(tints), found.meshes.items()):
        _draw(target, mesh, name, tint, values, SEEN_THROUGH if clouds or name != innermost else 1.0)
    unit = "" if found.unit == "unknown" else f", {found.unit}"
    target.set(xlabel=f"x{unit}", ylabel=f"y{unit}", zlabel=f"z{unit}")
    target.set_aspect("equal")
    return target


def _draw(axes: Any, mesh: Mesh, name: str, tint: str, values: Array | None, alpha: float) -> None:
    drawn = axes.plot_trisurf(
        *mesh.vertices.T, triangles=mesh.faces, color=tint, alpha=alpha, linewidth=0, antialiased=False, label=name
    )
    if values is not None:
        # matplotlib colours triangles, not vertices
        drawn.set_array(values[mesh.faces].mean(axis=1))


def _new_axes() -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(6, 6)).add_axes((0, 0.03, 0.9, 0.95), projection="3d")  # room for the label of z


def _deep(axes: Any) -> Any:
    if getattr(axes, "name", None) != "3d":
        raise OptionError(
            f"option axes: expected axes of three dimensions, found {type(axes).__name__}; try "
            "figure.add_subplot(projection='3d')"
        )
    return axes


def _tint(colour: str) -> str:
    from matplotlib.colors import is_color_like

    if not is_color_like(colour):
        raise OptionError(f"option colour={colour!r} is no colour of matplotlib; expected one such as 'tab:blue'")
    return colour


def _values(colour: ArrayLike, mesh: Mesh) -> Array:
    values = np.asarray(colour)
    if values.dtype.kind not in "biuf" or values.shape != (len(mesh.vertices),) or not np.isfinite(values).all():
        raise OptionError(
            f"option colour: expected the name of a colour or {len(mesh.vertices)} finite numbers, one for each vertex "
            f"at this resolution, found {values.dtype} of shape {values.shape}"
        )
    return values.astype(np.float64)


def _clouds(points: Clouds) -> list[Array]:
    given = points if isinstance(points, Mapping) else {"points": points}
    return [check_points(cloud, name) for name, cloud in given.items()]
