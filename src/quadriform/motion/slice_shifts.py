"""In-plane shifts of slices, each of which was acquired in its own breath-hold.

A shift is the same for the whole cycle. It is one more pair of unknowns in the linear problem of the control points,
with a prior of mean zero and standard deviation `spread`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.least_squares.normal_equations import right_side
from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class Shifting:
    """The constants of the shifts of slices."""

    spread: float = 0.05
    """Standard deviation of the prior of a shift, in RMS radii of the cloud: two or three millimetres."""
    fewest_points: int = 6
    """Slices of fewer points are not moved: the two unknowns would be a third of what their points determine."""
    unobservable_factor: float = 1e6
    """Factor on the penalty of unobservable means of the shifts (`SlicePlanes.unobservable`), such as the mean of all:
    the model can move with the slices, so the data does not determine it. With this factor the variance of such a mean
    under the prior is below a millionth of that of one shift."""
    parallel_cosine: float = 0.9
    """Slices whose normals have a larger cosine with each other than this are a stack that no slice crosses."""
    unobservable_degree: int = 3
    """Shifts that are polynomials of the position along a stack, up to this degree, are taken as unobservable too.
    Linear ones are a shear of the model, which has no bending energy. Those of degree 2 and 3 cost so little of it that
    the curved form of a heart would be explained by shifts."""


SHIFTING = Shifting()
Numbers = NDArray[np.int64]
SliceNumbers = Sequence[Mapping[str, Numbers]]
"""For each frame the slice number of each point, by surface."""


@dataclass(frozen=True)
class SlicePlanes:
    """Where the slices lie.

    Attributes:
        numbers: (S,), sorted.
        axes: (S, 2, 3), two unit vectors in the plane of each.
        centres: (S, 3), mean of the points of each.
        counts: (S,), points of each in all frames.
    """

    numbers: Numbers
    axes: Array
    centres: Array
    counts: Array

    @classmethod
    def of(cls, frames: Sequence[Mapping[str, Array]], slices: SliceNumbers) -> "SlicePlanes":
        """From the points of all frames; slices of fewer than six points, or numbered below 0, are not moved."""
        points = np.concatenate([cloud for frame in frames for cloud in frame.values()])
        numbers = np.concatenate([frame[name] for frame, clouds in zip(slices, frames) for name in clouds])
        numbered = numbers >= 0
        points, numbers = points[numbered], numbers[numbered]
        kept, axes, centres, counts = [], [], [], []
        for number in np.unique(numbers):
            inside = points[numbers == number]
            if len(inside) >= SHIFTING.fewest_points:
                kept.append(number)
                counts.append(float(len(inside)))
                centres.append(inside.mean(axis=0))
                # the plane of a slice is spanned by the two principal axes of its points over all frames
                axes.append(np.linalg.svd(inside - centres[-1], full_matrices=False)[2][:2])
        return cls(
            np.array(kept, dtype=np.int64),
            np.array(axes).reshape(-1, 2, 3),
            np.array(centres).reshape(-1, 3),
            np.array(counts),
        )

    @property
    def are_parallel(self) -> bool:
        """Whether no slice crosses the others, so that shear and bending of their stack are unobservable."""
        normals = np.cross(self.axes[:, 0], self.axes[:, 1])
        return bool((np.abs(normals @ normals.T) > SHIFTING.parallel_cosine).all())

    def unobservable(self) -> Array:
        """Weights (2 S, m) of the weighted means of all shifts that are unobservable, one mean a column.

        For a column u and the shifts q (2 S,), u'q is the mean over all points of one coordinate of their shift times
        p(z_s), with z_s the height of the point's slice along the stack and p a polynomial. So u is n_s p(z_s) / n, for
        n_s of n points in slice s, times that coordinate of the slice's two axes; it is not normalised. The polynomials
        are orthonormal in the mean over all points. There is the one of degree 0, and for slices that no other crosses
        one for each degree up to `unobservable_degree`, each with three coordinates.
        """
        if not len(self.numbers):
            return np.empty((0, 0))
        fractions = self.counts / self.counts.sum()
        normals = np.cross(self.axes[:, 0], self.axes[:, 1])
        heights = (self.centres - fractions @ self.centres) @ normals[0]
        # slices that cross the stack determine its shear and bend, so only the mean of all is unobservable
        degree = SHIFTING.unobservable_degree if self.are_parallel else 0
        root = np.sqrt(fractions)[:, None]
        # columns sqrt(n_s / n) p(z_s): polynomials that are orthonormal in the mean over the points
        along = np.linalg.qr(root * np.vander(heights, degree + 1, increasing=True))[0]
        return np.einsum("sp,ska->skpa", root * along, self.axes).reshape(2 * len(fractions), -1)

    def named(self, shifts: Array) -> dict[int, Array]:
        """Slice number -> shift (3,) in space."""
        return dict(zip(self.numbers.tolist(), np.einsum("sk,ska->sa", shifts, self.axes)))

    def offsets(self, shifts: Array, numbers: Numbers) -> Array:
        """Displacements (n, 3) of points of given slices (n,) under shifts (S, 2)."""
        vectors = np.einsum("sk,ska->sa", shifts, self.axes)
        result = np.zeros((len(numbers), 3))
        index = np.searchsorted(self.numbers, numbers).clip(0, max(len(self.numbers) - 1, 0))
        known = self.numbers[index] == numbers if len(self.numbers) else np.zeros(len(numbers), dtype=bool)
        result[known] = vectors[index[known]]
        return result

    def bordered_block(
        self, frames: Sequence[Sequence[tuple[Rows, Numbers, Array]]], boxes: Sequence[ControlBox], sigma: float
    ) -> tuple[Array, Array, Array]:
        """The shifts' part of the linear problem: coupling (2 S, F, 3 k), own matrix (2 S, 2 S), right side (2 S,).

        Args:
            frames: for each frame and surface the rows, their slice numbers, and the offsets (n, 3) from the
                undeformed surface to the targets before any shift.
            boxes: of the frames.
            sigma: the noise at which independent rows would have the information of these.
        """
        count = 2 * len(self.numbers)
        coupling = np.zeros((count, len(frames), boxes[0].control_points.size))
        unobservable = self.unobservable()
        own = (sigma / SHIFTING.spread) ** 2 * (
            np.eye(count) + SHIFTING.unobservable_factor * unobservable @ unobservable.T
        )
        right = np.zeros(count)
        for frame, (surfaces, box) in enumerate(zip(frames, boxes)):
            for rows, numbers, offsets in surfaces:
                for index, number in enumerate(self.numbers):
                    inside = numbers == number
                    if inside.any():
                        self._add(index, rows, inside, offsets, box, (coupling[:, frame], own, right))
        return coupling, own, right

    def _add(
        self,
        index: int,
        rows: Rows,
        inside: NDArray[np.bool_],
        offsets: Array,
        box: ControlBox,
        sums: tuple[Array, Array, Array],
    ) -> None:
        """Add the rows of one slice in one frame to the sums: coupling, own matrix, right side."""
        coupling, own, right = sums
        metric, local = rows.metric[inside], box.local(rows.origins[inside])
        weighted = np.einsum("nij,kj->nki", metric, self.axes[index])
        at = slice(2 * index, 2 * index + 2)
        # a shift moves the targets, so its sign is opposite to that of a displacement of the box
        own[at, at] += np.einsum("nki,li->kl", weighted, self.axes[index])
        right[at] -= np.einsum("nki,ni->k", weighted, offsets[inside])
        for k in range(2):
            coupling[2 * index + k] -= right_side(local, weighted[:, k], box.degrees)
