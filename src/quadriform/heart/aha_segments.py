"""The 17 segments of the American Heart Association.

Cerqueira et al., Standardized myocardial segmentation and nomenclature for tomographic imaging of the heart,
Circulation 2002; 105: 539-542: six basal, six mid-cavity, four apical segments and the apical cap, in thirds of the
cavity's long axis. The septum's segments meet in its middle, half-way between the insertions of the right ventricle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import OptionError
from quadriform.heart.axis import LongAxis
from quadriform.points import Array, check_points
from quadriform.shapes.superquadric import Superquadric

SIX = ("anterior", "anteroseptal", "inferoseptal", "inferior", "inferolateral", "anterolateral")
NAMES = (
    *(f"basal {wall}" for wall in SIX),
    *(f"mid {wall}" for wall in SIX),
    *(f"apical {wall}" for wall in ("anterior", "septal", "inferior", "lateral")),
    "apex",
)
"""Names of the segments 1 to 17, in order."""
OPPOSITE = 0.05
"""Insertions whose mean direction is shorter than this lie all around the axis and show no septum."""


@dataclass(frozen=True)
class AhaSegmentation:
    """Where the segments lie.

    Attributes:
        axis: the long axis at end diastole.
        septum: (3,), unit, across the axis, from it to the middle of the septum.
    """

    axis: LongAxis
    septum: Array

    @classmethod
    def anchored(cls, axis: LongAxis, rv_inserts: ArrayLike) -> "AhaSegmentation":
        """From the points (n, 3) where the right ventricle meets the left: anterior and inferior, of any slices.

        The middle of the septum halves the smaller angle between both groups; which is anterior follows from the
        handedness of the heart.

        Raises:
            OptionError: fewer than two points, or none on one of the sides.
        """
        inserts = check_points(rv_inserts, "rv_inserts")
        if len(inserts) < 2:
            raise OptionError("rv_inserts: one point; expected an anterior and an inferior one, or several of each")
        ways = axis.across(inserts - axis.apex)
        ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        middle = ways.mean(axis=0)
        if np.linalg.norm(middle) < OPPOSITE:
            raise OptionError("rv_inserts: they lie all around the long axis; expected two groups, beside the septum")
        side = np.cross(ways, middle) @ axis.direction > 0
        if side.all() or not side.any():
            raise OptionError("rv_inserts: all on one side; expected anterior and inferior insertions")
        groups = [ways[mask].mean(axis=0) for mask in (side, ~side)]
        return cls(axis, _unit(sum(group / np.linalg.norm(group) for group in groups)))

    @classmethod
    def unanchored(cls, axis: LongAxis, cavity: Superquadric) -> "AhaSegmentation":
        """Without insertions: turned to that axis of the cavity's superquadric that is most across the long axis."""
        across = axis.across(cavity.rotation.T)
        return cls(axis, _unit(across[np.linalg.norm(across, axis=1).argmax()]))

    def angles(self, points: Array) -> Array:
        """Angles (n,) of points (n, 3) about the axis, from the septum on counter-clockwise seen from the apex."""
        ways = self.axis.across(points - self.axis.apex)
        other = np.cross(-self.axis.direction, self.septum)
        return np.arctan2(ways @ other, ways @ self.septum)

    def numbers(self, points: Array) -> NDArray[np.int64]:
        """The segment, 1 to 17, of each of (n, 3) points at end diastole; 0 beyond the base."""
        heights, degrees = self.axis.heights(points), np.degrees(self.angles(points))
        sixth = np.floor((degrees + 120) / 60).astype(np.int64) % 6
        quarter = np.floor((degrees + 135) / 90).astype(np.int64) % 4
        choices = [np.full(len(points), 17), 13 + quarter, 7 + sixth, 1 + sixth]
        return np.select([heights < limit for limit in (0, 1 / 3, 2 / 3, 1)], choices, 0)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
