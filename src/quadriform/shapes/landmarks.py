"""Landmarks of a ventricle that are stored with its model: the base plane, and the right ventricle's insertions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from quadriform.errors import DegenerateError, OptionError
from quadriform.points import Array
from quadriform.words import plain

NO_POINTS = np.empty((0, 3))
MOST_CUT_OFF = 0.25
"""Largest fraction of the points beyond a base, where data ends: half of the points may be outliers on all sides."""
GIVEN_BASE = "the given base"
"""The name of a base that was given as an option."""
COLLINEAR = 1e-3
"""Mitral points whose second singular value is below this fraction of the first lie on a line."""


@dataclass(frozen=True)
class BasePlane:
    """The plane at the base.

    Attributes:
        point: (3,), on the plane, in the world.
        direction: (3,), unit, towards the side that is cut off.
    """

    point: Array
    direction: Array

    def heights(self, points: Array) -> Array:
        """Return signed distances (n,) of world points (n, 3), positive on the side that is cut off."""
        return (points - self.point) @ self.direction

    def rotated(self, rotation: Array) -> BasePlane:
        """Return the plane after a rotation (3, 3) about the origin."""
        return BasePlane(rotation @ self.point, rotation @ self.direction)


@dataclass(frozen=True)
class Landmarks:
    """The base plane of a ventricle, and the points where the right ventricle meets the left, at one time.

    Attributes:
        base: beyond this plane the model is extrapolated and no volume counts; None where none is known.
        base_from: what the plane is, as in "below the plane of its mitral points"; empty without a plane.
        rv_inserts: (n, 3), in the world; n may be 0.

    Raises:
        OptionError: a plane without a text, or a text without a plane.
    """

    base: BasePlane | None = None
    base_from: str = ""
    rv_inserts: Array = field(default_factory=lambda: NO_POINTS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_from", plain(self.base_from))
        if (self.base is None) != (not self.base_from):
            raise OptionError(f"base_from={self.base_from!r}: expected a text exactly where there is a base")

    def transformed(self, scale: float, offset: Array) -> Landmarks:
        """Return the landmarks after `scale` x + `offset`."""
        base = None if self.base is None else replace(self.base, point=scale * self.base.point + offset)
        return replace(self, base=base, rv_inserts=scale * self.rv_inserts + offset)

    def rotated(self, rotation: Array) -> Landmarks:
        """Return the landmarks after a rotation (3, 3) about the origin."""
        base = None if self.base is None else self.base.rotated(rotation)
        return replace(self, base=base, rv_inserts=self.rv_inserts @ rotation.T)


NONE_KNOWN = Landmarks()
"""The landmarks of a model that is no ventricle, or whose landmarks are not known."""


def plane_through(mitral_points: Array, inside: Array) -> BasePlane:
    """Return the least squares plane of mitral points.

    Args:
        mitral_points: (n, 3), three or more.
        inside: (3,), a point on the side that is kept, such as the centre of the cavity.

    Raises:
        DegenerateError: the points lie on a line.
    """
    centre = mitral_points.mean(axis=0)
    spread, axes = np.linalg.svd(mitral_points - centre)[1:]
    if not spread[1] > COLLINEAR * spread[0]:
        raise DegenerateError(
            f"base: {len(mitral_points)} mitral points lie on a line; expected three that span a plane"
        )
    normal = axes[2]  # of the smallest singular value
    return BasePlane(centre, -normal if (inside - centre) @ normal > 0 else normal)


def check_base(plane: BasePlane, points: Array) -> None:
    """Refuse a base that cuts through the middle of the data, or whose direction leads to the wrong side.

    Args:
        plane: as it was given.
        points: (n, 3), of all surfaces, or of the voxels of a cavity.

    Raises:
        OptionError: more than a quarter of the points lie beyond it.
    """
    missing = float((plane.heights(points) > 0).mean())
    if missing <= MOST_CUT_OFF:
        return
    reverse = 1 - missing <= MOST_CUT_OFF
    advice = "try the reverse direction" if reverse else "the plane goes through the middle of the data"
    raise OptionError(
        f"option base: {missing:.0%} of the data lies beyond the plane, on the side to which its direction leads; "
        f"expected the edge of the data, with at most {MOST_CUT_OFF:.0%} beyond; {advice}"
    )
