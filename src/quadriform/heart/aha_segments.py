"""The 17 segments of the American Heart Association.

Cerqueira et al., Standardized myocardial segmentation and nomenclature for tomographic imaging of the heart,
Circulation 2002; 105: 539-542: six basal, six mid-cavity, four apical segments and the apical cap, in thirds of the
long axis of the cavity. The septal segments meet in the middle of the septum, half-way between the insertions of the
right ventricle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import OptionError
from quadriform.heart.axis import LongAxis
from quadriform.points import Array, check_points, unit_vectors
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
"""Insertions whose mean direction is shorter than this lie all around the axis and determine no septum."""


@dataclass(frozen=True)
class AhaSegmentation:
    """The position of the segments.

    Attributes:
        axis: the long axis at end diastole.
        septum: (3,), unit, across the axis, from it to the middle of the septum.
    """

    axis: LongAxis
    septum: Array

    @classmethod
    def anchored(cls, axis: LongAxis, rv_inserts: ArrayLike) -> "AhaSegmentation":
        """Return the segments for points (n, 3) where the right ventricle meets the left, anterior and inferior.

        The points may be of any slices. The middle of the septum halves the smaller angle between both groups; which
        is anterior follows from the handedness of the heart.

        Raises:
            OptionError: fewer than two points, points all around the axis, or none on one of the sides of the septum.
            PointsError: not finite numbers of shape (n, 3).
        """
        inserts = check_points(rv_inserts, "rv_inserts")
        if len(inserts) < 2:
            raise OptionError("rv_inserts: one point; expected an anterior and an inferior one, or several of each")
        directions = unit_vectors(axis.across(inserts - axis.apex))
        middle = directions.mean(axis=0)
        if np.linalg.norm(middle) < OPPOSITE:
            raise OptionError("rv_inserts: they lie all around the long axis; expected two groups, beside the septum")
        side = np.cross(directions, middle) @ axis.direction > 0
        if side.all() or not side.any():
            raise OptionError("rv_inserts: all on one side; expected anterior and inferior insertions")
        # means of the groups, so that many points on one side do not move the middle
        groups = [unit_vectors(directions[mask].mean(axis=0)) for mask in (side, ~side)]
        return cls(axis, unit_vectors(groups[0] + groups[1]))

    @classmethod
    def unanchored(cls, axis: LongAxis, cavity: Superquadric) -> "AhaSegmentation":
        """Return the segments without insertions: at the semi-axis of the cavity that is most across the long axis."""
        across = axis.across(cavity.rotation.T)
        return cls(axis, unit_vectors(across[np.linalg.norm(across, axis=1).argmax()]))

    def angles(self, points: Array) -> Array:
        """Return angles (n,) of points (n, 3) about the axis, counter-clockwise from the septum, seen from the apex."""
        across = self.axis.across(points - self.axis.apex)
        other = np.cross(-self.axis.direction, self.septum)
        return np.arctan2(across @ other, across @ self.septum)

    def numbers(self, points: Array) -> NDArray[np.int64]:
        """Return the segment, 1 to 17, of each of (n, 3) points at end diastole; 0 beyond the base."""
        fractions, degrees = self.axis.fractions(points), np.degrees(self.angles(points))
        # six and four equal sectors, whose first is centred on anterior, 90 degrees clockwise from the septum
        sixth = np.floor((degrees + 120) / 60).astype(np.int64) % 6
        quarter = np.floor((degrees + 135) / 90).astype(np.int64) % 4
        # segment 17, the apex, is the wall below the apex of the cavity, where fractions are negative
        choices = [np.full(len(points), 17), 13 + quarter, 7 + sixth, 1 + sixth]
        return np.select([fractions < limit for limit in (0, 1 / 3, 2 / 3, 1)], choices, 0)
