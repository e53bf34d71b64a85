"""Where a superquadric fit starts: moments of the points (paper A.3) and, for the open kinds, a plain quadric."""

from itertools import permutations

import numpy as np

from quadriform.errors import DegenerateError
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


def toroid_by_moments(points: Array) -> Superquadric:
    """An elliptic torus about the principal axis that suits best."""
    return min(
        tori_by_moments(points),
        key=lambda torus: float(((torus.implicit(points) - 1) ** 2).sum()),
    )


def tori_by_moments(points: Array) -> list[Superquadric]:
    """An elliptic torus about each principal axis; ring and tube from means and spreads around it."""
    centre, axes, _ = principal_frame(points)
    return [_torus_about(points, centre, np.roll(axes, shift, axis=1)) for shift in range(3)]


def _torus_about(points: Array, centre: Array, axes: Array) -> Superquadric:
    local = (points - centre) @ axes
    spread = np.sqrt((local**2).mean(axis=0))
    around = np.linalg.norm(local[:, :2] / spread[:2], axis=1)  # the ring is round in these units
    tube = np.sqrt(2) * around.std()
    hole = max(1.2, float(around.mean() / tube))
    sizes = np.append(tube * spread[:2], np.sqrt(2) * spread[2])
    return Superquadric("toroid", sizes, np.ones(2), axes, centre, hole_radius=hole)


def hyperboloid_by_quadric(points: Array, kind: str) -> Superquadric:
    """The quadric +-(x/a1)^2 +-(y/a2)^2 - (z/a3)^2 = 1 nearest to the points, over the orders of the principal axes.

    Raises:
        DegenerateError: no order of the axes gives a hyperboloid.
    """
    signs = np.array([1.0, 1.0, -1.0] if kind == "hyperboloid1" else [1.0, -1.0, -1.0])
    centre, axes, _ = principal_frame(points)
    best, best_cost = None, np.inf
    for order in permutations(range(3)):
        turned = axes[:, order]
        turned = turned * [np.linalg.det(turned), 1, 1]
        squares = signs * ((points - centre) @ turned) ** 2
        coefficients = np.linalg.lstsq(squares, np.ones(len(points)), rcond=None)[0]
        cost = float(((squares @ coefficients - 1) ** 2).sum())
        if (coefficients > 0).all() and cost < best_cost * (1 - 1e-9):
            best, best_cost = (turned, coefficients**-0.5), cost
    if best is None:
        raise DegenerateError(
            f"points do not look like kind={kind!r}; expected them around a hyperboloid, try 'ellipsoid'"
        )
    return Superquadric(
        kind,
        best[1],
        np.ones(2),
        best[0],
        centre,
        height=_reach(points, centre, best, kind),
    )


def _reach(points: Array, centre: Array, frame: tuple[Array, Array], kind: str) -> float:
    axis = 0 if kind == "hyperboloid2" else 2
    reach = float(np.abs((points - centre) @ frame[0][:, axis]).max())
    return max(reach, 1.01 * frame[1][axis]) if axis == 0 else reach


def start(points: Array, kind: str) -> Superquadric:
    """The paper's one start for a kind."""
    if kind == "ellipsoid":
        return ellipsoid_by_moments(points)
    if kind == "toroid":
        return toroid_by_moments(points)
    return hyperboloid_by_quadric(points, kind)
