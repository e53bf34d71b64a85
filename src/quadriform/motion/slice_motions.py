"""Rigid motions of slices, each of which was acquired in its own breath-hold.

A slice has one motion in all frames in which its number occurs. Its points move by x -> R (x - c) + c + t, with c the
mean of its points, R the rotation by a rotation vector and t a shift. The six components q of shift and rotation vector
along the axes of the slice, two in its plane and its normal, are further unknowns of the linear problem of the control
points, with a prior of mean zero (`slice_prior.py`). Each round linearises them at the motions of the round before,

    moved point = m + J (q - q0),  m the point moved by q0,  J = dm / dq,

so that a rotation is applied exactly. With the targets m - J q0 they enter as B p - J q does in
`normal_equations.py`. Coordinates are those of `cycle.py`: a shift is in RMS radii, a rotation in radians.

The rotation about the normal is one of the unknowns: the contours of a slice along the axis of a heart determine it,
and those of a slice across, which are nearly circles, leave it at zero with the standard deviation of the prior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quadriform.fitting.least_squares.normal_equations import right_sides
from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox

UNKNOWNS = 6
"""Of each slice: the shift along two axes in its plane and along its normal, and the rotation vector along the same."""
FEWEST_POINTS = 6
"""Slices of fewer points are not moved: the unknowns would be more than a third of the coordinates of their points."""
PARALLEL_COSINE = 0.9
"""Slices whose normals have a larger cosine with each other than this are a stack that no slice crosses."""
UNOBSERVABLE_DEGREE = 3
"""Motions that are polynomials of the position along a stack, up to this degree, are taken as unobservable. Linear
shifts are a shear of the model, which has no bending energy. Those of degree 2 and 3 cost so little of it that the
curved form of a heart would be explained by motions of slices."""

Numbers = NDArray[np.int64]
SliceNumbers = Sequence[Mapping[str, Numbers]]
"""For each frame the slice number of each point, by surface."""


@dataclass(frozen=True)
class SlicePlanes:
    """Where the slices lie.

    Attributes:
        numbers: (S,), sorted.
        axes: (S, 3, 3), unit vectors in the rows: two in the plane of each, and its normal.
        centres: (S, 3), mean of the points of each.
    """

    numbers: Numbers
    axes: Array
    centres: Array

    @classmethod
    def of(cls, frames: Sequence[Mapping[str, Array]], slices: SliceNumbers) -> "SlicePlanes":
        """From the points of all frames; slices of fewer than six points, or numbered below 0, are not moved."""
        points = np.concatenate([cloud for frame in frames for cloud in frame.values()])
        numbers = np.concatenate([frame[name] for frame, clouds in zip(slices, frames) for name in clouds])
        kept, axes, centres = [], [], []
        for number in np.unique(numbers[numbers >= 0]):
            inside = points[numbers == number]
            if len(inside) >= FEWEST_POINTS:
                kept.append(number)
                centres.append(inside.mean(axis=0))
                # the plane of a slice is spanned by the two principal axes of its points over all frames
                first, second, _ = np.linalg.svd(inside - centres[-1], full_matrices=False)[2]
                axes.append([first, second, np.cross(first, second)])
        return cls(np.array(kept, dtype=np.int64), np.array(axes).reshape(-1, 3, 3), np.array(centres).reshape(-1, 3))

    @property
    def are_parallel(self) -> bool:
        """Whether no slice crosses the others, so that shear and bending of their stack are unobservable."""
        normals = self.axes[:, 2]
        return bool((np.abs(normals @ normals.T) > PARALLEL_COSINE).all())

    def gauge_fields(self) -> Array:
        """Motions (6 S, m) of all slices together, one a column, that the model can follow: they are unobservable.

        These are the three translations and three rotations of all slices together. Of slices that no other crosses
        they are translations times each polynomial of the height of a slice along the stack, up to
        `UNOBSERVABLE_DEGREE`: such slices do not rotate (`slice_prior.SlicePrior`).
        """
        if not len(self.numbers):
            return np.empty((0, 0))
        arms = self.centres - self.centres.mean(axis=0)
        heights = arms @ self.axes[0, 2]
        heights /= max(float(np.abs(heights).max()), np.finfo(float).tiny)
        degree = UNOBSERVABLE_DEGREE if self.are_parallel else 0
        unit = np.eye(3)
        # rows a: the shift at the centres and the rotation vector of the translation along, or the rotation about, a
        shifts = np.concatenate([np.tile(unit[:, None], (1, len(arms), 1)), np.cross(unit[:, None], arms)])
        rotations = np.concatenate([np.zeros((3, len(arms), 3)), np.tile(unit[:, None], (1, len(arms), 1))])
        rigid = np.concatenate([np.einsum("ska,gsa->gsk", self.axes, of) for of in (shifts, rotations)], axis=2)
        if self.are_parallel:
            rigid = rigid[:3]
        return np.einsum("sp,gsk->skpg", np.vander(heights, degree + 1), rigid).reshape(UNKNOWNS * len(arms), -1)

    def moved(self, motions: Array, numbers: Numbers, points: Array) -> Array:
        """Points (n, 3) of given slices (n,) under motions (S, 6)."""
        result = points.copy()
        for index, number in enumerate(self.numbers):
            inside = numbers == number
            if inside.any():
                result[inside] = self._moved(index, motions[index], points[inside])
        return result

    def _moved(self, index: int, motion: Array, points: Array) -> Array:
        shift, rotation = motion.reshape(2, 3) @ self.axes[index]
        centre = self.centres[index]
        return Rotation.from_rotvec(rotation).apply(points - centre) + centre + shift

    def _derivatives(self, index: int, motion: Array, points: Array) -> Array:
        """Derivatives (n, 6, 3) of the moved points of one slice by its six unknowns."""
        axes, rotation = self.axes[index], motion[3:] @ self.axes[index]
        arms = Rotation.from_rotvec(rotation).apply(points - self.centres[index])
        turning = np.cross((_left_jacobian(rotation) @ axes.T).T[None], arms[:, None])
        return np.concatenate([np.broadcast_to(axes, turning.shape), turning], axis=1)

    def targets(self, motions: Array, numbers: Numbers, points: Array) -> Array:
        """What is left of linearised moved points (n, 3) where the unknowns are zero: m - J q0, by motions (S, 6)."""
        result = points.copy()
        for index, number in enumerate(self.numbers):
            inside, motion = numbers == number, motions[index]
            if inside.any():
                change = np.einsum("nka,k->na", self._derivatives(index, motion, points[inside]), motion)
                result[inside] = self._moved(index, motion, points[inside]) - change
        return result

    def bordered_block(
        self, frames: Sequence[Sequence[tuple[Rows, Numbers, Array]]], boxes: Sequence[ControlBox], motions: Array
    ) -> tuple[Array, Array, Array]:
        """The data's part in the unknowns: coupling (6 S, F, 3 k), own matrix (6 S, 6 S) and right side (6 S,).

        Args:
            frames: for each frame and surface the rows, whose targets are those of `targets`, the slice numbers of
                their points, and the points (n, 3) before any motion.
            boxes: of the frames.
            motions: (S, 6), where the motions are linearised.
        """
        count = UNKNOWNS * len(self.numbers)
        coupling = np.zeros((count, len(frames), boxes[0].control_points.size))
        own, right = np.zeros((count, count)), np.zeros(count)
        for frame, (surfaces, box) in enumerate(zip(frames, boxes)):
            for rows, numbers, points in surfaces:
                for index, number in enumerate(self.numbers):
                    inside = numbers == number
                    if not inside.any():
                        continue
                    at = slice(UNKNOWNS * index, UNKNOWNS * (index + 1))
                    derivatives = self._derivatives(index, motions[index], points[inside])
                    weighted = np.einsum("nij,nkj->nki", rows.metric[inside], derivatives)
                    offsets = rows.targets[inside] - rows.origins[inside]
                    # a motion moves the targets, so its sign is opposite to that of a displacement of the box
                    own[at, at] += np.einsum("nki,nli->kl", weighted, derivatives)
                    right[at] -= np.einsum("nki,ni->k", weighted, offsets)
                    coupling[at, frame] -= right_sides(box.local(rows.origins[inside]), weighted, box.degrees)
        return coupling, own, right


def _left_jacobian(rotation: Array) -> Array:
    """The left Jacobian (3, 3) of a rotation vector w: exp(w + dw) = exp(J dw) exp(w) to first order in dw."""
    angle = float(np.linalg.norm(rotation))
    cross = np.cross(rotation, np.eye(3)).T  # of [w]x: its product with a vector v is w x v
    first, second = 0.5, 1 / 6  # of the rotation vector zero
    if angle > 1e-4:
        first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross
