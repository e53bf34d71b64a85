"""The motion of one slice, as a result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from quadriform.motion.slice_motions import FEWEST_POINTS, SliceNumbers, SlicePlanes
from quadriform.motion.slice_prior import SliceState
from quadriform.points import Array, Frame
from quadriform.words import short_repr


@dataclass(frozen=True, repr=False)
class SliceMove:
    """A rigid motion x -> R (x - centre) + centre + shift that corrects the points of a slice.

    Attributes:
        rotation: (3,), rotation vector in radians, along the axes of the world; R is the rotation by it.
        centre: (3,), mean of the points of the slice before the motion.
        shift: (3,), in the unit of the points.
        axes: (3, 3), unit vectors in the rows: two in the plane of the slice, and its normal.
        sd: (6,), posterior standard deviations along `axes`, of the three components of the rotation, in radians, then
            of those of the shift. They are relative to all slices together, for a motion of all is not observable. What
            the data does not determine, as the rotation of a circle in its plane, has that of the prior.
    """

    __repr__ = short_repr

    rotation: Array
    centre: Array
    shift: Array
    axes: Array
    sd: Array

    def apply(self, points: Array) -> Array:
        """The moved points (n, 3)."""
        found: Array = Rotation.from_rotvec(self.rotation).apply(points - self.centre) + self.centre + self.shift
        return found

    def rotated(self, rotation: Array) -> SliceMove:
        """The same motion in coordinates that a rotation (3, 3) maps to; `sd` is along axes that rotate too."""
        vector, centre, shift = (rotation @ each for each in (self.rotation, self.centre, self.shift))
        return SliceMove(vector, centre, shift, self.axes @ rotation.T, self.sd)


def slice_moves(
    planes: SlicePlanes, state: SliceState, covariance: Array, normalisation: Frame
) -> dict[int, SliceMove]:
    """Slice number -> its motion in the unit and coordinates of the points, with a posterior covariance (6 S, 6 S)."""
    shifts, rotations = np.einsum("sgk,ska->gsa", state.motions.reshape(-1, 2, 3), planes.axes)
    lengths = np.repeat([1.0, normalisation.scale], 3)
    deviations = lengths * state.deviations(covariance)[:, [3, 4, 5, 0, 1, 2]]
    centres = normalisation.to_world(planes.centres)
    parts = zip(rotations, centres, normalisation.scale * shifts, planes.axes, deviations)
    return {int(number): SliceMove(*each) for number, each in zip(planes.numbers, parts)}


def unmoved_slices(planes: SlicePlanes, slices: SliceNumbers) -> tuple[str, ...]:
    """A note of the slices that were not moved for their few points; empty where there are none."""
    every = np.unique(np.concatenate([numbers for frame in slices for numbers in frame.values()]))
    unmoved = np.setdiff1d(every[every >= 0], planes.numbers)
    if not len(unmoved):
        return ()
    return (f"slices of fewer than {FEWEST_POINTS} points were not moved: {', '.join(map(str, unmoved))}",)
