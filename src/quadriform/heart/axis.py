"""The long axis of the left ventricle, and which of its ends is the apex."""

from dataclasses import dataclass

import numpy as np

from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.heart.base import BasePlane
from quadriform.heart.volumes import section_centre, volume_below
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel

ALIKE = 0.05
"""Ends of the cavity whose volumes differ by a smaller share do not tell the apex from the base."""


@dataclass(frozen=True)
class LongAxis:
    """From the apex of the cavity to the middle of its base.

    Attributes:
        apex: (3,), in the world.
        base: (3,), in the world.
    """

    apex: Array
    base: Array

    @property
    def length(self) -> float:
        """From apex to base, in the unit of the data."""
        return float(np.linalg.norm(self.base - self.apex))

    @property
    def direction(self) -> Array:
        """Unit vector (3,) from the apex to the base."""
        return (self.base - self.apex) / self.length

    def heights(self, points: Array) -> Array:
        """Where points (n, 3) lie along the axis, (n,): 0 at the apex, 1 at the base."""
        return (points - self.apex) @ self.direction / self.length

    def across(self, vectors: Array) -> Array:
        """The part (n, 3) of vectors (n, 3) that is perpendicular to the axis."""
        return vectors - (vectors @ self.direction)[:, None] * self.direction

    def plane(self, share: float) -> BasePlane:
        """The plane across the axis at a share of its length from the apex."""
        return BasePlane(self.apex + share * (self.base - self.apex), self.direction)


def cavity_ends(model: DeformableModel, cavity: str, warnings: Warnings) -> Array:
    """Ends (2, 3) of the cavity's longest semi-axis before deformation, the apex first.

    The apex is the narrower end: the outer quarter of the deformed axis holds less of the cavity there.

    Args:
        model: the frame that decides.
        cavity: name of its surface.
        warnings: takes APEX_AMBIGUOUS when both quarters hold the same to 5 %.
    """
    superquadric = model.superquadric(cavity)
    longest = int(superquadric.semi_axes.argmax())
    reach = superquadric.project(superquadric.translation + superquadric.rotation[:, longest][None])[0]
    ends = np.stack([2 * superquadric.translation - reach, reach])
    axis, mesh = LongAxis(*model.deform(ends)), model.mesh(cavity)
    low, up_to = (volume_below(mesh, axis.plane(share)) for share in (0.25, 0.75))
    high = mesh.volume() - up_to
    if abs(high - low) <= ALIKE * max(high, low):
        warnings[WarningKind.APEX_AMBIGUOUS] = (
            "both ends of the cavity are equally wide, so the apex may be the other one; give the base"
        )
    return ends if low <= high else ends[::-1]


def axis_to_base_plane(model: DeformableModel, cavity: str, plane: BasePlane) -> LongAxis:
    """The long axis when the base is known: from the farthest point of the cavity to the middle of the base.

    The middle is the centre of area of the cavity's section with the plane.

    Raises:
        OptionError: the plane misses the cavity.
    """
    mesh = model.mesh(cavity, 48)
    middle = section_centre(mesh, plane)
    if middle is None:
        raise OptionError("option base: the plane does not meet the cavity, so it has no middle of the base")
    away = np.where(plane.heights(mesh.vertices) < 0, np.linalg.norm(mesh.vertices - middle, axis=1), 0.0)
    return LongAxis(mesh.vertices[away.argmax()], middle)
