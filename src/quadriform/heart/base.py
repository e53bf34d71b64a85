"""The plane at the base of the ventricle, below which a closed surface is measured.

It is given as `base` in one of five ways:

1. None: the plane that each model was stored with, as by fits of images; if any has none, the whole surfaces count.
2. A number from 0.001 to 1: this fraction of the long axis, from the apex, is below the plane; in every frame.
3. A tuple (point, direction): the same plane in all frames, the direction leading to the side that is cut off.
4. Mitral points (n, 3): their least squares plane, the same in all frames.
5. A list of such points, one set a frame: each frame has its own plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, WarningKind, Warnings
from quadriform.points import Array, check_number, check_points
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.landmarks import plane_through as plane_through
from quadriform.shapes.model import DeformableModel

Base = float | ArrayLike | tuple[ArrayLike, ArrayLike] | Sequence[ArrayLike] | None
"""One of the five in the text of this module."""


@dataclass(frozen=True)
class BaseRule:
    """The rule for the base in every frame: at most one of the first four; without any the whole surface counts.

    Attributes:
        fraction: of the long axis, from the apex, that is kept (2).
        fixed: one plane for all frames (3).
        mitral_points: (n, 3), one set a frame (5), or the same for all (4).
        planes: one a frame, which the models were stored with (1).
        description: for the table of measures.
    """

    fraction: float | None = None
    fixed: BasePlane | None = None
    mitral_points: tuple[Array, ...] | None = None
    planes: tuple[BasePlane, ...] | None = None
    description: str = "enclosed by the whole closed surface"

    def of_frames(self, numbers: Sequence[int]) -> "BaseRule":
        """The same rule for some of the frames."""
        points = None if self.mitral_points is None else tuple(self.mitral_points[number] for number in numbers)
        planes = None if self.planes is None else tuple(self.planes[number] for number in numbers)
        return replace(self, mitral_points=points, planes=planes)


def base_rule(base: Base, models: Sequence[DeformableModel], warnings: Warnings) -> BaseRule:
    """Return the rule of the option `base`.

    Args:
        base: one of the five in the text of this module.
        models: one a frame.
        warnings: BASE_MISSES is added where some models have a base and others have none.

    Raises:
        OptionError: none of the five, a number out of its range, a direction of length 0, fewer than three mitral
            points, or not one set a frame.
        PointsError: a plane or mitral points that are not finite numbers of shape (n, 3).
    """
    n_frames = len(models)
    if base is None:
        return _stored_rule(models, warnings)
    if isinstance(base, Real):
        fraction = check_number(base, "base", 1e-3, 1)  # type: ignore[arg-type]  # any real number
        return BaseRule(fraction=fraction, description=f"below {100 * fraction:g} % of the long axis from the apex")
    if isinstance(base, tuple) and len(base) == 2 and all(np.size(part) == 3 for part in base):
        return BaseRule(fixed=_given_plane(*base), description="below a fixed plane")
    if isinstance(base, str) or not np.iterable(base):
        raise OptionError(f"option base={base!r}: expected a number, a plane (point, direction), or mitral points")
    sets: list[ArrayLike] = list(base)
    if all(np.ndim(one) == 1 for one in sets):
        description = f"below the plane of {len(sets)} mitral points, the same in all frames"
        sets = [np.asarray(base)] * n_frames
    else:
        description = "below the plane of each frame's own mitral points"
    if len(sets) != n_frames:
        raise OptionError(f"option base: expected mitral points for each of {n_frames} frames, found {len(sets)} sets")
    points = tuple(_mitral_points(one, number) for number, one in enumerate(sets))
    return BaseRule(mitral_points=points, description=description)


def _stored_rule(models: Sequence[DeformableModel], warnings: Warnings) -> BaseRule:
    """The bases of the models; the closed surfaces where any has none, for both would not be comparable."""
    every = [model.landmarks for model in models]
    planes = tuple(each.base for each in every if each.base is not None)
    if len(planes) == len(models):
        names = " or ".join(dict.fromkeys(each.base_from for each in every))
        return BaseRule(planes=planes, description=f"below {names}, as stored with the model")
    if planes:
        warnings[WarningKind.BASE_MISSES] = (
            f"{len(planes)} of {len(models)} models have a base, the others have none: the whole closed surfaces "
            "count; give the base"
        )
    return BaseRule()


def _mitral_points(points: ArrayLike, frame: int) -> Array:
    checked = check_points(points, f"base: mitral points of frame {frame}")
    if len(checked) < 3:
        raise OptionError(
            f"option base: {len(checked)} mitral points in frame {frame}; expected at least 3 for a plane"
        )
    return checked


def _given_plane(point: ArrayLike, direction: ArrayLike) -> BasePlane:
    rows = check_points([np.ravel(point), np.ravel(direction)], "base")
    length = float(np.linalg.norm(rows[1]))
    if length == 0:
        raise OptionError("option base: the direction of the plane is zero; expected one to the side cut off")
    return BasePlane(rows[0], rows[1] / length)
