"""Points of the endocardium and epicardium of a left ventricle from an image, none where the image cuts it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from warnings import warn

import numpy as np

from quadriform.errors import MaskError, OptionError, WarningKind, Warnings
from quadriform.imaging.isosurface import edge_noise, grey_of_object, isosurface
from quadriform.imaging.object_choice import Labels, Percentile, Select
from quadriform.imaging.open_cavity import base_of_open_cavity, fill_open_cavity
from quadriform.imaging.segmentation import Component, Mask, Segmentation, segment
from quadriform.imaging.stack_end import End, closed_but_for, flat_end, open_face, region_up_to
from quadriform.imaging.thinning import default_spacing, thinned
from quadriform.imaging.volume import Region, Volume, index_of
from quadriform.imaging.voxel_faces import (
    BACKGROUND,
    CAVITY,
    WALL,
    Tissue,
    border_cut_text,
    contact_area,
    enclosed_fraction,
    face_area_vectors,
)
from quadriform.points import Array, check_number, check_points, unit_vectors
from quadriform.shapes.landmarks import GIVEN_BASE, BasePlane, Landmarks, check_base
from quadriform.shapes.solid import DISPLACED, Solid
from quadriform.words import short_repr

PointAndDirection = tuple[Array, Array]
"""A point (3,) of the base plane and its normal (3,) away from the apex, in world coordinates: the `base` of `fit`."""

HALF = Percentile(0.5, 99.9)
OFF_CENTRE = 1e-5
"""No vertex is nearer to the centre of a voxel than this, in voxels: `isosurface.LEAST_EXCESS` has them farther off."""
ON_PLANE = 1e-9
"""Points beyond a plane by less than this fraction of the extent are on it."""
BELOW_FACE = 0.49
"""By this a point in the middle of a slice is moved towards its face, in voxels. The point keeps the error of the edge
in its slice, in whose middle, at 0.5, it lies: `isosurface.edge_noise` takes the axis along which a point is farthest
from a whole number of voxels, so this must be less than 0.5."""
OUTERMOST = 0.75
"""Points of the outermost slice lie 0.5 voxels inside its face, the next ones 1 voxel: the limit is between them."""
FACE, OPENING = "the outer face of the last slice with labels", "the opening of the wall"
"""The names of a base that was found in an image."""


@dataclass(frozen=True, repr=False)
class VentriclePoints:
    """Points on the endocardium and epicardium of a ventricle.

    Attributes:
        clouds: "endo", and "epi" where there is a wall, (n, 3) each, in world coordinates; an argument of `fit`.
        unthinned: the same before thinning.
        base: the plane beyond which points were removed, as given or found; None where there is none, as of a cavity
            that is rounded at both ends and inside the image, unless one is given.
        warnings: of reading and segmentation, BORDER_CUT, OPEN_BASE, and OPEN_WALL where the cavity touches the
            background inside the image, such as at a rounded end without wall.
        record: number of voxels of cavity and wall, number of points beyond the base by surface, spacing of the points;
            of labels also the number of voxels of the cavity outside its largest component, which are left out.
        cavity: the body that "endo" encloses on this side of the base, with which a fit is compared.
        noise: covariances (n, 3, 3) of the points of a label image by name, the `noise` of `fit`; None
            of a perfusion image.
        base_from: the name of the base, as in "below the outer face of ..."; empty without one.
    """

    __repr__ = short_repr

    clouds: dict[str, Array]
    unthinned: dict[str, Array]
    base: PointAndDirection | None
    warnings: Warnings
    record: dict[str, Any]
    cavity: Solid
    noise: dict[str, Array] | None = None
    base_from: str = ""

    @property
    def isosurfaces(self) -> dict[str, Array]:
        """Deprecated, the name of `unthinned` in earlier versions."""
        warn("isosurfaces is named unthinned; isosurfaces will be removed", DeprecationWarning, stacklevel=2)
        return self.unthinned

    @property
    def landmarks(self) -> Landmarks:
        """The base as a model stores it."""
        return Landmarks() if self.base is None else Landmarks(BasePlane(*self.base), self.base_from)


def ventricle_from_labels(
    volume: Volume,
    *,
    cavity: Labels,
    wall: Labels | None = None,
    region: Region | None = None,
    base: PointAndDirection | None = None,
    spacing: float | None = None,
    apart: float | None = None,
) -> VentriclePoints:
    """Return points of the endocardium, the boundary of the cavity, and of the epicardium, the outside of the wall.

    Points lie halfway between voxels. The ventricle is open, without points, at its base. This is the first of:

    1. A given `base`: a plane beyond which no point is taken.
    2. The outer face of the last slice with labels, where the cavity ends flat and open at one end of the slice axis
       (`stack_end.flat_end`, which does not check anatomy: where it takes the apex for the base, give `base`).
    3. The face of the image or region that cuts the largest area of the cavity.
    4. None, where nothing cuts a cavity that is rounded at both ends. Where the cavity meets the background, as at the
       valve plane, "endo" has points and "epi" has none.

    In cases 2 and 3 the points of the outermost slice, which lie half a voxel inside the face, are repeated just inside
    it, so that the volume up to the face is determined by data. At all other faces that cut the ventricle its surfaces
    are closed: volumes are those within the image.

    Args:
        volume: label image.
        cavity: labels of the blood.
        wall: labels of the muscle; without it there is no epicardium.
        region: half-open ranges of voxels, such as the slices below the base; its edge cuts like the image's.
        base: plane beyond which nothing is taken, in the world of the image.
        spacing: of the points kept, in the unit of the image: one for each cube of this side; 0 keeps all points. If
            None, the longest side of a voxel, halved while a surface has fewer than 750 points and half of it is not
            below the shortest side.
        apart: deprecated, the name of `spacing` in earlier versions.

    Raises:
        MaskError: labels are missing, or cavity and wall are swapped.
        DegenerateError: the cavity is one voxel or one slice thick.
        OptionError: the region leaves the image, `base` is no plane or has more than a quarter of the cavity's voxels
            beyond it, or both labels are the same.
    """
    labelled = labelled_tissue(volume, cavity, wall, region)
    return ventricle_up_to(labelled, labelled.flat_end if base is None else None, base, _renamed(spacing, apart))


@dataclass(frozen=True)
class LabelledTissue:
    """The tissue of each voxel of a region, by labels.

    Attributes:
        volume: the label image.
        cavity: labels of the blood.
        wall: labels of the muscle, or None.
        tissue: of the largest component of the cavity, and of the wall.
        region: half-open ranges of voxels.
        left_out: number of voxels of the cavity outside that component.
        warnings: of segmentation.
    """

    volume: Volume
    cavity: Labels
    wall: Labels | None
    tissue: Tissue
    region: Region
    left_out: int
    warnings: Warnings

    @property
    def flat_end(self) -> End | None:
        """The end of the slice axis at which the labels end flat and open, or None."""
        return flat_end(self.tissue, self.volume.world_from_voxel)

    def up_to(self, end: End) -> LabelledTissue:
        """Return the tissue of the region that ends with the labels of the cavity at one end."""
        return labelled_tissue(self.volume, self.cavity, self.wall, region_up_to(self.tissue, self.region, end))


def labelled_tissue(volume: Volume, cavity: Labels, wall: Labels | None, region: Region | None) -> LabelledTissue:
    """Return the tissues in a label image; arguments and errors as of `ventricle_from_labels`."""
    blood = segment(volume, select=cavity, region=region)
    tissue = _inside(blood).astype(np.int8) * CAVITY
    if wall is not None:
        tissue[_wall(volume, cavity, wall, blood.region) & (tissue != CAVITY)] = WALL
        _check_order(tissue, cavity, wall, volume.world_from_voxel)
    left_out = sum(blood.component_voxels) - int(_inside(blood).sum())
    return LabelledTissue(volume, cavity, wall, tissue, blood.region, left_out, dict(blood.warnings))


def ventricle_up_to(
    labelled: LabelledTissue, end: End | None, base: PointAndDirection | None = None, spacing: float | None = None
) -> VentriclePoints:
    """Return the points of a ventricle whose base is at a known end of its labels.

    Args:
        labelled: the tissue of each voxel.
        end: (axis, 0 or -1), the end of the slice axis at whose last labels the ventricle is cut; None: where the image
            cuts it, or at `base`.
        base, spacing: as of `ventricle_from_labels`, with its errors.
    """
    base = None if base is None else _unit_plane(base)
    cut = border_cut_text(labelled.tissue != BACKGROUND, labelled.volume.world_from_voxel)
    labelled = labelled if end is None else labelled.up_to(end)
    tissue, warnings, cropped = labelled.tissue, dict(labelled.warnings), labelled.volume.crop(labelled.region)
    face = open_face(tissue, cropped, end, base)
    plane = None if base is not None or face is None else _plane_of(face, tissue == CAVITY, cropped)
    warnings.pop(WarningKind.BORDER_CUT, None)  # of the cavity alone, and of a region that ends with its labels
    if cut:
        warnings[WarningKind.BORDER_CUT] = f"{cut}; left open at the base, closed elsewhere"
    if labelled.wall is not None:
        warnings |= _open_wall(tissue, cropped.world_from_voxel)
    tissue, cropped = closed_but_for(face, tissue, cropped)
    surfaces = {"endo": _surface(tissue == CAVITY, tissue, cropped)[0]}
    if labelled.wall is not None:
        points, ends = _surface(tissue != BACKGROUND, tissue, cropped)
        # an edge from cavity to background is the open base, not epicardium
        surfaces["epi"] = points[ends.max(axis=1) == WALL]
    if base is not None:
        plane = _check_edge(base, tissue, cropped)
    elif plane is not None:
        surfaces = {name: _up_to_face(points, plane, cropped) for name, points in surfaces.items()}
    found = _finish(surfaces, plane, warnings, tissue, cropped, spacing)
    found.record["left_out_voxels"] = labelled.left_out
    noise = {name: edge_noise(cropped, points) for name, points in found.clouds.items()}
    return replace(found, noise=noise, base_from=_base_from(plane, base, FACE))


def ventricle_from_perfusion(
    volume: Volume,
    *,
    select: Select = HALF,
    region: Region | None = None,
    component: Component = "largest",
    base: PointAndDirection | None = None,
    spacing: float | None = None,
    apart: float | None = None,
) -> VentriclePoints:
    """Return points of both surfaces of a bright wall that is open at the base: the horseshoe of a perfusion image.

    The cavity is the part of the wall's convex hull, outside the wall, that its largest inscribed balls cover (a
    morphological opening), which leaves out thin gaps between the wall and its hull. The isosurface of the wall is
    endocardium where it faces the cavity and epicardium elsewhere; across the base there is no wall, so no points.

    Args:
        volume: grey image with a bright wall.
        select: which voxels are wall; 50 % of the 99.9th percentile of the grey values: like the customary 50 % of the
            maximum, but independent of single bright voxels.
        region: half-open ranges of voxels about the ventricle.
        component: "largest", or a voxel (i, j, k) of the wall.
        base: plane beyond which nothing is taken. If None, it is estimated: parallel to the opening, moved towards the
            apex by half of the greatest thickness of the wall.
        spacing: as in `ventricle_from_labels`.
        apart: deprecated, the name of `spacing` in earlier versions.

    Raises:
        MaskError: nothing or everything is wall, or it encloses no cavity.
        OptionError: an option is out of its range.
    """
    found = segment(volume, select=select, region=region, component=component)
    cropped = volume.crop(found.region)
    tissue = fill_open_cavity(_inside(found), cropped.world_from_voxel)
    shown, level = found.object_volume(), 0.5
    if found.threshold is not None:
        level = found.threshold
        shown = grey_of_object(shown, cropped, level)
    points, ends = _vertices(shown, level, tissue)
    is_endo = ends.max(axis=1) == CAVITY
    is_epi = (ends == BACKGROUND).any(axis=1) & ~is_endo  # a dark spot within the wall is neither
    surfaces = {"endo": points[is_endo], "epi": points[is_epi]}
    if base is not None:
        base = _check_edge(_unit_plane(base), tissue, cropped)
    plane = base_of_open_cavity(tissue, cropped.world_from_voxel) if base is None else base
    result = _finish(surfaces, plane, dict(found.warnings), tissue, cropped, _renamed(spacing, apart))
    result = replace(result, base_from=_base_from(plane, base, OPENING))
    if base is not None:
        return result
    removed, total = sum(result.record["beyond_base"].values()), sum(map(len, surfaces.values()))
    text = f"the wall is open; {removed} of {total} points at its rim are left out"
    return replace(result, warnings={**result.warnings, WarningKind.OPEN_BASE: text})


def _base_from(plane: PointAndDirection | None, given: PointAndDirection | None, found: str) -> str:
    return "" if plane is None else found if given is None else GIVEN_BASE


def _renamed(spacing: float | None, apart: float | None) -> float | None:
    if apart is not None:
        warn("the option apart is named spacing; apart will be removed", DeprecationWarning, stacklevel=3)
    return spacing if apart is None else apart


def _inside(found: Segmentation) -> Mask:
    return found.mask[index_of(found.region)]


def _wall(volume: Volume, cavity: Labels, wall: Labels, region: Region) -> Mask:
    if set(cavity.values) & set(wall.values):
        raise OptionError(f"cavity={cavity.values} and wall={wall.values} share labels; expected other labels for each")
    return _inside(segment(volume, select=wall, region=region))


def _surface(mask: Mask, tissue: Tissue, cropped: Volume) -> tuple[Array, Tissue]:
    return _vertices(Volume(mask, cropped.world_from_voxel, cropped.space, cropped.unit), 0.5, tissue)


def _vertices(shown: Volume, level: float, tissue: Tissue) -> tuple[Array, Tissue]:
    """The isosurface's vertices (n, 3) and the tissues (n, 2) of the two voxels on whose edge each lies."""
    points = isosurface(shown, level).mesh.vertices
    voxels = shown.voxels(points)
    # a vertex is on an edge of the grid: rounding one coordinate down and up gives the ends of the edge
    ends = [np.rint(voxels + sign * (0.5 - OFF_CENTRE)).astype(np.int64) for sign in (-1, 1)]
    return points, np.stack([tissue[tuple(end.T)] for end in ends], axis=1)


def _check_order(tissue: Tissue, cavity: Labels, wall: Labels, world_from_voxel: Array) -> None:
    """Raise an error if the contact area of the cavity with the background exceeds that of the wall."""
    blood, muscle = (contact_area(tissue, kind, BACKGROUND, world_from_voxel) for kind in (CAVITY, WALL))
    if blood > muscle:
        raise MaskError(
            f"cavity={cavity.values} has a contact area of {blood:.4g} squared units with the background, "
            f"wall={wall.values} only {muscle:.4g}: expected the wall around the cavity; are the labels swapped?"
        )


def _open_wall(tissue: Tissue, world_from_voxel: Array) -> Warnings:
    """OPEN_WALL where the cavity touches the background inside the image."""
    open_fraction = 1 - enclosed_fraction(tissue, world_from_voxel)
    if open_fraction == 0:
        return {}
    text = f"{open_fraction:.1%} of the cavity's surface has no wall: it has no epicardial points there"
    return {WarningKind.OPEN_WALL: text}


def _plane_of(face: End, cavity: Mask, cropped: Volume) -> PointAndDirection:
    """The outer face of the outermost voxels of the cavity."""
    axis, which = face
    at = 0 if which == 0 else cavity.shape[axis] - 1
    voxels = np.insert(np.argwhere(cavity.take(at, axis)).astype(np.float64), axis, at, axis=1)
    normal = unit_vectors(face_area_vectors(cropped.world_from_voxel)[axis])
    direction = -normal if which == 0 else normal
    return cropped.points_world(voxels).mean(axis=0) + 0.5 * _height(direction, cropped) * direction, direction


def _height(direction: Array, image: Volume) -> float:
    """Of a voxel along the unit normal of one of its faces; its other edges are perpendicular to it."""
    return float(np.abs(direction @ image.world_from_voxel[:3, :3]).max())


def _up_to_face(points: Array, face: PointAndDirection, image: Volume) -> Array:
    """The points, and those of the outermost slice again just inside the face of the image."""
    position, direction = face
    height = _height(direction, image)
    outermost = points[(points - position) @ direction > -OUTERMOST * height]
    return np.concatenate([points, outermost + BELOW_FACE * height * direction])


def _unit_plane(base: PointAndDirection) -> PointAndDirection:
    point, direction = check_points(np.array(base), "base")
    if not direction.any():
        raise OptionError("option base: expected (point, direction) with a direction that is not 0")
    return point, direction / np.linalg.norm(direction)


def _check_edge(base: PointAndDirection, tissue: Tissue, cropped: Volume) -> PointAndDirection:
    """The plane, which is refused where it is no edge of the cavity, by its voxels: a flat end has many points."""
    check_base(BasePlane(*base), cropped.points_world(np.argwhere(tissue == CAVITY)))
    return base


def _finish(
    surfaces: dict[str, Array],
    plane: PointAndDirection | None,
    warnings: Warnings,
    tissue: Tissue,
    cropped: Volume,
    spacing: float | None,
) -> VentriclePoints:
    """The points without those beyond the plane, thinned."""
    kept = surfaces if plane is None else {name: points[~_cut_off(points, plane)] for name, points in surfaces.items()}
    for name, points in kept.items():
        if not len(points):
            raise MaskError(f"{name}: all {len(surfaces[name])} points lie beyond the base plane")
    side = default_spacing(kept, cropped.spacing) if spacing is None else check_number(spacing, "spacing", 0.0)
    record = {
        "cavity_voxels": int((tissue == CAVITY).sum()),
        "wall_voxels": int((tissue == WALL).sum()),
        "beyond_base": {name: len(surfaces[name]) - len(points) for name, points in kept.items()},
        "spacing": side,
    }
    clouds = {name: thinned(points, side) for name, points in kept.items()}
    cavity = Solid(tissue == CAVITY, cropped.world_from_voxel, least_dice=DISPLACED)
    return VentriclePoints(clouds, kept, plane, warnings, record, cavity)


def _cut_off(points: Array, plane: PointAndDirection) -> Mask:
    point, direction = plane
    heights = (points - point) @ direction
    return heights > ON_PLANE * np.abs(heights).max(initial=0)
