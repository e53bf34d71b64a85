"""Slices of an image with the contours of a model over them (the paper's Figs. 15 to 18)."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from quadriform.imaging.volume import Volume
from quadriform.points import Array
from quadriform.report.page import Section
from quadriform.report.parts import figure, image, legend, png, tiles
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
COLUMNS = 4
"""Slices side by side in one picture."""


class _Slices:
    """Even slices along the third axis of an image, each with the outlines where meshes cut it.

    Attributes:
        numbers: which slices: even ones of those that the meshes reach, or of those that are not of one value.
        proportion: height of a slice over its width in the world, for voxels need not be cubes.
    """

    def __init__(
        self, values: Array, world_from_voxel: Array, meshes: Iterable[Mesh], count: int, colours: Sequence[str]
    ) -> None:
        """Transform the meshes to voxel coordinates, whose third is the number of the slice."""
        self._values, self._colours, self._window = values, colours, _window(values)
        self._outlines = [Mesh(_to_voxels(mesh.vertices, world_from_voxel), mesh.faces) for mesh in meshes]
        steps = voxel_spacing(world_from_voxel)
        self._aspect = steps[1] / steps[0]
        self.proportion = self._aspect * values.shape[1] / values.shape[0]
        reached = [mesh.vertices[:, 2] for mesh in self._outlines] or [_uneven(values)]
        self.numbers = _levels(np.concatenate(reached), values.shape[2], count)

    def draw(self, axes: Any, number: int) -> None:
        """Draw a slice in grey, and the outlines over it."""
        low, high = self._window
        grey = np.clip((self._values[:, :, number] - low) / (high - low), 0, 1) ** GAMMA
        # transposed: images have rows first, voxels i first; the aspect is that of a voxel
        axes.imshow(grey.T, cmap="gray", origin="lower", aspect=self._aspect, vmin=0, vmax=1)
        axes.set_axis_off()
        axes.set(xticks=[], yticks=[])  # what is not shown would still be laid out
        widths = WIDTHS if len(self._outlines) > 1 else (ALONE,)
        for mesh, colour, width in zip(self._outlines, self._colours, widths):
            _draw_outline(axes, mesh, float(number), colour, width)


def slices_png(
    values: Array, world_from_voxel: Array, meshes: Mapping[str, Mesh], title: str, count: int = 12
) -> bytes:
    """The PNG of even slices along the third axis of an image, four side by side, with the outlines of meshes.

    Args:
        values: (i, j, k) image.
        world_from_voxel: (4, 4), to the frame of the meshes.
        meshes: name -> surface in the world.
        title: stands above; name the source of the image in it.
        count: how many slices, spread over what the meshes reach.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    slices = _Slices(values, world_from_voxel, meshes.values(), count, COLOURS)
    rows = -(-count // COLUMNS)  # rounded up
    figure = Figure(figsize=(11, 0.6 + 2.9 * rows * slices.proportion))
    figure.suptitle(title, fontsize=10)
    for position, number in enumerate(slices.numbers, 1):
        axes = figure.add_subplot(rows, COLUMNS, position)
        slices.draw(axes, number)
        axes.set_title(f"slice {number}", fontsize=8, pad=2)
    handles = [Line2D([], [], color=colour) for colour, _ in zip(COLOURS, meshes)]
    figure.legend(handles, list(meshes), loc="lower center", ncols=len(meshes), frameon=False, fontsize=9)
    # room for the legend below the slices
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    return png(figure, 110)


def slice_pictures(
    values: Array,
    world_from_voxel: Array,
    meshes: Iterable[Mesh],
    count: int = 12,
    colours: Sequence[str] = COLOURS,
) -> dict[int, bytes]:
    """Pictures of even slices along the third axis, without any text in them: number of the slice -> bytes of a PNG.

    Args:
        values: (i, j, k) image.
        world_from_voxel: (4, 4), to the frame of the meshes.
        meshes: surfaces in the world whose outlines are drawn; the slices spread over what they reach, or over those
            that are not of one value.
        count: how many slices at most.
        colours: of the outlines.
    """
    from matplotlib.figure import Figure

    slices = _Slices(values, world_from_voxel, meshes, count, colours)
    pictures = {}
    for number in slices.numbers:
        figure = Figure(figsize=(2.0, 2.0 * slices.proportion))
        slices.draw(figure.add_axes((0, 0, 1, 1)), number)
        pictures[number] = png(figure, 150)
    return pictures


def planes_section(volume: Volume, meshes: Mapping[str, Mesh], title: str) -> Section:
    """Three slices along each axis of an image, with the outlines of the meshes; `title` names the image."""
    rows = Markup("")
    for axis, letter in enumerate("ijk"):
        # the axis that is cut becomes the last one, and the columns of the affine follow it
        order = [other for other in range(3) if other != axis] + [axis]
        affine = volume.world_from_voxel[:, [*order, 3]]
        found = slice_pictures(volume.values.transpose(order), affine, meshes.values(), 3)
        slices = {f"{letter} = {number}": data for number, data in found.items()}
        rows += tiles(
            [(name, image(data, f"slice {name} with the outlines")) for name, data in slices.items()], "thirds"
        )
    words = f"{title}: slices across the three axes of the image, with the contours of the model."
    return Section("Slices", figure(rows + legend(zip(meshes, COLOURS)), words))


def _window(values: NDArray[Any]) -> tuple[float, float]:
    """The values that are shown black and white; a small label needs all of them, an even image any two."""
    low, high = (float(value) for value in np.percentile(values, [1, 99.5]))
    if low == high:
        low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + 1.0


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


def _draw_outline(axes: Any, mesh: Mesh, k: float, colour: str, width: float) -> None:
    from matplotlib.collections import LineCollection
    from trimesh import Trimesh
    from trimesh.intersections import mesh_plane

    shell = Trimesh(mesh.vertices, mesh.faces, process=False)
    lines = mesh_plane(shell, (0, 0, 1), (0, 0, k + 1e-6))  # beside the level: vertices on it would count twice
    drawn = LineCollection([line[:, :2] for line in lines], colors=colour, linewidths=width)
    axes.add_collection(drawn, autolim=False)  # the limits are those of the image
