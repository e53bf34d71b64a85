"""Base and RV insertions of the frames of a cycle, from the guide points of its contours."""

from collections.abc import Sequence
from dataclasses import replace

from quadriform.errors import DegenerateError
from quadriform.files.guide_points import GuidePoints
from quadriform.shapes.landmarks import BasePlane, Landmarks, plane_through

FROM_POINTS = "the plane of each frame's own mitral points"
SPAN = 3
"""So many points span a plane."""


def landmarks_of_contours(frames: Sequence[GuidePoints]) -> tuple[Landmarks, ...]:
    """Return the landmarks of each frame; empty where there are none in any.

    A base in some frames only is left out: a volume below it and one without it are not comparable.

    Args:
        frames: with points of the left ventricle.
    """
    planes = [_plane(frame) for frame in frames]
    found = [Landmarks(rv_inserts=frame.rv_inserts) for frame in frames]
    if None not in planes:
        found = [replace(each, base=plane, base_from=FROM_POINTS) for each, plane in zip(found, planes)]
    known = any(each.base is not None or len(each.rv_inserts) for each in found) or any(planes)
    return tuple(found) if known else ()


def _plane(frame: GuidePoints) -> BasePlane | None:
    """The plane of the mitral points; None where they span none."""
    if len(frame.mitral) < SPAN:
        return None
    inside = frame.surface("endo" if frame.has("endo") else "epi")[0].mean(axis=0)
    try:
        return plane_through(frame.mitral, inside)
    except DegenerateError:
        return None
