"""Where a superquadric fit starts: moments of the points (paper A.3) and, for the other kinds, a quadric too.

The inertia of a toroid or hyperboloid may be nearly the same about all axes, and then its principal axes are those of
the noise. The axes of the quadric nearest to the points depend on other moments, so they serve as candidates beside.
"""

from itertools import permutations, product

import numpy as np

from quadriform.errors import DegenerateError
from quadriform.fitting.ties import first_least, settled_axes
from quadriform.points import Array
from quadriform.shapes.superquadric import Superquadric


def principal_frame(points: Array) -> tuple[Array, Array, Array]:
    """Centre (3,), rotation (3, 3) and moments (3,) of inertia of (n, 3) points, by P12 with mass 1.

    The axes are ordered from the shortest extent to the longest, so z is the long axis; z and y point to the side with
    the longer tail, so the frame turns with the points.
    """
    centre = points.mean(axis=0)
    offset = points - centre
    second = offset.T @ offset / len(points)
    inertia = np.trace(second) * np.eye(3) - second  # P12
    moments, axes = np.linalg.eigh(inertia)
    axes = settled_axes(moments, axes, offset)
    moments, axes = moments[::-1], axes[:, ::-1].copy()
    tails = ((offset @ axes) ** 3).sum(axis=0)
    axes[:, tails < 0] *= -1
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
    rows = np.linalg.qr(np.stack(columns, axis=1), mode="r")
    xx, yy, zz, yz, xz, xy, *linear, _ = np.linalg.svd(rows)[2][-1]
    q = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    offset = -np.linalg.lstsq(q, np.array(linear), rcond=None)[0]
    axes = settled_axes(*np.linalg.eigh(q), points - middle)
    return middle + scale * offset * (np.abs(offset).max() < 1), axes


def _frames(points: Array) -> list[tuple[Array, Array]]:
    """Candidates for centre (3,) and axes (3, 3), the latter up to order and sign: by inertia and by a quadric."""
    centre, axes, _ = principal_frame(points)
    return [(centre, axes), quadric_frame(points)]


def toroid_by_moments(points: Array) -> Superquadric:
    """The elliptic torus that suits best."""
    found = tori(points)
    costs = [((torus.implicit(points) - 1) ** 2).sum() for torus in found]
    return found[int(first_least(np.array(costs)))]


def tori(points: Array) -> list[Superquadric]:
    """An elliptic torus about each candidate for an axis; ring and tube from means and spreads around it."""
    return [
        _torus_about(points, centre, _right_handed(np.roll(axes, shift, axis=1)))
        for centre, axes in _frames(points)
        for shift in range(3)
    ]


def _right_handed(axes: Array) -> Array:
    return axes * [np.sign(np.linalg.det(axes)), 1, 1]


def _torus_about(points: Array, centre: Array, axes: Array) -> Superquadric:
    local = (points - centre) @ axes
    spread = np.sqrt((local**2).mean(axis=0))
    around = np.linalg.norm(local[:, :2] / spread[:2], axis=1)  # the ring is round in these units
    tube = np.sqrt(2) * around.std()
    hole = max(1.2, float(around.mean() / tube))
    sizes = np.append(tube * spread[:2], np.sqrt(2) * spread[2])
    return Superquadric("toroid", sizes, np.ones(2), axes, centre, hole_radius=hole)


def hyperboloid_by_quadric(points: Array, kind: str) -> Superquadric:
    """The best of `hyperboloids`."""
    return hyperboloids(points, kind)[0]


def hyperboloids(points: Array, kind: str) -> list[Superquadric]:
    """The quadrics +-(x/a1)^2 +-(y/a2)^2 - (z/a3)^2 = 1 nearest to (n, 3) points, in all orders of candidate axes.

    Those of the right kind only, the best first.

    Raises:
        DegenerateError: there is none.
    """
    signs = np.array([1.0, 1.0, -1.0] if kind == "hyperboloid1" else [1.0, -1.0, -1.0])
    found: list[tuple[float, Superquadric]] = []
    for (centre, axes), order in product(_frames(points), permutations(range(3))):
        turned = _right_handed(axes[:, order])
        squares = signs * ((points - centre) @ turned) ** 2
        coefficients = np.linalg.lstsq(squares, np.ones(len(points)), rcond=None)[0]
        if (coefficients > 0).all():
            cost = float(((squares @ coefficients - 1) ** 2).sum())
            found.append((cost, _hyperboloid(points, kind, centre, turned, 1 / np.sqrt(coefficients))))
    if not found:
        raise DegenerateError(
            f"points do not look like kind={kind!r}; expected them around a hyperboloid, try 'ellipsoid'"
        )
    least = min(cost for cost, _ in found)
    found.sort(key=lambda each: 0.0 if each[0] <= least * (1 + 1e-9) else each[0])  # of equal ones the first
    return [each for _, each in found]


def _hyperboloid(points: Array, kind: str, centre: Array, axes: Array, sizes: Array) -> Superquadric:
    """A hyperboloid that is cut where the points end."""
    axis = 0 if kind == "hyperboloid2" else 2
    reach = float(np.abs((points - centre) @ axes[:, axis]).max())
    height = max(reach, 1.01 * sizes[0]) if axis == 0 else reach
    return Superquadric(kind, sizes, np.ones(2), axes, centre, height=height)


def start(points: Array, kind: str) -> Superquadric:
    """The paper's one start for a kind."""
    if kind == "ellipsoid":
        return ellipsoid_by_moments(points)
    if kind == "toroid":
        return toroid_by_moments(points)
    return hyperboloid_by_quadric(points, kind)
