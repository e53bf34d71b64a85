"""A synthetic beating ventricle with known motion, and so known measures.

Before deformation the wall lies between two ellipsoids of revolution about the long axis z, apex downwards. The motion
is polynomial in x, y, z, of degree 4 at most along each of them, so that a box of 5 x 5 x 5 control points represents
it exactly:

    x' = f (x - psi y), y' = f (y + psi x), z' = z (1 - s k0 + s k1 z^2)
    with f = (1 + e z) (1 - s b0 + s b1 (x^2 + y^2 + m z^2)) and psi = s (p0 + p1 z)

where s(t) = sin^2(pi t) is the activation. The factor (1 + e z) makes the ellipsoids egg-shaped, b the cavity
smaller and the wall thicker, k the ventricle shorter, psi twists it. With the default values the volume of the wall is
constant to a few percent, as that of muscle.
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
ROTATION = rotation_from_euler(np.array([0.4, -0.7, 0.3]))
CENTRE = np.array([20.0, -10.0, 60.0])
"""World from the ventricle's own coordinates, as oblique as a real one."""


@dataclass(frozen=True)
class SyntheticVentricle:
    """The ventricle; lengths in mm, times in cycles: 0 is end diastole, 0.5 end systole.

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
        """Return the surface "endo" or "epi" before deformation, in the world."""
        across, along = self.semi_axes(name)
        return Superquadric("ellipsoid", np.array([across, across, along]), rotation=ROTATION, translation=CENTRE)

    def semi_axes(self, name: str) -> tuple[float, float]:
        """Return the semi-axes of "endo" or "epi", across and along the long axis.

        Raises:
            OptionError: another name.
        """
        return self.endo if choose(name, ("endo", "epi"), "surface") == "endo" else self.epi

    def activation(self, time: float) -> float:
        """Return s(t), from 0 at end diastole to 1 at end systole."""
        return float(np.sin(np.pi * time) ** 2)

    def scale(self, rho_squared: Array, z: Array, time: float) -> Array:
        """Return the factor f, by the squared distance from the long axis and the height before deformation."""
        s, (b0, b1, m) = self.activation(time), self.inward
        return (1 + self.egg * z) * (1 - s * b0 + s * b1 * (rho_squared + m * z**2))

    def radius(self, rho: Array, z: Array, time: float) -> Array:
        """Return the distance from the long axis at a time, of points at rho and z before deformation."""
        return self.scale(rho**2, z, time) * np.hypot(1, self.twist(z, time)) * rho

    def height(self, z: Array, time: float) -> Array:
        """Return the height along the long axis at a time, of height z before deformation."""
        s = self.activation(time)
        return z * (1 - s * self.shortening[0] + s * self.shortening[1] * z**2)

    def twist(self, z: Array, time: float) -> Array:
        """Return the parameter psi: the tangent of the angle about the long axis, right-handed about z."""
        return self.activation(time) * (self.twisting[0] + self.twisting[1] * z)

    def angle(self, z: Array, time: float) -> Array:
        """Return the angle about the long axis in radians, right-handed about z."""
        return np.arctan(self.twist(z, time))

    def local_positions(self, local: Array, time: float) -> Array:
        """Return positions (n, 3) at a time, of points (n, 3) before deformation, in the ventricle's coordinates."""
        x, y, z = local.T
        psi, scale = self.twist(z, time), self.scale(x**2 + y**2, z, time)
        return np.stack([scale * (x - psi * y), scale * (y + psi * x), self.height(z, time)], axis=1)

    def positions(self, points: Array, time: float) -> Array:
        """Return positions (n, 3) at a time, of material points (n, 3) before deformation, both in the world."""
        return self.local_positions((points - CENTRE) @ ROTATION, time) @ ROTATION.T + CENTRE

    def model(self, time: float) -> DeformableModel:
        """Return the exact model at a time, with a box of 5 x 5 x 5 control points."""
        surfaces = {name: self.surface(name) for name in ("epi", "endo")}
        box = ControlBox.around(surfaces["epi"], BOX)
        # 125 conditions at the undeformed nodes determine a polynomial of degree 4 along each axis
        nodes = box.rest.reshape(-1, 3)
        points = np.asarray(np.linalg.solve(box.matrix(nodes), self.positions(nodes, time)), dtype=np.float64)
        return DeformableModel(surfaces, box.with_control_points(points), "LPS", "mm")

    def models(self, times: ArrayLike) -> list[DeformableModel]:
        """Return the exact models at times (F,)."""
        return [self.model(float(time)) for time in np.atleast_1d(times)]

    def surface_points(self, name: str, time: float, n: int, noise: float = 0.0, seed: int = 0) -> Array:
        """Return points (n, 3) of a surface at a time, in the world, evenly spread before deformation.

        Args:
            name: "endo" or "epi".
            time: in cycles.
            n: number of points.
            noise: standard deviation of each coordinate, in mm.
            seed: of the noise.
        """
        # Fibonacci lattice: equal steps of height, golden-angle steps around
        up = 1 - (2 * np.arange(n) + 1) / n
        around = np.arange(n) * np.pi * (3 - 5**0.5)
        flat = np.sqrt(1 - up**2)
        directions = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=1)
        exact = self.positions(self.surface(name).surface(directions), time)
        return exact + noise * np.random.default_rng(seed).normal(size=exact.shape)

    def mitral_points(self, time: float, fraction: float = 0.8, n: int = 8) -> Array:
        """Return material points (n, 3) of the endocardium around the base at a time, in the world.

        They lie in a plane across the long axis, at end diastole at a fraction of the length of the cavity from its
        apex.
        """
        z = self.endo[1] * (2 * fraction - 1)
        around = 2 * np.pi * np.arange(n) / n
        rho = self.endo[0] * np.sqrt(1 - (z / self.endo[1]) ** 2)
        local = np.stack([rho * np.cos(around), rho * np.sin(around), np.full(n, z)], axis=1)
        return self.local_positions(local, time) @ ROTATION.T + CENTRE

    def base_plane(self, fraction: float = 0.8) -> tuple[Array, Array]:
        """Return a plane (point, direction) across the long axis, at a fraction of its length at end diastole."""
        return CENTRE + ROTATION[:, 2] * self.endo[1] * (2 * fraction - 1), ROTATION[:, 2].copy()
