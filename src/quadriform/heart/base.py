"""Where the ventricle ends: the plane at its base, said in one of four ways."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import DegenerateError, OptionError
from quadriform.points import Array, check_number, check_points

Base = float | ArrayLike | tuple[ArrayLike, ArrayLike] | Sequence[ArrayLike] | None
"""None, a share of the long axis, (point, direction), mitral points (n, 3), or such points for every frame."""

LINE = 1e-3
"""Mitral points whose second singular value is below this share of the first lie on a line."""


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
        """Signed distances (n,) of world points (n, 3), positive on the side that is cut off."""
        return (points - self.point) @ self.direction


@dataclass(frozen=True)
class BaseRule:
    """How the base is found in every frame; at most one of the three is given.

    Attributes:
        share: of the long axis, from the apex, that is kept.
        fixed: one plane for all frames.
        loops: mitral points (n, 3), one set a frame.
        words: what a result says about it.
    """

    share: float | None = None
    fixed: BasePlane | None = None
    loops: tuple[Array, ...] | None = None
    words: str = "enclosed by the whole closed surface"


def base_rule(base: Base, n_frames: int) -> BaseRule:
    """What was said about the base.

    Args:
        base: None: the closed surface as it is. A number in (0, 1]: this share of the long axis from the apex, in
            every frame. A tuple (point, direction): this plane in all frames, the direction leading to the side that
            is cut off. Points (n, 3): the least squares plane of these mitral points in all frames. A list of point
            sets, one a frame: each frame's own.
        n_frames: how many frames there are.

    Raises:
        OptionError: something else, or not one set a frame.
    """
    if base is None:
        return BaseRule()
    if isinstance(base, (int, float)):
        share = check_number(base, "base", 1e-3, 1)
        return BaseRule(share=share, words=f"below {100 * share:g} % of the long axis from the apex")
    if isinstance(base, tuple) and len(base) == 2 and all(np.size(part) == 3 for part in base):
        return BaseRule(fixed=_given_plane(*base), words="below a fixed plane")
    sets: list[ArrayLike] = list(base)  # type: ignore[arg-type]
    if all(np.ndim(one) == 1 for one in sets):
        words = f"below the plane of {len(sets)} mitral points, the same in all frames"
        sets = [np.asarray(base)] * n_frames
    else:
        words = "below the plane of each frame's own mitral points"
    if len(sets) != n_frames:
        raise OptionError(f"option base: expected mitral points for each of {n_frames} frames, found {len(sets)} sets")
    return BaseRule(loops=tuple(_loop(one, number) for number, one in enumerate(sets)), words=words)


def _loop(points: ArrayLike, frame: int) -> Array:
    loop = check_points(points, f"base: mitral points of frame {frame}")
    if len(loop) < 3:
        raise OptionError(f"option base: {len(loop)} mitral points in frame {frame}; expected at least 3 for a plane")
    return loop


def _given_plane(point: ArrayLike, direction: ArrayLike) -> BasePlane:
    rows = check_points([np.ravel(point), np.ravel(direction)], "base")
    length = float(np.linalg.norm(rows[1]))
    if length == 0:
        raise OptionError("option base: the direction of the plane is zero; expected the way to the side cut off")
    return BasePlane(rows[0], rows[1] / length)


def plane_through(loop: Array, inside: Array) -> BasePlane:
    """The least squares plane of mitral points.

    Args:
        loop: (n, 3), three or more.
        inside: (3,), a point on the side that is kept, such as the middle of the cavity.

    Raises:
        DegenerateError: the points lie on a line.
    """
    middle = loop.mean(axis=0)
    spread, axes = np.linalg.svd(loop - middle)[1:]
    if not spread[1] > LINE * spread[0]:
        raise DegenerateError(f"base: {len(loop)} mitral points lie on a line; expected three that span a plane")
    direction = axes[2]
    return BasePlane(middle, -direction if (inside - middle) @ direction > 0 else direction)
