"""The measures of the wall: thickness, thickening, strain and twist, of the whole wall and of its segments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.heart.aha_segments import NAMES, AhaSegmentation
from quadriform.heart.heart_cycle import HeartCycle
from quadriform.heart.measures_table import Row
from quadriform.heart.twist import DEPTH, LEVELS
from quadriform.heart.wall import Wall
from quadriform.heart.wall_motion import ReferenceWall, relative_lengthening
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

NOT_OBSERVED = "not observed: surfaces have no material points, so the regularisation alone determines this; "
DIRECTIONS = ("radial", "circumferential", "longitudinal")
ALONG_MAP = "along the volumetric map from endo to epi, mean over the area of the wall"
SOURCE = "Young and Cowan 2012"


@dataclass(frozen=True)
class Contraction:
    """The wall at end systole: thickness (n,) of its lines, and Green's strain (n, 4, 3, 3)."""

    thickness: Array
    strain: Array


def wall_rows(
    frames: HeartCycle,
    reference: ReferenceWall,
    ed: int,
    es: int | None,
    rv_inserts: ArrayLike | None,
    observed: bool,
    warnings: Warnings,
) -> list[Row]:
    """Return rows of the wall.

    Args:
        frames: the models, with an "epi".
        reference: the wall at end diastole.
        ed: frame of end diastole.
        es: frame of end systole; None where there is one frame.
        rv_inserts: (n, 3), or None.
        observed: whether material points were tracked.
        warnings: UNANCHORED is added.

    Raises:
        OptionError: insertions that determine no septum.
    """
    wall = reference.wall
    parts = {"": np.ones(len(wall.rays), dtype=bool)} | _segments(frames, reference, ed, rv_inserts, warnings)
    # thickening, strain and twist need material points: the same undeformed space in both frames
    contraction, rows = None, []
    if es is not None and frames.material:
        later = frames.models[es].box
        contraction = Contraction(wall.thickness(later), reference.strain(later))
        rows = _twist_rows(frames, reference, later, contraction.strain, observed)
    measured = [_part_rows(frames, reference, contraction, name, lines, observed) for name, lines in parts.items()]
    return [*measured[0], *rows, *(row for part in measured[1:] for row in part)]


def wall_between(surfaces: Mapping[str, Superquadric], resolution: int, warnings: Warnings) -> Wall:
    """Return the wall between "endo" and "epi", before deformation.

    Args:
        surfaces: by name.
        resolution: of its lines, as in `Wall.between`.
        warnings: FOLDING is added where the surfaces cross.

    Raises:
        OptionError: swapped surfaces.
    """
    wall = Wall.between(surfaces["endo"], surfaces["epi"], resolution)
    if wall.crossing.any():
        warnings[WarningKind.FOLDING] = (
            f"'endo' crosses 'epi' in {100 * wall.crossing.mean():.1f} % of its directions; no wall is measured there"
        )
    return wall


def _segments(
    frames: HeartCycle, reference: ReferenceWall, ed: int, rv_inserts: ArrayLike | None, warnings: Warnings
) -> dict[str, NDArray[np.bool_]]:
    """The lines (n,) of each segment; segments without wall are left out."""
    if rv_inserts is None:  # nothing in a ventricle of revolution determines where the septum is
        segments = AhaSegmentation.unanchored(reference.axis, frames.models[ed].surfaces["endo"])
        warnings[WarningKind.UNANCHORED] = (
            "without RV insertion points the segments start at an arbitrary angle: their rings are right, their names "
            "are not"
        )
    else:
        segments = AhaSegmentation.anchored(reference.axis, rv_inserts)
    numbers = segments.numbers(reference.box.deform(reference.wall.at(DEPTH)))
    has_wall = reference.areas > 0
    label = "segment" if rv_inserts is not None else "unanchored segment"
    lines = {f"{label} {k + 1}, {name}: ": has_wall & (numbers == k + 1) for k, name in enumerate(NAMES)}
    return {name: mask for name, mask in lines.items() if mask.any()}


def _part_rows(
    frames: HeartCycle,
    reference: ReferenceWall,
    contraction: Contraction | None,
    part: str,
    lines: NDArray[np.bool_],
    observed: bool,
) -> list[Row]:
    """Thickness, and with a contraction thickening and strain, of a part of the wall."""
    # lines represent different areas of the wall
    weights = reference.areas * lines
    before = float(weights @ reference.thickness / weights.sum()) * frames.millimetres
    rows = [Row(f"{part}wall thickness, end diastole", before, "mm", ALONG_MAP)]
    if contraction is None:
        return rows
    after = float(weights @ contraction.thickness / weights.sum()) * frames.millimetres
    rows.append(Row(f"{part}wall thickness, end systole", after, "mm", ALONG_MAP))
    rows.append(Row(f"{part}wall thickening", 100 * (after / before - 1), "%", f"{ALONG_MAP}, of the one at ED"))
    radial = 100 * float(weights @ _radial(reference, contraction.thickness) / weights.sum())
    # radial strain is a mean of ratios, thickening the ratio of means
    how = "change of length from ED to ES per length, of the lines along the volumetric map, mean over the wall's area"
    rows.append(Row(f"{part}radial strain", radial, "%", how))
    return rows + _strain_rows(reference, contraction.strain, part, lines[:, None], observed)


def _radial(reference: ReferenceWall, thickness: Array) -> Array:
    """Change of length per length (n,) of the lines across the wall; 0 where the surfaces cross."""
    return np.where(~reference.wall.crossing, thickness / np.maximum(reference.thickness, 1e-300) - 1, 0.0)


def _strain_rows(
    reference: ReferenceWall, strain: Array, part: str, where: NDArray[np.bool_], observed: bool
) -> list[Row]:
    """Strain from the gradient; without tracked points the regularisation alone determines it along the wall."""
    prefix = "" if observed else NOT_OBSERVED
    around = 100 * float(reference.mean(relative_lengthening(strain), where)[1])
    how = f"{prefix}change of length from ED to ES per length, from the gradient, mean over the volume of the wall"
    rows = [Row(f"{part}circumferential strain", around, "%", how, observed)]
    how = f"{prefix}(F'F - I) / 2 from ED to ES, mean over the volume of the wall"
    # the tensor is averaged along local axes, so that components keep their directions. The longitudinal one is the
    # strain of the tissue; the global longitudinal strain (GLS), of contours, is the row of `measure.py`
    green = np.diagonal(reference.mean(strain, where))
    return rows + [
        Row(f"{part}Green strain, {name}", float(value), "1", how, observed) for name, value in zip(DIRECTIONS, green)
    ]


def _twist_rows(
    frames: HeartCycle, reference: ReferenceWall, later: ControlBox, strain: Array, observed: bool
) -> list[Row]:
    """Twist in the four published definitions."""
    twist = reference.slices.twist(later)
    shear = reference.mean(strain[..., 1, 2], reference.between_slices())
    levels = f"at {LEVELS[0]:g} and {LEVELS[1]:g} of the long axis, counter-clockwise from the apex; {SOURCE}"
    # Young and Cowan: torsion is comparable between hearts only per length, or as a shear
    per_mm = twist.angle_per_length / frames.millimetres
    found = [
        ("twist angle", twist.angle, "deg", f"rotation of the apical minus the basal slice, {levels}"),
        ("twist per length", per_mm, "deg/mm", f"the angle over the distance of the slices at ED, {levels}"),
        ("torsional shear angle", twist.shear_angle, "deg", f"the angle times mid-wall radius / distance, {levels}"),
        ("torsional shear strain", float(shear), "1", f"Green strain E_CL, mean between the slices {levels}"),
    ]
    prefix = "" if observed else NOT_OBSERVED
    return [Row(name, value, unit, prefix + how, observed) for name, value, unit, how in found]


def wall_curves(frames: HeartCycle, reference: ReferenceWall) -> dict[str, Array]:
    """Return thickness (mm), strains (%) and twist (degrees) of the whole wall over the cycle."""
    everywhere = np.ones((len(reference.volumes), 1), dtype=bool)
    weights = reference.areas / reference.areas.sum()
    curves: dict[str, list[float]] = {"wall thickness": [], "radial strain": [], "circumferential strain": []}
    for box in (model.box for model in frames.models):
        thickness = reference.wall.thickness(box)
        around = reference.mean(relative_lengthening(reference.strain(box)), everywhere)[1]
        curves["wall thickness"].append(float(weights @ thickness) * frames.millimetres)
        curves["radial strain"].append(100 * float(weights @ _radial(reference, thickness)))
        curves["circumferential strain"].append(100 * float(around))
    twist = [reference.slices.twist(model.box).angle for model in frames.models]
    return {name: np.array(values) for name, values in (curves | {"twist angle": twist}).items()}
