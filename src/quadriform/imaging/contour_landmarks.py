"""Base and RV insertions of the frames of a cycle, from the guide points of its contours."""

from collections.abc import Sequence
from dataclasses import replace

from quadriform.errors import DegenerateError
from quadriform.files.guide_points import MIN_MITRAL_POINTS, GuidePoints
from quadriform.shapes.landmarks import BasePlane, Landmarks, plane_through

FROM_POINTS = "the plane of each frame's own mitral points"


def landmarks_of_contours(frames: Sequence[GuidePoints]) -> tuple[Landmarks, ...]:
    """Return the landmarks of each frame; empty where there are none in any.

    1. Every frame has mitral points that span a plane: each frame has its base, and its RV insertions.
    2. Some frames have: no frame has a base, since a volume below one and a volume without one are not comparable; but
       there is an entry for each frame.
    3. None has: the RV insertions alone, and no entries at all where no frame has these either.

    Args:
        frames: with points of the left ventricle.
    """
    planes = [_plane(frame) for frame in frames]
    found = [Landmarks(rv_inserts=frame.rv_inserts) for frame in frames]
    if None not in planes:
        found = [replace(each, base=plane, base_from=FROM_POINTS) for each, plane in zip(found, planes)]
    return tuple(found) if any(planes) or any(len(frame.rv_inserts) for frame in frames) else ()


def _plane(frame: GuidePoints) -> BasePlane | None:
    """The plane of the mitral points; None where they span none."""
    if len(frame.mitral) < MIN_MITRAL_POINTS:
        return None
    inside = frame.surface("endo" if frame.has("endo") else "epi")[0].mean(axis=0)
    try:
        return plane_through(frame.mitral, inside)
    except DegenerateError:
        return None
