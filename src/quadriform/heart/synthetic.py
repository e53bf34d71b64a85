"""A synthetic beating ventricle whose motion, and so every measure, is known.

Before deformation the wall lies between two ellipsoids of revolution about the long axis z, apex downwards. All motion
is polynomial in x, y, z, of degree 4 at most along each of them, so that a box of 5 x 5 x 5 control points holds it
exactly:

    x' = f (x - psi y), y' = f (y + psi x), z' = z (1 - s k0 + s k1 z^2)
    with f = (1 + e z) (1 - s b0 + s b1 (x^2 + y^2 + m z^2)) and psi = s (p0 + p1 z)

where s(t) = sin^2(pi t) is the activation. The factor (1 + e z) makes an egg of the ellipsoids, b the cavity smaller
and the wall thicker, k the ventricle shorter, psi twists it. With the numbers below the wall keeps its volume to a few
percent, as muscle does.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import choose
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.pose import rotation_from_euler
from quadriform.shapes.superquadric import Superquadric

BOX = (5, 5, 5)
TURN = rotation_from_euler(np.array([0.4, -0.7, 0.3]))
CENTRE = np.array([20.0, -10.0, 60.0])
"""Where the ventricle lies in the world, as oblique as a real one."""


@dataclass(frozen=True)
class SyntheticVentricle:
    """The ventricle; lengths in mm, t = 0 is end diastole, t = 0.5 end systole, t = 1 end diastole again.

    Attributes:
        endo: (2,) semi-axes before deformation, across and along the long axis.
        epi: (2,) the same of the epicardium.
        egg: e, in 1 / mm: how much wider the base is than the apex.
        inward: b0, b1 (1 / mm^2) and m.
        shortening: k0 and k1 (1 / mm^2).
        twisting: p0 (radians) and p1 (radians per mm).
    """

    endo: tuple[float, float] = (24.0, 44.0)
    epi: tuple[float, float] = (34.0, 53.0)
    egg: float = 0.002
    inward: tuple[float, float, float] = (0.525, 3.86e-4, 0.36)
    shortening: tuple[float, float] = (0.24, 6.5e-5)
    twisting: tuple[float, float] = (0.02, 0.004)

    def surface(self, name: str) -> Superquadric:
        """The surface "endo" or "epi" before deformation, in the world."""
        across, along = self.semi_axes(name)
        return Superquadric("ellipsoid", np.array([across, across, along]), rotation=TURN, translation=CENTRE)

    def semi_axes(self, name: str) -> tuple[float, float]:
        """Of "endo" or "epi": across and along.

        Raises:
            OptionError: another name.
        """
        return self.endo if choose(name, ("endo", "epi"), "surface") == "endo" else self.epi

    def activation(self, time: float) -> float:
        """s(t), from 0 at end diastole to 1 at end systole."""
        return float(np.sin(np.pi * time) ** 2)

    def size(self, rho_squared: Array, z: Array, time: float) -> Array:
        """The factor f, by the squared distance from the long axis and the height before deformation."""
        s, (b0, b1, m) = self.activation(time), self.inward
        return (1 + self.egg * z) * (1 - s * b0 + s * b1 * (rho_squared + m * z**2))

    def radius(self, rho: Array, z: Array, time: float) -> Array:
        """Distance from the long axis at a time, of points at distance rho and height z before deformation."""
        return self.size(rho**2, z, time) * np.hypot(1, self.turn(z, time)) * rho

    def height(self, z: Array, time: float) -> Array:
        """Height along the long axis at a time."""
        s = self.activation(time)
        return z * (1 - s * self.shortening[0] + s * self.shortening[1] * z**2)

    def turn(self, z: Array, time: float) -> Array:
        """The parameter psi: the tangent of the angle about the long axis, right-handed about z."""
        return self.activation(time) * (self.twisting[0] + self.twisting[1] * z)

    def angle(self, z: Array, time: float) -> Array:
        """The angle about the long axis in radians, right-handed about z."""
        return np.arctan(self.turn(z, time))

    def carry(self, local: Array, time: float) -> Array:
        """Points (n, 3) before deformation, in the ventricle's own frame, to where they are at a time, in it."""
        x, y, z = local.T
        psi, size = self.turn(z, time), self.size(x**2 + y**2, z, time)
        return np.stack([size * (x - psi * y), size * (y + psi * x), self.height(z, time)], axis=1)

    def positions(self, points: Array, time: float) -> Array:
        """Material points (n, 3), before deformation, in the world, to where they are at a time."""
        return self.carry((points - CENTRE) @ TURN, time) @ TURN.T + CENTRE

    def model(self, time: float) -> DeformableModel:
        """The known model at a time: its box of 5 x 5 x 5 control points holds the motion exactly."""
        surfaces = {name: self.surface(name) for name in ("epi", "endo")}
        box = ControlBox.around(surfaces["epi"], BOX)
        nodes = box.rest.reshape(-1, 3)
        points = np.asarray(np.linalg.solve(box.matrix(nodes), self.positions(nodes, time)), dtype=np.float64)
        return DeformableModel(surfaces, box.with_control_points(points), "LPS", "mm")

    def models(self, times: ArrayLike) -> list[DeformableModel]:
        """The known models at times (F,)."""
        return [self.model(float(time)) for time in np.atleast_1d(times)]

    def surface_points(self, name: str, time: float, n: int, noise: float = 0.0, seed: int = 0) -> Array:
        """Points (n, 3) of a surface at a time, in the world, well spread before deformation.

        Args:
            name: "endo" or "epi".
            time: in cycles.
            n: how many.
            noise: standard deviation of each coordinate, in mm.
            seed: of the noise.
        """
        up = 1 - (2 * np.arange(n) + 1) / n
        around = np.arange(n) * np.pi * (3 - 5**0.5)
        flat = np.sqrt(1 - up**2)
        directions = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=1)
        exact = self.positions(self.surface(name).surface(directions), time)
        return exact + noise * np.random.default_rng(seed).normal(size=exact.shape)

    def mitral_points(self, time: float, share: float = 0.8, n: int = 8) -> Array:
        """Material points (n, 3) of the endocardium around the base at a time, in the world.

        At end diastole they lie at a share of the cavity's length from its apex, across the long axis, and so at all
        times.
        """
        z = self.endo[1] * (2 * share - 1)
        around = 2 * np.pi * np.arange(n) / n
        rho = self.endo[0] * np.sqrt(1 - (z / self.endo[1]) ** 2)
        local = np.stack([rho * np.cos(around), rho * np.sin(around), np.full(n, z)], axis=1)
        return self.carry(local, time) @ TURN.T + CENTRE

    def base_plane(self, share: float = 0.8) -> tuple[Array, Array]:
        """A plane (point, direction) across the long axis, at a share of the cavity's length at end diastole."""
        return CENTRE + TURN[:, 2] * self.endo[1] * (2 * share - 1), TURN[:, 2].copy()
