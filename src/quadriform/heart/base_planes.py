"""From what was said about the base to a plane in every frame, and to the long axis."""

from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.heart.axis import LongAxis, axis_to_base_plane, cavity_ends
from quadriform.heart.base import BasePlane, BaseRule, plane_through
from quadriform.heart.heart_cycle import HeartCycle
from quadriform.heart.volumes import section_centre, volume_below

Planes = tuple[BasePlane | None, ...]


def base_planes(frames: HeartCycle, rule: BaseRule, warnings: Warnings) -> Planes:
    """The plane at the base in every frame, None for a closed surface.

    Args:
        frames: the models.
        rule: what was said.
        warnings: takes BASE_MISSES where nothing is cut off, and APEX_AMBIGUOUS.

    Raises:
        OptionError: nothing of the cavity is left in a frame.
        DegenerateError: mitral points on a line.
    """
    planes = tuple(_plane(frames, rule, number, warnings) for number in range(len(frames.models)))
    uncut = [number for number, plane in enumerate(planes) if plane and not _cuts(frames, number, plane)]
    if uncut and rule.share is None:
        warnings[WarningKind.BASE_MISSES] = (
            f"the base cuts nothing off the cavity in {len(uncut)} of {len(planes)} frames, the first is {uncut[0]}; "
            "there the whole closed surface counts"
        )
    return planes


def _plane(frames: HeartCycle, rule: BaseRule, number: int, warnings: Warnings) -> BasePlane | None:
    if rule.loops is not None:
        middle = frames.models[number].mesh(frames.cavity, 8).vertices.mean(axis=0)
        return plane_through(rule.loops[number], middle)
    if rule.share is not None:
        return superquadric_axis(frames, number, warnings).plane(rule.share)
    return rule.fixed


def superquadric_axis(frames: HeartCycle, number: int, warnings: Warnings) -> LongAxis:
    """The deformed longest axis of the cavity's superquadric; where frames share it, frame 0 tells the apex."""
    decides = frames.models[0 if frames.material else number]
    return LongAxis(*frames.models[number].deform(cavity_ends(decides, frames.cavity, warnings)))


def _cuts(frames: HeartCycle, number: int, plane: BasePlane) -> bool:
    """Whether the plane meets the cavity; refuses one that leaves nothing."""
    mesh = frames.models[number].mesh(frames.cavity)
    if volume_below(mesh, plane) <= 1e-6 * mesh.volume():
        raise OptionError(
            f"option base: nothing of the cavity is left in frame {number}; expected a plane through its base, with "
            "the direction leading to the side that is cut off"
        )
    return section_centre(mesh, plane) is not None


def long_axis(frames: HeartCycle, number: int, rule: BaseRule, plane: BasePlane | None, warnings: Warnings) -> LongAxis:
    """The long axis of a frame, from the apex to the middle of the base, and how far the wall is measured.

    With a base: from the middle of the cavity's section to the cavity's farthest point. With a share: that part of the
    superquadric's longest axis. Of a closed surface: all of it.
    """
    if plane is not None and rule.share is None and _cuts(frames, number, plane):
        return axis_to_base_plane(frames.models[number], frames.cavity, plane)
    axis = superquadric_axis(frames, number, warnings)
    return axis if rule.share is None else LongAxis(axis.apex, axis.plane(rule.share).point)
