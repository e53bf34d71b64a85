"""Twist of the left ventricle in the four published definitions.

Young and Cowan, Evaluation of left ventricular torsion by cardiovascular magnetic resonance, J Cardiovasc Magn Reson
2012; 14: 49, review them: the angle between two slices, the angle per length, the shear angle and the shear strain.
Angles are counter-clockwise seen from the apex, so that the twist of a healthy heart at end systole is positive.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.heart.axis import LongAxis
from quadriform.heart.wall import Wall
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox

LEVELS = (0.25, 0.75)
"""The apical and the basal slice: fractions of the long axis from the apex, at end diastole."""
DEPTH = 0.5
"""Of the middle layer, from the endocardium (0) to the epicardium (1)."""


@dataclass(frozen=True)
class Twist:
    """Twist between an apical and a basal slice of the middle layer of the wall.

    Attributes:
        apical: rotation of the apical slice since end diastole, radians, counter-clockwise seen from the apex.
        basal: the same of the basal slice.
        distance: between the slices at end diastole, in the unit of the data.
        radii: (2,) mean radii of the apical and the basal slice at end diastole.
    """

    apical: float
    basal: float
    distance: float
    radii: Array

    @property
    def angle(self) -> float:
        """Rotation of the apical minus the basal slice, in degrees."""
        return float(np.degrees(self.apical - self.basal))

    @property
    def angle_per_length(self) -> float:
        """The angle over the distance of the slices, in degrees per unit of length."""
        return self.angle / self.distance

    @property
    def shear_angle(self) -> float:
        """The angle times the mean radius over the distance, in degrees: the circumferential-longitudinal shear."""
        return self.angle * float(self.radii.mean()) / self.distance


@dataclass(frozen=True)
class Slices:
    """Material points of the two slices, before deformation, and the frame in which the slices are plane.

    Attributes:
        axis: the long axis at end diastole.
        origins: two arrays (n, 3), apical and basal.
        reference: the box at end diastole.
    """

    axis: LongAxis
    origins: tuple[Array, Array]
    reference: ControlBox

    @classmethod
    def cut(cls, wall: Wall, box: ControlBox, axis: LongAxis) -> "Slices":
        """Return the sections of the middle layer across the long axis at both levels."""
        origins = wall.at(DEPTH)
        fractions = axis.fractions(box.deform(origins))
        edges = np.concatenate([wall.quads[:, [k, (k + 1) % 4]] for k in range(4)])
        apical, basal = (_crossings(origins, fractions - level, edges) for level in LEVELS)
        return cls(axis, (apical, basal), box)

    def twist(self, box: ControlBox) -> Twist:
        """Return the twist from end diastole to a frame, given by its box."""
        ends = np.stack([self.axis.apex, self.axis.base])
        moved = LongAxis(*box.deform(self.reference.undeform(ends)))
        # the tilt of the axis is removed before angles about it are compared
        upright = _shortest_rotation(moved.direction, self.axis.direction)
        angles, radii = [], []
        for origins in self.origins:
            # slices rotate about their own centroids: a shift of the heart is no twist
            before = self.axis.across(_centred(self.reference.deform(origins)))
            after = self.axis.across(_centred(box.deform(origins)) @ upright.T)
            angles.append(_angle_between(before, after, -self.axis.direction))
            radii.append(np.linalg.norm(before, axis=1).mean())
        distance = (LEVELS[1] - LEVELS[0]) * self.axis.length
        return Twist(angles[0], angles[1], distance, np.array(radii))


def _crossings(origins: Array, heights: Array, edges: Array) -> Array:
    """Points (m, 3) where edges cross the height 0; inner edges of the mesh occur twice, which changes no mean."""
    above = heights > 0
    first, second = edges[above[edges[:, 0]] != above[edges[:, 1]]].T
    # linear interpolation of the height along each edge
    fraction = (heights[first] / (heights[first] - heights[second]))[:, None]
    return origins[first] + fraction * (origins[second] - origins[first])


def _centred(points: Array) -> Array:
    return points - points.mean(axis=0)


def _angle_between(before: Array, after: Array, axis: Array) -> float:
    """The right-handed angle about an axis that rotates plane vectors (n, 3) onto others, by least squares."""
    return float(np.arctan2((np.cross(before, after) @ axis).sum(), (before * after).sum()))


def _shortest_rotation(one: Array, other: Array) -> Array:
    """The rotation (3, 3) by the smallest angle from a unit vector to another (Rodrigues' formula)."""
    x, y, z = np.cross(one, other)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + skew + skew @ skew / (1 + one @ other)
