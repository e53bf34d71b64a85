"""The long axis of the left ventricle, from the apex to the base, and the plane at the base, in every frame."""

from dataclasses import dataclass

import numpy as np

from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.heart.base import BaseRule, plane_through
from quadriform.heart.heart_cycle import HeartCycle
from quadriform.heart.volumes import section_centre, volume_below
from quadriform.points import Array
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

Planes = tuple[BasePlane | None, ...]
"""One a frame; None for a closed surface."""
EMPTY = 1e-6
"""A base leaves nothing when it leaves less than this fraction of the cavity."""
AMBIGUOUS = 0.05
"""Ends of the cavity whose volumes differ by a smaller fraction do not determine which is the apex."""


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

    def fractions(self, points: Array) -> Array:
        """Return the positions (n,) of points (n, 3) along the axis as fractions of its length from the apex."""
        return (points - self.apex) @ self.direction / self.length

    def across(self, vectors: Array) -> Array:
        """Return the component (n, 3) of vectors (n, 3) that is perpendicular to the axis."""
        return vectors - (vectors @ self.direction)[:, None] * self.direction

    def plane(self, fraction: float) -> BasePlane:
        """Return the plane across the axis at a fraction of its length from the apex."""
        return BasePlane(self.apex + fraction * (self.base - self.apex), self.direction)


def cavity_ends(model: DeformableModel, cavity: str, warnings: Warnings) -> Array:
    """Return the ends (2, 3) of the longest semi-axis of the cavity before deformation, the apex first.

    The apex is the narrower end: the outer quarter of the deformed axis contains less of the cavity there.

    Args:
        model: of the frame in which the ends are compared.
        cavity: name of its surface.
        warnings: APEX_AMBIGUOUS is added when both quarters have the same volume to 5 %.
    """
    superquadric = model.superquadric(cavity)
    # a ventricle is longest from apex to base, so this is the longest semi-axis of its superquadric
    longest = int(superquadric.semi_axes.argmax())
    end = superquadric.project(superquadric.translation + superquadric.rotation[:, longest][None])[0]
    ends = np.stack([2 * superquadric.translation - end, end])
    axis, mesh = LongAxis(*model.deform(ends)), model.mesh(cavity)
    low, below = (volume_below(mesh, axis.plane(fraction)) for fraction in (0.25, 0.75))
    high = mesh.volume() - below
    if abs(high - low) <= AMBIGUOUS * max(high, low):
        warnings[WarningKind.APEX_AMBIGUOUS] = (
            "both ends of the cavity are equally wide, so the apex may be the other one; give the base"
        )
    return ends if low <= high else ends[::-1]


def axis_to_base_plane(mesh: Mesh, plane: BasePlane) -> LongAxis:
    """Return the long axis for a given base: from the farthest point of the cavity to the centre of the base.

    The centre is the centre of area of the cavity's section with the plane.

    Args:
        mesh: of the cavity.
        plane: the base.

    Raises:
        OptionError: the plane misses the cavity.
    """
    centre = section_centre(mesh, plane)
    if centre is None:
        raise OptionError("option base: the plane does not meet the cavity, so it has no middle of the base")
    # the apex is below the base: vertices above it have distance 0
    distances = np.where(plane.heights(mesh.vertices) < 0, np.linalg.norm(mesh.vertices - centre, axis=1), 0.0)
    return LongAxis(mesh.vertices[distances.argmax()], centre)


def base_planes(frames: HeartCycle, rule: BaseRule, warnings: Warnings) -> Planes:
    """Return the plane at the base in every frame, None for a closed surface.

    Args:
        frames: the models.
        rule: of the base.
        warnings: BASE_MISSES is added where nothing is cut off, and APEX_AMBIGUOUS.

    Raises:
        OptionError: nothing of the cavity is left in a frame.
        DegenerateError: mitral points on a line.
    """
    planes = tuple(_plane(frames, rule, number, warnings) for number in range(len(frames.models)))
    uncut = [number for number, plane in enumerate(planes) if plane and not _meets_cavity(frames, number, plane)]
    if uncut and rule.fraction is None:
        warnings[WarningKind.BASE_MISSES] = (
            f"the base cuts nothing off the cavity in {len(uncut)} of {len(planes)} frames, the first is {uncut[0]}; "
            "there the whole closed surface counts"
        )
    return planes


def _plane(frames: HeartCycle, rule: BaseRule, number: int, warnings: Warnings) -> BasePlane | None:
    if rule.mitral_points is not None:
        centre = frames.models[number].mesh(frames.cavity, 8).vertices.mean(axis=0)
        return plane_through(rule.mitral_points[number], centre)
    if rule.planes is not None:
        return rule.planes[number]
    if rule.fraction is not None:
        return superquadric_axis(frames, number, warnings).plane(rule.fraction)
    return rule.fixed


def superquadric_axis(frames: HeartCycle, number: int, warnings: Warnings) -> LongAxis:
    """Return the deformed longest axis of the cavity's superquadric.

    Which end is the apex is determined in frame 0 where all frames have the same undeformed space, so that it is the
    same end in all of them; otherwise in the frame itself.
    """
    compared = frames.models[0 if frames.material else number]
    return LongAxis(*frames.models[number].deform(cavity_ends(compared, frames.cavity, warnings)))


def _meets_cavity(frames: HeartCycle, number: int, plane: BasePlane) -> bool:
    """Whether the plane meets the cavity of a frame.

    Raises:
        OptionError: the whole cavity lies beyond it.
    """
    # a plane on the wrong side, or with the wrong direction, leaves nothing
    mesh = frames.models[number].mesh(frames.cavity, frames.resolution)
    if volume_below(mesh, plane) <= EMPTY * mesh.volume():
        raise OptionError(
            f"option base: nothing of the cavity is left in frame {number}; expected a plane through its base, with "
            "the direction leading to the side that is cut off"
        )
    return section_centre(mesh, plane) is not None


def long_axis(frames: HeartCycle, number: int, rule: BaseRule, plane: BasePlane | None, warnings: Warnings) -> LongAxis:
    """Return the long axis of a frame, from the apex to the centre of the base; the wall is measured along it.

    With a base: from the farthest point of the cavity to the centre of its section. With a fraction: that part of the
    longest axis of the superquadric. Of a closed surface: the whole axis.
    """
    if plane is not None and rule.fraction is None and _meets_cavity(frames, number, plane):
        return axis_to_base_plane(frames.cavity_mesh(number), plane)
    # a base that misses the cavity determines no axis
    axis = superquadric_axis(frames, number, warnings)
    return axis if rule.fraction is None else LongAxis(axis.apex, axis.plane(rule.fraction).point)
