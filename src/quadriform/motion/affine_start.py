"""The first boxes of a cycle: for each frame an affine image of one deformed box, smooth in time.

Most of a heart's motion is affine. If a deformation D has no folds, neither has T(D(x)) with an affine map T that
preserves orientation. It is a deformation by the same box, whose control points are the images of those of D under T.
The affine maps, splines in time with a map at each knot, minimise

    sum_i (T(y_i) - d_i)' M_i (T(y_i) - d_i)  +  gamma sum_i mean over t of |d2 T(y_i) / d u2|^2

    d_i     a data point of a frame, y_i = D(o_i) its foot point on the surface by D, T the map of its frame
    M_i     its metric: almost all of its weight is along the normal (`refinement/point_to_plane.py`)
    gamma   the strength in time, u time as in `cycle_equations.py`; with a period the constant and the sine of
            one period in T(y_i) are left out here, for they are not penalised (`TimeBasis.bending`)

These are the terms of the data and of time in the sum of `cycle_equations.py`, with the mean over the foot points in
place of the one over the box. There is no regularisation in space. At times without a frame the smoothness in time
alone determines the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve

from quadriform.fitting.least_squares.factorisation import cholesky_factor
from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.splines import TimeBasis

LEAST_DETERMINANT = 0.01
"""The determinant of an affine map, its factor on volumes, must be above this. A smaller one comes from wrong foot
points: both sides of a body are matched to the same side of the data."""


@dataclass(frozen=True)
class AffineMotion:
    """Affine maps at the knots of splines over time.

    Attributes:
        maps: (K, 4, 3); the image of a point is the row (x, y, z, 1) times its map. The first three rows are the images
            of the directions of the axes, the last one is that of the origin.
        splines_at_frames: (F, K), their values.
    """

    maps: Array
    splines_at_frames: Array

    @classmethod
    def identity(cls, splines_at_frames: Array) -> "AffineMotion":
        """No motion, for splines with these values (F, K) at the frames."""
        return cls(np.repeat(np.eye(4, 3)[None], splines_at_frames.shape[1], axis=0), splines_at_frames)

    @property
    def least_determinant(self) -> float:
        """The smallest determinant of the map of a frame, its factor on volumes; negative for a mirror image."""
        return float(np.linalg.det(np.einsum("fk,kij->fij", self.splines_at_frames, self.maps)[:, :3]).min())

    def at_knots(self, points: Array) -> Array:
        """The images (K, n, 3) of points (n, 3) at the knots."""
        return _homogeneous(points) @ self.maps

    def boxes(self, start: ControlBox) -> list[ControlBox]:
        """The image of a box in each frame."""
        images = np.einsum("fk,kni->fni", self.splines_at_frames, self.at_knots(start.control_points.reshape(-1, 3)))
        return [start.with_control_points(image.reshape(start.control_points.shape)) for image in images]


def fitted_motion(
    rows: Sequence[Sequence[Rows]], start: ControlBox, splines_at_frames: Array, basis: TimeBasis, gamma: float
) -> AffineMotion | None:
    """The affine motion of a box that fits the data of all frames.

    None where the data does not determine it, or where its smallest determinant is not above `LEAST_DETERMINANT`.

    Args:
        rows: for each frame and surface the data points d_i, the origins o_i of their foot points, and the metrics M_i.
        start: the box that moves.
        splines_at_frames: (F, K), values of the splines.
        basis: the splines.
        gamma: strength in time, per data point.
    """
    # indices: n points, a and b homogeneous coordinates, i and j coordinates of the image, k and l knots
    knots = splines_at_frames.shape[1]
    matrix, right, squares = np.zeros((knots, 12, knots, 12)), np.zeros((knots, 12)), np.zeros((4, 4))
    for splines, frame in zip(splines_at_frames, rows):
        for row in frame:
            points = _homogeneous(start.deform(row.origins))
            # normal matrix and right side of one frame's map, by the 12 entries of the map
            normal = np.einsum("na,nij,nb->aibj", points, row.metric, points, optimize=True).reshape(12, 12)
            image = np.einsum("na,nij,nj->ai", points, row.metric, row.targets, optimize=True).ravel()
            # the map of a frame is the sum over the knots of spline value times map
            matrix += np.einsum("k,l,ij->kilj", splines, splines, normal)
            right += np.outer(splines, image)
            squares += points.T @ points
    # sum over foot points of the mean over time of |d2 T(y) / d u2|^2
    in_time = np.kron(basis.bending(), np.kron(squares, np.eye(3)))
    factor = cholesky_factor(matrix.reshape(12 * knots, -1) + gamma * in_time)
    if factor is None:
        return None
    found = AffineMotion(cho_solve((factor, True), right.ravel()).reshape(knots, 4, 3), splines_at_frames)
    return found if found.least_determinant > LEAST_DETERMINANT else None


def _homogeneous(points: Array) -> Array:
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)
