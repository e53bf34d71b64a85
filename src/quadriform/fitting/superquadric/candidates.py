"""Candidates for a superquadric: many of one kind as arrays, the parameters that a step changes, distances, size.

The distance is that of P4, to first order: d = (F - 1) / |grad F|. It is exact for planes and, since F of the kind
"ellipsoid" is of degree one along the rays from its centre, for spheres. Its derivatives are not taken at the point x
but at the foot point x - d n, n the normal: there they are those of the Euclidean distance, to first order in d, and
need no second derivatives of F.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quadriform.points import Array
from quadriform.shapes import _kernel
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import EXPONENTS, Superquadric

AXES, POWERS, ROTATION, SHIFT, HOLE = (slice(0, 3), slice(3, 5), slice(5, 8), slice(8, 11), slice(11, 12))
"""Slices of the parameters: log semi-axes, exponents, rotation and shift in the object's own frame, log(hole - 1)."""
SIZE_PENALTY = 0.03
"""Decrease of an inlier's log likelihood as the area of the surface grows by a factor e. It would be one for points
spread evenly over a whole surface, with a density of one over its area. How much of the surface was sampled is not
known, so it is a weak prior beside the distances."""


@dataclass(frozen=True)
class Candidates:
    """M superquadrics of one kind as arrays.

    Attributes:
        kind: of all of them.
        log_axes: (M, 3).
        exponents: (M, 2).
        rotations: (M, 3, 3), from the object's frame to that of the points.
        translations: (M, 3).
        log_holes: (M, 1) logarithm of the hole radius less one; unused for kinds without a hole.
    """

    kind: str
    log_axes: Array
    exponents: Array
    rotations: Array
    translations: Array
    log_holes: Array

    @classmethod
    def of(cls, superquadrics: list[Superquadric]) -> "Candidates":
        """Superquadrics of one kind, at least one."""
        holes = [[np.log((s.hole_radius or 2.0) - 1)] for s in superquadrics]
        return cls(
            superquadrics[0].kind,
            np.log([s.semi_axes for s in superquadrics]),
            np.array([s.exponents for s in superquadrics]),
            np.array([s.rotation for s in superquadrics]),
            np.array([s.translation for s in superquadrics]),
            np.array(holes),
        )

    def __len__(self) -> int:
        return len(self.log_axes)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The five arrays."""
        return (self.log_axes, self.exponents, self.rotations, self.translations, self.log_holes)

    @property
    def n_parameters(self) -> int:
        """11, or 12 of a kind with a hole."""
        return KINDS[self.kind].n_parameters

    def take(self, index: NDArray[np.int64]) -> "Candidates":
        """The chosen candidates."""
        return Candidates(self.kind, *(a[index] for a in self.arrays))

    def joined(self, others: "Candidates") -> "Candidates":
        """These candidates and others of the same kind."""
        return Candidates(self.kind, *(np.concatenate(pair) for pair in zip(self.arrays, others.arrays)))

    def where(self, chosen: Array, others: "Candidates") -> "Candidates":
        """These candidates where `chosen` (M,) is true, the others elsewhere."""
        pairs = zip(self.arrays, others.arrays)
        return Candidates(self.kind, *(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))

    def moved(self, step: Array, longest: float) -> "Candidates":
        """The candidates after a step (M, n_parameters), clipped to the bounds; no semi-axis is above `longest`."""
        return replace(
            self,
            # semi-axes by their logarithms: they stay positive, and steps are relative
            log_axes=np.clip(self.log_axes + step[:, AXES], np.log(longest) - 25, np.log(longest)),
            exponents=np.clip(self.exponents + step[:, POWERS], *EXPONENTS),
            # in the own frame, so no Euler angles and no gimbal lock
            rotations=self.rotations @ Rotation.from_rotvec(step[:, ROTATION]).as_matrix(),
            translations=self.translations + (self.rotations @ step[:, SHIFT, None])[..., 0],
            log_holes=np.clip(self.log_holes + step[:, HOLE], -10, 10) if KINDS[self.kind].has_hole else self.log_holes,
        )

    def superquadric(self, index: int) -> Superquadric:
        """One candidate as a superquadric; the caller cuts a hyperboloid where its data ends."""
        axes, hole = (np.exp(self.log_axes[index]), 1 + float(np.exp(self.log_holes[index, 0])))
        rotation = Rotation.from_matrix(self.rotations[index]).as_matrix()  # rounding off many small rotations
        return Superquadric(
            self.kind,
            axes,
            self.exponents[index],
            rotation,
            self.translations[index],
            hole_radius=hole if KINDS[self.kind].has_hole else None,
            height=None if KINDS[self.kind].cut_axis is None else 2 * float(axes.max()),
        )


def distances(candidates: Candidates, points: Array) -> tuple[Array, Array]:
    """Signed distances (M, m) of points (m, 3) to each candidate and their derivatives (M, n_parameters, m)."""
    count, each = len(candidates), len(points)
    result, derivatives = np.empty((count, each)), np.empty((count, candidates.n_parameters, each))
    kind = KINDS[candidates.kind]
    axes, holes = np.exp(candidates.log_axes), kind.has_hole * (1 + np.exp(candidates.log_holes))
    given = (axes, candidates.exponents, candidates.rotations, candidates.translations, holes, points)
    a, e, r, t, h, x = (np.ascontiguousarray(array) for array in given)
    _kernel.distances(kind.codes, a, e, r, t, h, x, result, derivatives)  # P4
    return result, derivatives


@dataclass(frozen=True)
class Extent:
    """A penalty on the size of M surfaces: where there is no data the smallest is preferred.

    It is weights * log(1 + area / area of the data): a surface gains little by shrinking below the data. The areas are
    those of boxes up to a factor.

    Attributes:
        weights: (M,) of the penalty.
        areas: (M,) of a sphere with the inliers' RMS radius.
    """

    weights: Array
    areas: Array

    @classmethod
    def of(cls, kind: str, points: Array, weights: Array) -> "Extent":
        """The penalty for points (m, 3) that count (M, m) times as inliers: weight times probability.

        It is zero where the semi-axes do not give the size: of surfaces with a hole, or cut where the points end.
        """
        total = weights.sum(axis=1)
        fraction = weights / np.maximum(total, 1e-300)[:, None]
        spread = fraction @ (points**2).sum(axis=1) - ((fraction @ points) ** 2).sum(axis=1)
        return cls(KINDS[kind].is_radial * SIZE_PENALTY * total, 3 * np.maximum(spread, 1e-300))

    def cost(self, candidates: Candidates) -> Array:
        """The value of the penalty (M,)."""
        return self.weights * np.log1p(_box_areas(candidates).sum(axis=1) / 2 / self.areas)

    def derivatives(self, candidates: Candidates) -> Array:
        """Its derivatives (M, 3) by the logarithms of the semi-axes."""
        areas = _box_areas(candidates)
        return self.weights[:, None] * areas / (areas.sum(axis=1) / 2 + self.areas)[:, None]


def _box_areas(candidates: Candidates) -> Array:
    """Eighths (M, 3) of the area of the box's four sides along each axis, a1 (a2 + a3) and so on."""
    axes = np.exp(candidates.log_axes)
    return axes * (axes.sum(axis=1, keepdims=True) - axes)
