"""What is known beside the points of a fit: where they were seen from, and on what the body stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import OptionError, PointsError
from quadriform.fitting.cloud import Distinct
from quadriform.point_sets import PointSet, given_factor
from quadriform.points import Array, Frame, check_points, for_each, unit_vectors
from quadriform.shapes.landmarks import MOST_CUT_OFF

WIDEST = np.radians(80)
"""Largest angle between the direction of a point, from its viewpoint, and the mean direction of all points seen from
there. A larger one means that the viewpoint lies among the points, where no sensor outside the body is."""
Viewpoint = ArrayLike | Mapping[str, ArrayLike] | None
Plane = tuple[ArrayLike, ArrayLike] | None


@dataclass(frozen=True)
class Surroundings:
    """Checked viewpoints and support plane of one cloud, in its unit and frame.

    Attributes:
        viewpoints: (n, 3), where each point was seen from, or None.
        plane: a point (3,) of the plane that the body does not pass, and its unit normal (3,) to the side of the body;
            or None.
    """

    viewpoints: Array | None = None
    plane: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, points: Array, viewpoint: ArrayLike | None, support: Plane) -> Surroundings:
        """From options as they were given, for points (n, 3).

        Raises:
            OptionError: they are not what is expected, or cannot be of these points.
        """
        seen_from = None if viewpoint is None else _viewpoints(points, viewpoint)
        return cls(seen_from, None if support is None else _support(points, support))

    def in_unit(self, factor: float) -> Surroundings:
        """The same with lengths times a factor: in another unit."""
        eyes = None if self.viewpoints is None else factor * self.viewpoints
        return Surroundings(eyes, None if self.plane is None else (factor * self.plane[0], self.plane[1]))

    def take(self, index: NDArray[np.int64]) -> Surroundings:
        """Those of some of the points."""
        return self if self.viewpoints is None else replace(self, viewpoints=self.viewpoints[index])

    def to_local(self, distinct: Distinct, frame: Frame) -> Surroundings:
        """Those of the distinct points in a centred, scaled frame."""
        eyes = None if self.viewpoints is None else frame.to_local(distinct.of_distinct(self.viewpoints))
        plane = None if self.plane is None else (frame.to_local(self.plane[0][None])[0], self.plane[1])
        return Surroundings(eyes, plane)


def surroundings_by_name(
    clouds: Mapping[str, Array], sets: Mapping[str, PointSet], viewpoint: Viewpoint, support: Plane, method: str
) -> dict[str, Surroundings]:
    """Name -> what is known beside each cloud; a viewpoint of all, or one or an array for each by name.

    Options are in the unit in which the points were given, as `sets` know it, the result in that of the clouds.

    Raises:
        OptionError: as `Surroundings.of`, or of a method that takes neither.
    """
    if method == "paper" and (viewpoint is not None or support is not None):
        raise OptionError("options viewpoint and support are none of method='paper'; use method='tangent'")
    viewpoints: dict[str, ArrayLike | None] = for_each(clouds, viewpoint, "viewpoints")
    factor = given_factor(sets.values())
    return {
        name: Surroundings.of(cloud / factor, viewpoints[name], support).in_unit(factor)
        for name, cloud in clouds.items()
    }


def _viewpoints(points: Array, given: ArrayLike) -> Array:
    array = _rows(given, "viewpoint")
    if len(array) not in (1, len(points)):
        raise OptionError(
            f"option viewpoint: {len(array)} positions for {len(points)} points; expected one (3,), or one for each "
            "point (n, 3)"
        )
    eyes, view = np.unique(np.broadcast_to(array, points.shape), axis=0, return_inverse=True)
    directions, view = unit_vectors(points - array), view.reshape(-1)
    means = np.zeros_like(eyes)
    np.add.at(means, view, directions)
    aside = (directions * unit_vectors(means)[view]).sum(axis=1) < np.cos(WIDEST)
    if aside.any():
        raise OptionError(
            f"option viewpoint: {eyes[view[aside.argmax()]].tolist()} lies among the points that were seen from it; "
            "expected the position of a sensor outside, in the unit and frame of the points"
        )
    return np.broadcast_to(array, points.shape)


def _support(points: Array, given: Plane) -> tuple[Array, Array]:
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise OptionError("option support: expected a plane as (point, normal), three numbers each")
    at, normal = (_rows(np.reshape(row, -1), "support")[0] for row in given)
    if not normal.any():
        raise OptionError("option support: the normal of the plane is zero")
    normal = unit_vectors(normal)
    above = float(((points - at) @ normal > 0).mean())
    if MOST_CUT_OFF < above < 1 - MOST_CUT_OFF:
        raise OptionError(
            f"option support: {min(above, 1 - above):.0%} of the points lie beyond the plane; expected at most "
            f"{MOST_CUT_OFF:.0%}, for the body does not pass it"
        )
    return at, normal if above > MOST_CUT_OFF else -normal


def _rows(given: ArrayLike, option: str) -> Array:
    """Rows (k, 3) of an option, or of a single row (3,)."""
    try:
        return check_points(np.atleast_2d(np.asarray(given, dtype=np.float64)), option)
    except (PointsError, TypeError, ValueError) as error:
        raise OptionError(f"option {option}: {error}") from error
