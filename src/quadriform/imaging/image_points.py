"""Points on the surface of an object in an image (paper section 5), and the slices that they lie in.

By the slice of each point `track` corrects slices that are displaced in their plane: each slice is recorded in a
breath-hold of its own, and displaced as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import MaskError, OptionError, WarningKind, Warnings, choose
from quadriform.imaging.isosurface import Border, edge_noise, grey_of_object, isosurface
from quadriform.imaging.object_choice import Labels, Percentile, Select, choose_object
from quadriform.imaging.open_cavity import fill_open_cavity
from quadriform.imaging.segmentation import Component, Segmentation, segment
from quadriform.imaging.volume import Region, Volume, index_of
from quadriform.imaging.voxel_faces import BACKGROUND, CAVITY, faces_between
from quadriform.point_sets import PointSet
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.solid import Solid
from quadriform.shapes.voxels import voxel_spacing
from quadriform.words import short_repr

FACING_CENTRE = 0.2
"""Fraction of the surface; of brains and ventricles at most 0.11 faces the centre, of walls of hearts 0.23."""
CLOSED_WALL = 0.05
"""From this fraction of an object and its holes on, enclosed holes make it a wall with two sides, which is refused: the
points of the inner side, an eighth of all, are too many to be outliers."""
ONE_END = 0.2
"""Least mean resultant length of the area vectors of a cavity's opening: at least 1 / sqrt(3) for one flat opening,
half of that with the steps of voxels around a thin wall, and 0 for a ring, whose two ends cancel."""
LISTED = 10
"""The number of component sizes that are recorded; noise has thousands."""
CAP, BETWEEN = -1, -2
"""The slice numbers of points that lie in no slice: beyond the first or the last outline, and between two slices."""
ON_SLICE = 1e-3
"""A point this near to a slice, in slice distances, lies in it."""
SAME_SPACING = 1e-3
"""Spacings that differ by a smaller fraction are equal."""


@dataclass(frozen=True, repr=False)
class ImagePoints:
    """Points on the surface of an object in an image.

    Attributes:
        points: (n, 3), in the world of the image: LPS mm for one that was read from a file.
        on_border: (n,) bool, points that close the object where the image cuts it, and are no measurements.
        mesh: the isosurface whose vertices the points are.
        segmentation: the object.
        warnings: of reading, segmentation and isosurface.
        record: options and results; numbers, strings and lists.
        noise: (n, 3, 3) covariances of points halfway between voxels, as `edge_noise` gives them; None with
            surface="grey", whose points are interpolated.
    """

    __repr__ = short_repr

    points: Array
    on_border: NDArray[np.bool_]
    mesh: Mesh
    segmentation: Segmentation
    warnings: Warnings
    record: dict[str, Any]
    noise: Array | None = None

    @property
    def cloud(self) -> PointSet:
        """The points with their noise and the object, as an argument of `fit`."""
        return PointSet(self.points, noise=self.noise, solid=self.solid)

    @property
    def solid(self) -> Solid:
        """The object; where it is left open at the border of the image, nothing is known of what lies beyond."""
        found = self.segmentation.object_volume()
        return Solid(found.values > 0, found.world_from_voxel, self.record["border"] == "close")


def points_from_image(
    volume: Volume,
    *,
    select: Select = "auto",
    region: Region | None = None,
    component: Component = "largest",
    connectivity: Literal[6, 26] = 26,
    closing: int = 0,
    fill_holes: bool = False,
    surface: Literal["mask", "grey"] = "mask",
    border: Border | None = None,
) -> ImagePoints:
    """Return the vertices of the isosurface of a segmented object (paper section 5).

    Args:
        volume: grey image, mask or label image.
        select: a value, `Percentile(fraction, of)`, "otsu" or `Labels(values)`; objects are above a threshold. "auto"
            decides by the whole image, by the rules of `quadriform.imaging.object_choice`.
        region: half-open ranges of voxels ((i0, i1), (j0, j1), (k0, k1)); None is the whole image.
        component: "largest", "all", or a voxel (i, j, k) of the component.
        connectivity: 26 or 6.
        closing: number of dilations, then of erosions, with the 6-connected cross.
        fill_holes: fill what the object encloses; otherwise the walls of holes give points too.
        surface: "mask" puts points halfway between voxels; "grey" where the image crosses the threshold.
        border: "open" gives no points where the image cuts the object, "close" closes it there, so that its volume is
            that within the image. None: labels and masks are closed, objects above a threshold left open.

    Raises:
        MaskError: no object or everything, labels missing or not whole, a seed in the background, a wall that is
            closed all around.
        DegenerateError: the object is one voxel, or one slice thick.
        OptionError: an option is unknown or out of its range.
    """
    choose(surface, ("mask", "grey"), "surface")
    select, notes = choose_object(volume) if select == "auto" else (select, ())
    if surface == "grey" and isinstance(select, Labels):
        raise OptionError("option surface='grey' needs a threshold, and labels have none; use surface='mask'")
    morphology: dict[str, Any] = {"connectivity": connectivity, "closing": closing, "fill_holes": fill_holes}
    segmentation = segment(volume, select=select, region=region, component=component, **morphology)
    height, level = _image_and_level(segmentation, surface)
    border = border or ("close" if isinstance(select, Labels) else "open")
    result = isosurface(height, level, border=border)
    chosen = {
        "select": _recorded(select),
        "component": component if isinstance(component, str) else [*map(int, component)],
    }
    options = chosen | morphology | {"surface": surface, "isolevel": level, "border": border, "notes": list(notes)}
    warnings = segmentation.warnings | result.warnings | _hollow(segmentation, result.mesh, fill_holes)
    record = options | _results(segmentation)
    points = result.mesh.vertices
    noise = None if surface == "grey" else edge_noise(volume, points)
    return ImagePoints(points, result.on_border, result.mesh, segmentation, warnings, record, noise)


def _hollow(found: Segmentation, mesh: Mesh, filled: bool) -> Warnings:
    """HOLLOW where much of the surface faces the centre of the object, as the inner side of a wall does.

    Raises:
        MaskError: the wall is closed all around, so that its two sides are two surfaces.
    """
    holes, facing = found.hole_voxels, _fraction_facing_centre(mesh)
    # two closed sides would be fitted by one surface between them
    if not filled and holes >= CLOSED_WALL * (int(found.mask.sum()) + holes):
        raise MaskError(
            f"the object is a wall around {holes} voxels: its two sides are two surfaces; take the outer one with "
            "--fill-holes (fill_holes=True)"
        )
    if facing < FACING_CENTRE:
        return {}
    return {
        WarningKind.HOLLOW: f"{facing:.0%} of the surface faces the middle of the object, as in a ring or a cup: one "
        "closed surface cannot follow both sides of a wall; give each side as a surface, such as endo and epi"
    }


def outer_side(found: ImagePoints) -> ImagePoints:
    """Return the points of the outer side of a wall around a cavity that is open at one end, closed across the opening.

    One closed surface can follow one of the two sides only. Of an object above a threshold the points are where the
    image crosses it. Other objects, such as rings, are returned as they are.
    """
    wall = found.segmentation.object_volume()
    try:
        tissue = fill_open_cavity(wall.values > 0, wall.world_from_voxel)
    except MaskError:
        return found
    # beyond the image is background too
    opening = faces_between(np.pad(tissue, 1), CAVITY, BACKGROUND, wall.world_from_voxel)[1]
    if _resultant_length(opening) < ONE_END:
        return found
    whole = np.zeros_like(found.segmentation.mask)
    whole[index_of(found.segmentation.region)] = tissue != BACKGROUND
    segmentation = replace(found.segmentation, mask=whole)
    height, level = _image_and_level(segmentation, "grey")
    result = isosurface(height, level, border=found.record["border"])
    noise = edge_noise(segmentation.volume, result.mesh.vertices) if segmentation.threshold is None else None
    text = (
        f"the object is a wall around a cavity of {int((tissue == CAVITY).sum())} voxels that is open at one end: its "
        "outer side was taken, closed across the opening; give each side as a surface, such as endo and epi, or let "
        "--perfusion find both"
    )
    warnings, record = found.warnings | {WarningKind.HOLLOW: text}, found.record | _results(segmentation)
    return ImagePoints(result.mesh.vertices, result.on_border, result.mesh, segmentation, warnings, record, noise)


def _resultant_length(areas: Array) -> float:
    """Mean resultant length |sum of a| / sum of |a| of area vectors (n, 3): 1 where they are parallel, or none."""
    total = np.linalg.norm(areas, axis=1).sum()
    return float(np.linalg.norm(areas.sum(axis=0)) / total) if total > 0 else 1.0


def _fraction_facing_centre(mesh: Mesh) -> float:
    """The fraction of the area of a mesh whose outward normal points towards the centre of the surface."""
    areas, centroids = mesh.area_vectors(), mesh.vertices[mesh.faces].mean(axis=1)
    sizes = np.linalg.norm(areas, axis=1)
    if not sizes.sum() > 0:
        return 0.0
    centre = sizes @ centroids / sizes.sum()
    # a triangle faces the centre where the vector from there and its outward area vector are opposed
    inward = ((centroids - centre) * areas).sum(axis=1) < 0
    return float(sizes[inward].sum() / sizes.sum())


def _image_and_level(found: Segmentation, surface: str) -> tuple[Volume, float]:
    """The image whose isosurface is taken, and its level."""
    mask = found.object_volume()
    if surface == "mask" or found.threshold is None:
        return mask, 0.5
    return grey_of_object(mask, found.volume.crop(found.region), found.threshold), found.threshold


def _results(segmentation: Segmentation) -> dict[str, Any]:
    return {
        "region": [list(pair) for pair in segmentation.region],
        "threshold": segmentation.threshold,
        "components_found": len(segmentation.component_voxels),
        "components_kept": segmentation.components_kept,
        "largest_components": list(segmentation.component_voxels[:LISTED]),
        "voxels": int(segmentation.mask.sum()),
        "hole_voxels": segmentation.hole_voxels,
        "space": segmentation.volume.space,
        "unit": segmentation.volume.unit,
    }


def _recorded(select: Select) -> Any:
    if isinstance(select, Percentile):
        return {"percentile": select.of, "fraction": select.fraction}
    if not isinstance(select, Labels):
        return select
    return {"labels": [label if isinstance(label, str) else int(label) for label in select.values]}


def slice_axis(world_from_voxel: Array) -> int:
    """Return the axis, 0 to 2, across which an image is sliced: that of the largest spacing, of equal ones the last."""
    spacing = voxel_spacing(world_from_voxel)
    return int(np.flatnonzero(spacing >= (1 - SAME_SPACING) * spacing.max())[-1])


def slice_numbers(volume: Volume, points: Array) -> NDArray[np.int64]:
    """Return the slice of each point of an isosurface, (n,), counted from 0 along the slice axis; else CAP or BETWEEN.

    Points of an isosurface lie in slices, on their outlines, or between two slices, where one voxel is inside and the
    other outside. The latter belong to neither slice: where slices moved, the steps from one to the next are no
    measurement of the wall. On caps the surface faces along the slice axis, and has no information about shifts.

    Args:
        volume: the image.
        points: (n, 3), in its world.
    """
    along = volume.voxels(points)[:, slice_axis(volume.world_from_voxel)]
    outlines = np.abs(along - np.rint(along)) < ON_SLICE
    # the outermost outlines; an isosurface that is closed ends half a voxel beyond them
    first, last = along[outlines].min(initial=np.inf), along[outlines].max(initial=-np.inf)
    caps = (along < first) | (along > last)
    return np.where(outlines, np.rint(along), np.where(caps, CAP, BETWEEN)).astype(np.int64)
