"""Slices of an image with the contours of a model over them (the paper's Figs. 15 to 18)."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.report.page import Section
from quadriform.report.parts import figure, image
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.voxels import voxel_spacing

COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7")
"""Okabe and Ito's, distinguishable for colour-blind readers."""
WIDTHS = (3.4, 1.0, 1.0, 1.0)
"""Widths of outlines in points; the first is wider, so that it is visible below the others."""
ALONE = 2.0
"""Width of a single outline."""
GAMMA = 0.6
"""Gamma correction that brightens dark tissue."""


def slices_png(
    values: Array, world_from_voxel: Array, meshes: Mapping[str, Mesh], title: str, count: int = 12, columns: int = 4
) -> bytes:
    """Draw even slices along the third axis of an image, each with the outlines where meshes cut it.

    Args:
        values: (i, j, k) image.
        world_from_voxel: (4, 4), to the frame of the meshes.
        meshes: name -> surface in the world.
        title: stands above; name the source of the image in it.
        count: how many slices, spread over what the meshes reach.
        columns: slices side by side.

    Returns:
        The bytes of a PNG.
    """
    from matplotlib.figure import Figure

    outlines = {name: Mesh(_to_voxels(mesh.vertices, world_from_voxel), mesh.faces) for name, mesh in meshes.items()}
    steps = voxel_spacing(world_from_voxel)
    rows = -(-count // columns)  # rounded up
    figure = Figure(figsize=(11, 0.6 + 2.9 * rows * values.shape[1] * steps[1] / (values.shape[0] * steps[0])))
    figure.suptitle(title, fontsize=10)
    window = _window(values)
    # voxel coordinates: the third is the number of the slice
    heights = np.concatenate([mesh.vertices[:, 2] for mesh in outlines.values()])
    for position, k in enumerate(_levels(heights, values.shape[2], count)):
        axes = figure.add_subplot(rows, columns, position + 1)
        _draw_grey(axes, values[:, :, k], window, steps[1] / steps[0])
        for colour, mesh in zip(COLOURS, outlines.values()):
            _draw_outline(axes, mesh, float(k), colour)
        axes.set_title(f"slice {k}", fontsize=8, pad=2)
    _legend(figure, outlines)
    # room for the legend below the slices
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def slice_pictures(
    values: Array,
    world_from_voxel: Array,
    meshes: Mapping[str, Mesh],
    count: int = 12,
    colours: Sequence[str] | None = None,
) -> dict[int, bytes]:
    """Pictures of even slices along the third axis, without any text in them: number of the slice -> bytes of a PNG.

    Args:
        values: (i, j, k) image.
        world_from_voxel: (4, 4), to the frame of the meshes.
        meshes: surfaces in the world whose outlines are drawn; the slices spread over what they reach, or over those
            that are not of one value.
        count: how many slices at most.
        colours: of the outlines, `COLOURS` by default.
    """
    from matplotlib.figure import Figure

    outlines = [Mesh(_to_voxels(mesh.vertices, world_from_voxel), mesh.faces) for mesh in meshes.values()]
    steps = voxel_spacing(world_from_voxel)
    window = _window(values)
    reached = np.concatenate([mesh.vertices[:, 2] for mesh in outlines]) if outlines else _uneven(values)
    # voxels need not be cubes: the picture has the proportions of the body
    height = 2.0 * values.shape[1] * steps[1] / (values.shape[0] * steps[0])
    widths = WIDTHS if len(outlines) > 1 else (ALONE,)
    pictures = {}
    for k in _levels(reached, values.shape[2], count):
        figure = Figure(figsize=(2.0, height))
        axes = figure.add_axes((0, 0, 1, 1))
        _draw_grey(axes, values[:, :, k], window, steps[1] / steps[0])
        for width, colour, mesh in zip(widths, colours or COLOURS, outlines):
            _draw_outline(axes, mesh, float(k), colour, width)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=110)
        pictures[k] = stream.getvalue()
    return pictures


def _draw_grey(axes: Any, values: Array, window: tuple[float, float], aspect: float) -> None:
    low, high = window
    grey = np.clip((values - low) / (high - low), 0, 1) ** GAMMA
    # transposed: images have rows first, voxels i first; the aspect is that of a voxel
    axes.imshow(grey.T, cmap="gray", origin="lower", aspect=aspect, vmin=0, vmax=1)
    axes.set_axis_off()
    axes.set(xticks=[], yticks=[])  # what is not shown would still be laid out


def _window(values: NDArray[Any]) -> tuple[float, float]:
    """The values that are shown black and white; a small label needs all of them, an even image any two."""
    low, high = (float(value) for value in np.percentile(values, [1, 99.5]))
    if low == high:
        low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + 1.0


def planes_section(volume: Volume, meshes: Mapping[str, Mesh], title: str) -> Section:
    """Three slices along each axis of an image, with the outlines of the meshes; `title` names the image."""
    pictures = Markup("")
    for axis, letter in enumerate("ijk"):
        # the axis that is cut becomes the last one, and the columns of the affine follow it
        order = [other for other in range(3) if other != axis] + [axis]
        affine = volume.world_from_voxel[:, [*order, 3]]
        data = slices_png(volume.values.transpose(order), affine, meshes, f"{title}, across {letter}", 3, 3)
        pictures += image(data, f"Three slices of the image across axis {letter} with the outlines of the model")
    words = f"{title}: slices across the three axes of the image, with the contours of the model."
    return Section("Slices", figure(pictures, words))


def _to_voxels(points_world: Array, world_from_voxel: Array) -> Array:
    # solved rather than inverted: the same result on every BLAS kernel to the last digits
    offset = points_world - world_from_voxel[:3, 3]
    return np.asarray(np.linalg.solve(world_from_voxel[:3, :3], offset.T).T, dtype=np.float64)


def _uneven(values: Array) -> Array:
    """Numbers of the slices that are not of one value; of all where each is."""
    found = np.flatnonzero(np.ptp(values, axis=(0, 1)) > 0)
    return np.asarray(found if len(found) else np.arange(values.shape[2]), dtype=np.float64)


def _levels(heights: Array, size: int, count: int) -> list[int]:
    # whole slices that the surface reaches; a set, for few slices give the same number twice
    low, high = max(0, int(np.ceil(heights.min()))), min(size - 1, int(np.floor(heights.max())))
    return sorted({int(k) for k in np.linspace(low, high, count).round()})


def _draw_outline(axes: Any, mesh: Mesh, k: float, colour: str, width: float = 1.2) -> None:
    from matplotlib.collections import LineCollection
    from trimesh import Trimesh
    from trimesh.intersections import mesh_plane

    shell = Trimesh(mesh.vertices, mesh.faces, process=False)
    lines = mesh_plane(shell, (0, 0, 1), (0, 0, k + 1e-6))  # beside the level: vertices on it would count twice
    axes.add_collection(LineCollection([line[:, :2] for line in lines], colors=colour, linewidths=width))


def _legend(figure: Any, outlines: Mapping[str, Mesh]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour) for colour, _ in zip(COLOURS, outlines)]
    figure.legend(handles, list(outlines), loc="lower center", ncols=len(outlines), frameon=False, fontsize=9)
