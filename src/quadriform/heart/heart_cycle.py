"""The models of a beating heart, one a frame, checked before anything is measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from quadriform.columns import MILLIMETRES
from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.heart.volumes import volume
from quadriform.motion.frames import checked_times
from quadriform.points import Array
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

RESOLUTION = 24
"""Of the meshes and lines that estimates are measured on. Volumes and contours take finer ones: see `HeartCycle`."""
OF_SAMPLES = 12
"""The same for samples of the posterior, of which there are many: deviations need fewer digits than values."""
OF_CURVES = 6
"""The same for samples of all frames, of which there are more."""
SAME = 1e-9
"""Superquadrics and boxes that differ by less than this fraction of their size are the same."""


@dataclass(frozen=True)
class HeartCycle:
    """Models in the order of time.

    Attributes:
        models: one a frame.
        times: (F,), increasing.
        cavity: name of the surface around the cavity.
        outer: name of the surface around the wall, the epicardium; None where there is only the cavity.
        material: whether all frames have the same undeformed space, so that a point of it is one material point.
        millimetres: length of one unit of the models, in mm.
        warnings: kind -> sentence.
        resolution: of the lines across the wall. Volumes are taken from meshes 4/3 and 8/3 times as fine, contours and
            the long axis from twice as fine ones.
    """

    models: tuple[DeformableModel, ...]
    times: Array
    cavity: str
    outer: str | None
    material: bool
    millimetres: float
    warnings: Warnings
    resolution: int = RESOLUTION

    @property
    def ml(self) -> float:
        """Millilitres of a cubed unit of length."""
        return self.millimetres**3 / 1000

    def volume(self, number: int, surface: str, plane: BasePlane | None) -> float:
        """Volume of a surface of a frame below a plane, in ml."""
        return self.ml * volume(self.models[number], surface, plane, 4 * self.resolution // 3)

    def cavity_mesh(self, number: int) -> Mesh:
        """A fine mesh of the cavity of a frame."""
        return self.models[number].mesh(self.cavity, 2 * self.resolution)


def check_cycle(models: Sequence[DeformableModel] | DeformableModel, times: ArrayLike | None) -> HeartCycle:
    """Return the models as one cycle.

    Args:
        models: with the surfaces "endo" and "epi", or with the cavity alone; in the order of time.
        times: (F,) in any unit; None: 0, 1, 2 ...

    Raises:
        OptionError: no model, no cavity, surfaces that differ in name or unit, times that do not increase.
    """
    given = (models,) if isinstance(models, DeformableModel) else tuple(models)
    if not given:
        raise OptionError("models: there are none; expected one model a frame")
    first = given[0]
    for number, model in enumerate(given):
        if model.surfaces.keys() != first.surfaces.keys() or (model.unit, model.space) != (first.unit, first.space):
            raise OptionError(
                f"models: frame {number} has the surfaces {', '.join(model.surfaces)} in {model.unit} {model.space}, "
                f"frame 0 {', '.join(first.surfaces)} in {first.unit} {first.space}; expected the same in all frames"
            )
    warnings: Warnings = {}
    cavity, outer = _names(first, warnings)
    if first.unit == "unknown":
        warnings[WarningKind.UNKNOWN_UNIT] = "the models have no unit of length; taken as mm"
    if len(given) == 1:
        warnings[WarningKind.ONE_FRAME] = "one frame: no ejection fraction, thickening, twist or strain"
    # a control point moves the same tissue in all frames only if undeformed boxes and superquadrics agree
    material = all(_same_undeformed(first, model) for model in given)
    if not material:
        warnings[WarningKind.SEPARATE_FRAMES] = (
            "the frames have superquadrics or boxes of their own, so no point of one is known in another: no "
            "thickening, twist or strain of the wall, only that of the length of contours; refine all frames from one "
            "superquadric, or track them together"
        )
    checked = checked_times(times, len(given))
    return HeartCycle(given, checked, cavity, outer, material, MILLIMETRES.get(first.unit, 1.0), warnings)


def _names(model: DeformableModel, warnings: Warnings) -> tuple[str, str | None]:
    # one surface of any name but "epi" is taken for the cavity
    names = list(model.surfaces)
    cavity = "endo" if "endo" in names else names[0] if len(names) == 1 and names != ["epi"] else None
    if cavity is None:
        raise OptionError(f"models: expected a surface 'endo' around the cavity, found {', '.join(names)}")
    if "epi" not in names:
        warnings[WarningKind.MISSING_SURFACE] = (
            "there is no surface 'epi': no mass, wall thickness, twist or strain of the wall"
        )
        return cavity, None
    for name in ("endo", "epi"):
        if not model.surfaces[name].is_radial:
            raise OptionError(f"models: {name} is of kind={model.surfaces[name].kind!r}; the wall needs 'ellipsoid'")
    return cavity, "epi"


def _same_undeformed(one: DeformableModel, other: DeformableModel) -> bool:
    """Whether superquadrics and undeformed boxes agree: lengths to a fraction of the size, other numbers absolutely."""
    size = float(np.linalg.norm(one.box.edges))
    pairs = [(one.box.edges, other.box.edges, size), (one.box.origin, other.box.origin, size)]
    for name, surface in one.surfaces.items():
        for field, scale in (("semi_axes", size), ("translation", size), ("exponents", 1.0), ("rotation", 1.0)):
            pairs.append((getattr(surface, field), getattr(other.surfaces[name], field), scale))
    return all(np.abs(a - b).max() <= SAME * scale for a, b, scale in pairs)
