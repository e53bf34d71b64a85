"""The plane at the base and the long axis in every frame, by the rule for the base."""

from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.heart.axis import LongAxis, axis_to_base_plane, cavity_ends
from quadriform.heart.base import BasePlane, BaseRule, plane_through
from quadriform.heart.heart_cycle import HeartCycle
from quadriform.heart.volumes import section_centre, volume_below

Planes = tuple[BasePlane | None, ...]
"""One a frame; None for a closed surface."""
EMPTY = 1e-6
"""A base leaves nothing when it leaves less than this fraction of the cavity."""


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
    uncut = [number for number, plane in enumerate(planes) if plane and not _cuts(frames, number, plane)]
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
    if rule.fraction is not None:
        return superquadric_axis(frames, number, warnings).plane(rule.fraction)
    return rule.fixed


def superquadric_axis(frames: HeartCycle, number: int, warnings: Warnings) -> LongAxis:
    """Return the deformed longest axis of the cavity's superquadric; if it is common, frame 0 determines the apex."""
    compared = frames.models[0 if frames.material else number]
    return LongAxis(*frames.models[number].deform(cavity_ends(compared, frames.cavity, warnings)))


def _cuts(frames: HeartCycle, number: int, plane: BasePlane) -> bool:
    """Whether the plane meets the cavity; refuses one that leaves nothing."""
    # a plane on the wrong side, or with the wrong direction, leaves nothing
    mesh = frames.models[number].mesh(frames.cavity)
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
    if plane is not None and rule.fraction is None and _cuts(frames, number, plane):
        return axis_to_base_plane(frames.models[number], frames.cavity, plane)
    # a base that misses the cavity determines no axis
    axis = superquadric_axis(frames, number, warnings)
    return axis if rule.fraction is None else LongAxis(axis.apex, axis.plane(rule.fraction).point)
