"""Initial superquadrics: by the paper's moments (A.3), by a quadric, and ellipsoids of parts of the cloud.

The moments of inertia of a toroid or hyperboloid can be nearly equal about all axes, and then its principal axes are
those of the noise. The axes of the quadric nearest to the points depend on other moments, so they are further
candidates. All results rotate, move and scale with the points and do not depend on their order.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.errors import DegenerateError
from quadriform.fitting.cloud import EQUAL, best_first, first_least
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.points import Array
from quadriform.shapes import pose
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class StartSettings:
    """The constants of initial superquadrics, and of axes that do not depend on rounding."""

    neighbours: int = 9
    """Number of neighbours; the distance of the last one measures the density of the cloud."""
    sparse: float = 2.0
    """A point whose neighbours are this many times further away than the median point's is left out of starts."""
    dense_fraction: float = 0.4
    """Fraction of the densest points: mostly surface even when there are more outliers than inliers."""
    side_fraction: float = 0.4
    """Fraction of the cloud on one side of a cut, from which a start is made without the points on the other side."""
    thinnest: float = 1e-2
    """Least semi-axis of a start over its longest."""
    equal: float = 1e-7
    """Eigenvalues nearer to each other than this fraction of the largest do not determine their axes."""
    determines: float = 1e-6
    """A moment above this fraction of the largest possible one determines a direction."""
    folds: range = range(1, 7)
    """Symmetries about an axis that are looked for: by 360 degrees, 180, ... 60."""
    sweeps: int = 30
    """Sweeps of Jacobi's rotations, more than they need to converge."""


START = StartSettings()
SADDLE = np.radians([20.0, 35.0, 50.0])
"""Angles in the three coordinate planes. The frame after these rotations is a second start of `_of_fourth_moments`: the
first one may be a saddle of the sum that is maximised, from which no rotation in one plane leads away."""
ORDERS = np.array([np.roll(np.eye(3), shift, axis=1) for shift in range(3)])
EIGHTH = pose.rotation_from_euler(np.array([0, 0, np.pi / 4]))
START_ROTATIONS = np.concatenate([ORDERS, ORDERS @ EIGHTH])
"""Rotations (6, 3, 3) of the axes of a start: each of the three becomes z, first without and then with a rotation by 45
degrees about z. A shape with the exponent e2 is nearly the same as one rotated by 45 degrees with 2 - e2 (its dual), so
that a search needs starts in both frames."""
CUTS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
QUADRIC_SIGNS = {"hyperboloid1": (1.0, 1.0, -1.0), "hyperboloid2": (1.0, -1.0, -1.0)}
"""Signs of the squares of x / a1, y / a2 and z / a3, whose sum is 1 on a hyperboloid with exponents of one."""


def principal_frame(points: Array) -> tuple[Array, Array, Array]:
    """Centre (3,), rotation (3, 3) and moments (3,) of inertia of (n, 3) points, by P12 with mass 1.

    The axes are ordered from the shortest extent to the longest, so z is the long axis; z and y point to the side with
    the longer tail, so the frame rotates with the points.
    """
    centre = points.mean(axis=0)
    offset = points - centre
    second = offset.T @ offset / len(points)
    inertia = np.trace(second) * np.eye(3) - second  # P12
    moments, axes = np.linalg.eigh(inertia)
    axes = canonical_axes(moments, axes, offset)
    moments, axes = moments[::-1], axes[:, ::-1].copy()
    skewness = ((offset @ axes) ** 3).sum(axis=0)
    # signs by the third moments; of symmetric clouds they do not matter
    axes[:, skewness < 0] *= -1
    axes[:, 0] = np.cross(axes[:, 1], axes[:, 2])
    return centre, axes, moments


def ellipsoid_by_moments(points: Array) -> Superquadric:
    """The ellipsoid with the centre and the moments of inertia of (n, 3) points (P12 to P14)."""
    centre, axes, (l1, l2, l3) = principal_frame(points)
    squared = 1.5 * np.array([l2 + l3 - l1, l1 + l3 - l2, l1 + l2 - l3])  # P13, P14
    sizes = np.sqrt(np.maximum(squared, 1e-12 * squared.max()))
    return Superquadric(semi_axes=sizes, rotation=axes, translation=centre)  # section A.3


def quadric_frame(points: Array) -> tuple[Array, Array]:
    """Centre (3,) and axes (3, 3) of the quadric x'Qx + 2 b'x + c = 0 nearest to (n, 3) points, algebraically.

    The centre of the points where the quadric has none among them.
    """
    middle, scale = points.mean(axis=0), np.ptp(points, axis=0).max()
    x, y, z = ((points - middle) / scale).T
    columns = (x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z, np.ones(len(x)))
    # the smallest singular vector of R is that of all rows, at the cost of a 10 x 10 matrix
    rows = np.linalg.qr(np.stack(columns, axis=1), mode="r")
    xx, yy, zz, yz, xz, xy, *linear, _ = np.linalg.svd(rows)[2][-1]
    q = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    offset = -np.linalg.lstsq(q, np.array(linear), rcond=None)[0]
    axes = canonical_axes(*np.linalg.eigh(q), points - middle)
    return middle + scale * offset * (np.abs(offset).max() < 1), axes


def _frames(points: Array) -> list[tuple[Array, Array]]:
    """Candidates for centre (3,) and axes (3, 3), the latter up to order and sign: by inertia and by a quadric."""
    centre, axes, _ = principal_frame(points)
    return [(centre, axes), quadric_frame(points)]


def toroid_by_moments(points: Array) -> Superquadric:
    """The elliptic torus of the least criterion P3 among those about the candidates for an axis."""
    found = tori(points)
    costs = [((torus.implicit(points) - 1) ** 2).sum() for torus in found]
    return found[int(first_least(np.array(costs)))]


def tori(points: Array) -> list[Superquadric]:
    """An elliptic torus about each candidate for an axis, with ring and tube by means and standard deviations."""
    return [
        _torus_about(points, centre, _right_handed(np.roll(axes, shift, axis=1)))
        for centre, axes in _frames(points)
        for shift in range(3)
    ]


def _right_handed(axes: Array) -> Array:
    return axes * [np.sign(np.linalg.det(axes)), 1, 1]


def _torus_about(points: Array, centre: Array, axes: Array) -> Superquadric:
    local = (points - centre) @ axes
    # RMS extent along each axis: divided by it an elliptic ring is round
    spread = np.sqrt((local**2).mean(axis=0))
    around = np.linalg.norm(local[:, :2] / spread[:2], axis=1)  # the ring is round in these units
    # the radius of a circle is the root of two times the standard deviation of a coordinate on it
    tube = np.sqrt(2) * around.std()
    hole = max(1.2, float(around.mean() / tube))
    sizes = np.append(tube * spread[:2], np.sqrt(2) * spread[2])
    return Superquadric("toroid", sizes, np.ones(2), axes, centre, hole_radius=hole)


def hyperboloid_by_quadric(points: Array, kind: str) -> Superquadric:
    """The best of `hyperboloids`."""
    return hyperboloids(points, kind)[0]


def hyperboloids(points: Array, kind: str) -> list[Superquadric]:
    """The quadrics +-(x/a1)^2 +-(y/a2)^2 +-(z/a3)^2 = 1 nearest to (n, 3) points, in all orders of candidate axes.

    The signs are those of `QUADRIC_SIGNS`; only quadrics of that kind are returned, the best first.

    Raises:
        DegenerateError: there is none.
    """
    signs = np.array(QUADRIC_SIGNS[kind])
    found: list[tuple[float, Superquadric]] = []
    for (centre, axes), order in product(_frames(points), permutations(range(3))):
        rotated = _right_handed(axes[:, order])
        squares = signs * ((points - centre) @ rotated) ** 2
        coefficients = np.linalg.lstsq(squares, np.ones(len(points)), rcond=None)[0]
        if (coefficients > 0).all():
            cost = float(((squares @ coefficients - 1) ** 2).sum())
            found.append((cost, _hyperboloid(points, kind, centre, rotated, 1 / np.sqrt(coefficients))))
    if not found:
        raise DegenerateError(
            f"points do not look like kind={kind!r}; expected them around a hyperboloid, try 'ellipsoid'"
        )
    least = min(cost for cost, _ in found)
    found.sort(key=lambda each: max(each[0], least * (1 + 1e-9)))  # of equal ones the first
    return [each for _, each in found]


def _hyperboloid(points: Array, kind: str, centre: Array, axes: Array, sizes: Array) -> Superquadric:
    """The hyperboloid with given semi-axes, cut where the points end."""
    axis = KINDS[kind].cut_axis or 0
    reach = float(np.abs((points - centre) @ axes[:, axis]).max())
    height = max(reach, 1.01 * KINDS[kind].least_cut * sizes[axis])
    return Superquadric(kind, sizes, np.ones(2), axes, centre, height=height)


STARTS: dict[str, Callable[[Array], Superquadric]] = {
    "ellipsoid": ellipsoid_by_moments,
    "toroid": toroid_by_moments,
    **{kind: partial(hyperboloid_by_quadric, kind=kind) for kind in QUADRIC_SIGNS},
}
"""The one start of the paper's method, for every kind."""


def cut_to(found: Superquadric, points: Array) -> Superquadric:
    """The surface, cut where the points end if its kind is open."""
    axis = KINDS[found.kind].cut_axis
    if axis is None or not len(points):
        return found
    reach = float(np.abs(found.to_local(points)[:, axis]).max())
    return replace(found, height=max(reach, 1.001 * KINDS[found.kind].least_cut * found.semi_axes[axis]))


def neighbour_distance(points: Array, sampled: Array) -> Array:
    """Distances (n,) of points (n, 3) to the last of their nearest neighbours among all of them or a sample (m, 3)."""
    return cKDTree(sampled).query(points, min(START.neighbours, len(sampled) - 1) + 1)[0][:, -1]


def dense_parts(points: Array) -> Array:
    """Weights (2, n), 0 or 1, of two parts of a cloud (n, 3): without isolated points, and the densest points only."""
    far = neighbour_distance(points, points)
    most = (1 + EQUAL.neighbours) * np.array([START.sparse * np.median(far), np.quantile(far, START.dense_fraction)])
    return (far <= most[:, None]).astype(np.float64)


def sides(points: Array, core: NDArray[np.bool_]) -> Array:
    """Weights (26, n), 0 or 1, of parts of the core (n,) on one side of a plane.

    The planes' normals are 26 even directions about the core's principal axes.
    """
    centre = points[core].mean(axis=0)
    axes = canonical_axes(*np.linalg.eigh(np.cov(points[core].T)), points[core] - centre)
    heights = (points - centre) @ axes @ (CUTS / np.linalg.norm(CUTS, axis=1)[:, None]).T
    most = np.quantile(heights[core], START.side_fraction, axis=0) + EQUAL.neighbours * np.abs(heights[core]).max()
    return (core[:, None] & (heights <= most)).T.astype(np.float64)


def _moments(points: Array, weights: Array) -> tuple[Array, Array]:
    """Centres (H, 3), second moments (H, 3, 3) of weighted parts (H, n) of a cloud; of all if a part has no weight."""
    weights = np.where(weights.any(axis=1, keepdims=True), weights, np.ones_like(weights))
    fraction = weights / weights.sum(axis=1, keepdims=True)
    centres = fraction @ points
    squares = (points[:, :, None] * points[:, None]).reshape(-1, 9)
    return centres, (fraction @ squares).reshape(-1, 3, 3) - centres[:, :, None] * centres[:, None]


def bound_of_axes(points: Array) -> float:
    """The largest semi-axis in a fit: 2 / sqrt(3) times the largest extent of points (n, 3) along a principal axis.

    A cube has no principal axes, and its extent is sqrt(3) times larger along a diagonal than along a side. The factor
    keeps the bound within twice the side, whichever axes are taken.
    """
    _, values, axes = np.linalg.svd(points, full_matrices=False)
    axes = canonical_axes(values**2, axes.T, points)
    return 2 * float(np.ptp(points @ axes, axis=0).max()) / np.sqrt(3)


def principal_axes(points: Array, weights: Array) -> Array:
    """Principal axes (H, 3, 3) of weighted parts (H, n) of a cloud, right-handed, the longest last."""
    centres, second = _moments(points, weights)
    values, axes = np.linalg.eigh(second)
    for part, centre in enumerate(centres):
        roots = np.sqrt(weights[part])[:, None] if weights[part].any() else 1.0
        axes[part] = canonical_axes(values[part], axes[part], roots * (points - centre))
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    return axes


def ellipsoids(points: Array, weights: Array, rotations: Array) -> Candidates:
    """Ellipsoids by centre and spread of weighted parts of a cloud.

    Args:
        points: (n, 3).
        weights: (H, n), a row for each part.
        rotations: (H, k, 3, 3), k frames for each part.
    """
    centres, second = _moments(points, weights)
    count = rotations.shape[0] * rotations.shape[1]
    # variances along the axes of each frame; on a sphere a third of the squared radius
    rotated = np.swapaxes(rotations, 2, 3) @ second[:, None] @ rotations
    spread = np.einsum("hkaa->hka", rotated).reshape(-1, 3)
    sizes = np.sqrt(3 * np.maximum(spread, START.thinnest**2 * spread.max(axis=1, keepdims=True)))
    return Candidates(
        "ellipsoid",
        np.log(sizes),
        np.ones((count, 2)),
        rotations.reshape(-1, 3, 3),
        np.repeat(centres, rotations.shape[1], axis=0),
        np.zeros((count, 1)),
    )


NOT_RADIAL: dict[str, Callable[[Array], list[Superquadric]]] = {
    "toroid": tori,
    **{kind: partial(hyperboloids, kind=kind) for kind in QUADRIC_SIGNS},
}
"""The starts of the robust search, for every kind whose surface does not lie around its centre (`is_radial`). The
others start from `ellipsoids`."""


def starts_not_radial(points: Array, kind: str) -> Candidates:
    """The starts of `NOT_RADIAL`, then each of them rotated by 45 degrees about its z axis (`_eighth_rotated`)."""
    first = NOT_RADIAL[kind](points)
    return Candidates.of(first + [_eighth_rotated(s) for s in first])


def _eighth_rotated(s: Superquadric) -> Superquadric:
    """A start rotated by 45 degrees about its z axis, with the RMS of both semi-axes across it for each of them.

    A toroid and one sheet lie around z, and e2 is the exponent of their section: the result is a start near the dual of
    the shape (`START_ROTATIONS`). Two sheets lie along x: theirs is a further start, with an axis between x and y.
    """
    size = np.sqrt((s.semi_axes[:2] ** 2).mean())
    return replace(s, semi_axes=np.array([size, size, s.semi_axes[2]]), rotation=s.rotation @ EIGHTH)


def canonical_axes(values: Array, axes: Array, points: Array) -> Array:
    """Principal axes (3, 3), columns, that do not depend on rounding.

    Where eigenvalues differ these are the given ones. Equal eigenvalues do not determine their axes: there moments of
    higher order do, which rotate with the points; where these are isotropic too, they are the axes nearest to those of
    the coordinates.

    Args:
        values: (3,) eigenvalues, in order.
        axes: (3, 3) eigenvectors as columns.
        points: (n, 3) centred, maybe each times the root of its weight.
    """
    near = np.abs(np.diff(values)) <= START.equal * np.abs(values).max()
    if not near.any():
        return axes
    if not near.all():
        alone = 2 if near[0] else 0
        return _around(axes[:, alone], alone, points)
    far = (points**2).sum(axis=1)
    # where second moments are isotropic, fourth moments contracted to a matrix may not be
    fourth = (far[:, None] * points).T @ points
    spread, other = np.linalg.eigh(fourth)
    differ = np.diff(spread) > START.determines * spread[-1]
    if differ.any():
        return other if differ.all() else _around(other[:, 2 if differ[1] else 0], 2 if differ[1] else 0, points)
    return _of_fourth_moments(points, float((far**2).sum()))


def _around(axis: Array, index: int, points: Array) -> Array:
    """Axes (3, 3) with a given one at its index; the others by the first k-fold moment about it that is not zero."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis) > np.abs(axis).max() - START.determines)])
    beside = np.eye(3)[np.argmax(np.abs(axis) < np.abs(axis).min() + START.determines)]
    first = beside - (beside @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    # in the plane across the axis as complex numbers: a k-fold symmetry has moments of order k only
    plane = points @ first + 1j * (points @ second)
    far = np.linalg.norm(points, axis=1)
    for fold in START.folds:
        weights = far ** (4 if fold < 3 else 0)
        moment, most = (weights * plane**fold).sum(), (weights * np.abs(plane) ** fold).sum()
        if np.abs(moment) > START.determines * most:
            moment = -moment if fold == 4 else moment  # of a square the axes are its sides, not its diagonals
            angle = _nearest_to_zero(float(np.angle(moment)) / fold, fold)
            first = np.cos(angle) * first + np.sin(angle) * second
            second = np.cross(axis, first)
            break
    return np.stack({0: (axis, first, second), 2: (first, second, axis)}[index], axis=1)


def _nearest_to_zero(angle: float, fold: int) -> float:
    """The equivalent angle nearest to zero; of two that are equally near, up to rounding, the negative one."""
    step = 2 * np.pi / fold
    return angle - step if angle > step / 2 - START.determines else angle


def _of_fourth_moments(points: Array, most: float) -> Array:
    """The frame (3, 3) whose sum of fourth moments is farthest from that of an isotropic cloud, by Jacobi's rotations.

    In a plane that sum is a constant and the real part of a moment of (x + i y)^4: its extreme is known at once.
    """
    even = 3 / 5 * most
    found, aside = [], np.eye(3)
    for (i, j), angle in zip(combinations(range(3), 2), SADDLE):
        aside = _rotated(aside, i, j, angle)
    for begin in (np.eye(3), aside):
        for sign in (1.0, -1.0):
            frame = _extreme(points, begin, sign, most)
            found.append((frame, abs(float(((points @ frame) ** 4).sum()) - even)))
    frame, strength = found[best_first(np.array([each[1] for each in found]) / most)[0]]
    return frame if strength > START.determines * most else np.eye(3)


def _extreme(points: Array, frame: Array, sign: float, most: float) -> Array:
    """The frame (3, 3), reached from a given one, whose sum of fourth moments is largest (sign 1) or least (-1)."""
    for _ in range(START.sweeps):
        largest = 0.0
        for i, j in combinations(range(3), 2):
            local = points @ frame
            moment = sign * ((local[:, i] + 1j * local[:, j]) ** 4).sum()
            angle = float(np.angle(moment)) / 4 if np.abs(moment) > EQUAL.values * most else 0.0
            frame = _rotated(frame, i, j, angle)
            largest = max(largest, abs(angle))
        if largest < 1e-14:
            break
    return frame


def _rotated(frame: Array, i: int, j: int, angle: float) -> Array:
    """The frame after a rotation in the plane of two of its axes."""
    c, s = np.cos(angle), np.sin(angle)
    rotated = frame.copy()
    rotated[:, [i, j]] = frame[:, [i, j]] @ np.array([[c, -s], [s, c]])
    return rotated
