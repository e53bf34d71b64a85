"""The four kinds of superquadric in their own frame, divided by the semi-axes (paper 2.1, A.1; Barr 1981).

Each is a composition of two superellipse norms N_e (Barr's spherical product), so each inside-outside function and
each derivative is the chain rule over `superellipse.norm`:

    ellipsoid      F = N_e1(N_e2(x, y), z)                    closed; F of degree one
    toroid         F = N_e1(N_e2(x, y) - a4, z)               a4 the hole radius in units of the tube
    hyperboloid1   F = N_e2(x, y) / N_e1(1, z)                around the z axis
    hyperboloid2   F = N_e2(N_e1(1, z), y) / |x|              two sheets along the x axis

F = 1 on the surface, < 1 inside (on the side of the axis for one sheet, beyond the sheets for two), > 1 outside.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from quadriform.points import Array
from quadriform.shapes.directions import disc_grid, sphere_grid, torus_grid, tube_grid
from quadriform.shapes.mesh import Faces
from quadriform.shapes.superellipse import TINY, norm, norm_derivatives, signed_power

WAIST = 1e-50
"""Stands for |x| = 0 of two sheets, where F is infinite: squares of its gradient stay finite."""


@dataclass(frozen=True)
class Derivatives:
    """F at n scaled points and its derivatives.

    Attributes:
        value: (n,), F.
        point: (n, 3), by the scaled point.
        exponents: (n, 2), by e1 and e2.
        hole: (n,), by the hole radius; zero for kinds without one.
    """

    value: Array
    point: Array
    exponents: Array
    hole: Array


class Kind(Protocol):
    """What a kind must know; `q` is (n, 3) scaled points, `angles` (n, 2) latitude and longitude."""

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """F, (n,)."""

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """F and its derivatives."""

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """Scaled surface points (n, 3) by the natural parametrisation."""

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """The surface point on the ray through each point; the ray's origin is the kind's own."""

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """Well spread surface points (n, 3) and quads (m, 4) between them; `cut` is the scaled height."""


def _ring(angle: Array, exponent: float) -> Array:
    """Points (n, 2) of the unit superellipse on even rays."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c, s], axis=1) / norm(c, s, exponent)[:, None]


def _secant(angle: Array, exponent: float) -> Array:
    return np.exp(-exponent * np.log(np.maximum(np.cos(angle), TINY)))


class Ellipsoid:
    """The superellipsoid, P1 and P2."""

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """P1."""
        return norm(norm(q[:, 0], q[:, 1], e[1]), q[:, 2], e[0])  # P1

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """P1 differentiated."""
        s, s_x, s_y, s_e2 = norm_derivatives(q[:, 0], q[:, 1], e[1])
        f, f_s, f_z, f_e1 = norm_derivatives(s, q[:, 2], e[0])
        return Derivatives(
            f, np.stack([f_s * s_x, f_s * s_y, f_z], 1), np.stack([f_e1, f_s * s_e2], 1), np.zeros_like(f)
        )

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """P2."""
        n, w = angles.T
        ring = signed_power(np.cos(n), e[0])
        return np.stack(  # P2
            [
                ring * signed_power(np.cos(w), e[1]),
                ring * signed_power(np.sin(w), e[1]),
                signed_power(np.sin(n), e[0]),
            ],
            axis=1,
        )

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """The regular parametrisation (2.2): rho q with rho = 1 / F(q), since F is of degree one."""
        return q / self.implicit(q, e, hole)[:, None]  # section 2.2

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """Directions of the blown-up cube."""
        directions, quads = sphere_grid(resolution)
        return self.project(directions, e, hole), quads


class Toroid:
    """The supertoroid: the same latitude curve pushed out by the hole radius."""

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """Barr's form, made of degree one in the distance to the core of the tube."""
        return norm(norm(q[:, 0], q[:, 1], e[1]) - hole, q[:, 2], e[0])  # section 2

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """The same differentiated."""
        s, s_x, s_y, s_e2 = norm_derivatives(q[:, 0], q[:, 1], e[1])
        f, f_s, f_z, f_e1 = norm_derivatives(s - hole, q[:, 2], e[0])
        return Derivatives(f, np.stack([f_s * s_x, f_s * s_y, f_z], 1), np.stack([f_e1, f_s * s_e2], 1), -f_s)

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """Latitude and longitude both run full circles."""
        n, w = angles.T
        ring = hole + signed_power(np.cos(n), e[0])
        return np.stack(
            [
                ring * signed_power(np.cos(w), e[1]),
                ring * signed_power(np.sin(w), e[1]),
                signed_power(np.sin(n), e[0]),
            ],
            axis=1,
        )

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """Away from the core of the tube, at the same longitude."""
        s, f = norm(q[:, 0], q[:, 1], e[1]), self.implicit(q, e, hole)
        ring = (hole + (s - hole) / f) / s
        return np.stack([q[:, 0] * ring, q[:, 1] * ring, q[:, 2] / f], axis=1)

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """Even rays of both superellipses, both full circles."""
        angles, quads = torus_grid(resolution)
        tube, around = _ring(angles[:, 0], e[0]), _ring(angles[:, 1], e[1])
        return np.column_stack([(hole + tube[:, :1]) * around, tube[:, 1]]), quads


class OneSheet:
    """The superhyperboloid of one sheet: secant and tangent in the latitude."""

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """Radius over the surface's radius at the same height."""
        return norm(q[:, 0], q[:, 1], e[1]) / norm(np.ones(len(q)), q[:, 2], e[0])  # section 2

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """The same differentiated."""
        s, s_x, s_y, s_e2 = norm_derivatives(q[:, 0], q[:, 1], e[1])
        c, _, c_z, c_e1 = norm_derivatives(np.ones(len(q)), q[:, 2], e[0])
        f = s / c
        point = np.stack([s_x / c, s_y / c, -f * c_z / c], 1)
        return Derivatives(f, point, np.stack([-f * c_e1 / c, s_e2 / c], 1), np.zeros_like(f))

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """Latitude inside (-pi/2, pi/2), longitude a full circle."""
        n, w = angles.T
        ring = _secant(n, e[0])
        return np.stack(
            [
                ring * signed_power(np.cos(w), e[1]),
                ring * signed_power(np.sin(w), e[1]),
                signed_power(np.tan(n), e[0]),
            ],
            axis=1,
        )

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """Away from the axis, at the same height."""
        f = self.implicit(q, e, hole)[:, None]
        return np.concatenate([q[:, :2] / f, q[:, 2:]], axis=1)

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """Even heights between the cuts, even rays around."""
        angles, quads = tube_grid(np.linspace(-cut, cut, 2 * resolution + 1), 4 * resolution)
        z = angles[:, 0]
        around = _ring(angles[:, 1], e[1]) * norm(np.ones(len(z)), z, e[0])[:, None]
        return np.column_stack([around, z]), quads


class TwoSheets:
    """The superhyperboloid of two sheets: secant and tangent in both angles; longitude + pi is the other sheet."""

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """Height of the sheet over y and z, divided by |x|."""
        height = norm(norm(np.ones(len(q)), q[:, 2], e[0]), q[:, 1], e[1])
        return height / np.maximum(np.abs(q[:, 0]), WAIST)  # section 2

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """The same differentiated."""
        x = np.where(q[:, 0] < 0, -1.0, 1.0) * np.maximum(np.abs(q[:, 0]), WAIST)
        c, _, c_z, c_e1 = norm_derivatives(np.ones(len(q)), q[:, 2], e[0])
        s, s_c, s_y, s_e2 = norm_derivatives(c, q[:, 1], e[1])
        r = np.abs(x)
        point = np.stack([-s / r / x, s_y / r, s_c * c_z / r], 1)
        return Derivatives(s / r, point, np.stack([s_c * c_e1, s_e2], 1) / r[:, None], np.zeros_like(r))

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """Latitude inside (-pi/2, pi/2); longitude likewise for the sheet x > 0, plus pi for the other."""
        n, w = angles.T
        ring, side = _secant(n, e[0]), np.sign(np.cos(w))
        along = np.exp(-e[1] * np.log(np.maximum(np.abs(np.cos(w)), TINY)))
        return np.stack(
            [side * ring * along, ring * signed_power(np.tan(w), e[1]), signed_power(np.tan(n), e[0])], axis=1
        )

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """Along the x axis."""
        return np.concatenate([q[:, :1] * self.implicit(q, e, hole)[:, None], q[:, 1:]], axis=1)

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """A disc of (y, z) stretched to the cut, once for each sheet."""
        disc, quads = disc_grid(resolution)
        yz = disc * self._reach(disc, e, cut)[:, None]
        sheet = self.project(np.column_stack([np.ones(len(yz)), yz]), e, hole)
        other = sheet * [-1.0, 1.0, 1.0]
        return np.concatenate([sheet, other]), np.concatenate([quads[:, ::-1], quads + len(disc)])

    def _reach(self, disc: Array, e: Array, cut: float) -> Array:
        """How far each ray of the (y, z) plane goes before the sheet is at the cut, by bisection."""
        ray = disc / np.maximum(np.linalg.norm(disc, axis=1), TINY)[:, None]
        low, high = np.zeros(len(ray)), np.full(len(ray), 2 * cut)
        for _ in range(60):
            middle = (low + high) / 2
            y, z = (ray * middle[:, None]).T
            inside = norm(norm(np.ones(len(z)), z, e[0]), y, e[1]) < cut
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return low


KINDS: dict[str, Kind] = {
    "ellipsoid": Ellipsoid(),
    "toroid": Toroid(),
    "hyperboloid1": OneSheet(),
    "hyperboloid2": TwoSheets(),
}
