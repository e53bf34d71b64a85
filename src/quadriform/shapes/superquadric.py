"""A superquadric in space: one of four kinds, with sizes, exponents and pose (paper 2, A.1, A.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, choose
from quadriform.points import LARGEST, Array, check_points, fixed_array, lengths
from quadriform.shapes import _kernel, pose
from quadriform.shapes.kinds import KINDS, Kind
from quadriform.shapes.mesh import Faces, Mesh, richardson, split_quads
from quadriform.shapes.superellipse import quiet
from quadriform.shapes.taubin import bounded_distance, squared_implicit
from quadriform.words import short_repr

SHAPES: dict[str, tuple[int, ...]] = {"semi_axes": (3,), "exponents": (2,), "rotation": (3, 3), "translation": (3,)}
"""Of the arrays of a superquadric, by their names."""
EXPONENTS = (0.01, 2.0)
"""The range of both exponents in fits: nearly a box, to flat bevels."""
PINCHED = 4.0
"""The largest exponent of a shape (A.1); beyond, its arms are thinner than any mesh of it shows."""
ORTHOGONAL = 1e-9
"""Largest error of the products of a rotation's columns."""


@dataclass(frozen=True, repr=False)
class Superquadric:
    """A superellipsoid, supertoroid or superhyperboloid with its pose in space.

    Attributes:
        kind: "ellipsoid", "toroid", "hyperboloid1" (one sheet, around its z axis) or "hyperboloid2" (two, along x).
        semi_axes: (3,) a1, a2, a3 > 0, in the unit of the data; those of the tube for the toroid.
        exponents: (2,) e1 (latitude) and e2 (longitude), in [0.01, 4]: nearly a box below 0.1, round at 1, bevelled
            at 2, pinched above (A.1). Fits keep them in [0.01, 2].
        rotation: (3, 3), from the object's frame to the world.
        translation: (3,), the centre in the world.
        hole_radius: the toroid's twelfth parameter a4 > 1: the radius of the core of its tube, in units of the tube's
            semi-axes, so that of the empty hole is a4 - 1; None for the others.
        height: where a hyperboloid is cut: `|z|` of one sheet, `|x| > a1` of two, in the unit of the data.

    Raises:
        OptionError: a number is out of its range.
    """

    __repr__ = short_repr

    kind: str = "ellipsoid"
    semi_axes: Array = (1.0, 1.0, 1.0)  # type: ignore[assignment]
    exponents: Array = (1.0, 1.0)  # type: ignore[assignment]
    rotation: Array = ((1, 0, 0), (0, 1, 0), (0, 0, 1))  # type: ignore[assignment]
    translation: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    hole_radius: float | None = None
    height: float | None = None

    def __post_init__(self) -> None:
        choose(self.kind, tuple(KINDS), "kind")
        for name, shape in SHAPES.items():
            object.__setattr__(self, name, fixed_array(getattr(self, name), name, shape))
        self._check_ranges()

    def _check_ranges(self) -> None:
        if (self.semi_axes < LARGEST**-2).any():
            raise OptionError(f"semi_axes: expected lengths above 0, found {self.semi_axes.tolist()}")
        if (self.exponents < EXPONENTS[0]).any() or (self.exponents > PINCHED).any():
            raise OptionError(
                f"exponents: expected numbers from {EXPONENTS[0]} to {PINCHED}, found {self.exponents.tolist()}"
            )
        # a reflection would exchange inside and outside
        skewness = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if skewness > ORTHOGONAL or np.linalg.det(self.rotation) < 0:
            raise OptionError("rotation: expected an orthogonal matrix with determinant +1")
        hole, height = self.hole_radius, self.height
        if (hole is not None) != self._shape.has_hole or (hole is not None and not 1 < hole <= LARGEST):
            raise OptionError(f"hole_radius: a number above 1 for the toroid alone, found {hole}")
        axis = self._shape.cut_axis
        least = 0.0 if axis is None else self._shape.least_cut * self.semi_axes[axis]
        if (height is None) != (axis is None) or (height is not None and not least < height <= LARGEST):
            raise OptionError(f"height: a length above {least:g} for hyperboloids alone, found {height}")

    @property
    def _shape(self) -> Kind:
        return KINDS[self.kind]

    @property
    def is_radial(self) -> bool:
        """Whether the surface lies around its centre: every ray from there meets it once."""
        return self._shape.is_radial

    @property
    def _hole(self) -> float:
        return self.hole_radius or 0.0

    # --- parameters -------------------------------------------------------------------------------------------------

    @property
    def parameters(self) -> Array:
        """The parameters: a1 a2 a3, e1 e2, three Euler angles (radians), tx ty tz; the toroid's hole radius is 12th."""
        # The paper counts the rotation by three angles.
        euler = pose.euler_from_rotation(self.rotation)
        hole = [] if self.hole_radius is None else [self.hole_radius]
        return np.concatenate([self.semi_axes, self.exponents, euler, self.translation, hole])

    def with_parameters(self, parameters: Array) -> Superquadric:
        """The superquadric of the same kind with other parameters, in the order of `parameters`."""
        return replace(
            self,
            semi_axes=parameters[:3],
            exponents=parameters[3:5],
            rotation=pose.rotation_from_euler(parameters[5:8]),
            translation=parameters[8:11],
            hole_radius=None if self.hole_radius is None else float(parameters[11]),
        )

    def transformed(self, scale: float, offset: Array) -> Superquadric:
        """The same surface after `scale` x + `offset`: from a centred, scaled frame back to the world."""
        return replace(
            self,
            semi_axes=scale * self.semi_axes,
            translation=scale * self.translation + offset,
            height=None if self.height is None else scale * self.height,
        )

    def rotated(self, rotation: Array) -> Superquadric:
        """The same surface after a rotation (3, 3) about the world's origin."""
        return replace(self, rotation=rotation @ self.rotation, translation=rotation @ self.translation)

    def to_local(self, points_world: Array) -> Array:
        """Points (n, 3) in the superquadric's own frame, R^T (x - t), of world points (n, 3)."""
        return (points_world - self.translation) @ self.rotation  # P11

    def to_world(self, points_local: Array) -> Array:
        """World points (n, 3), R x + t, of points (n, 3) in the superquadric's own frame."""
        return points_local @ self.rotation.T + self.translation  # P11

    # --- inside and outside --------------------------------------------------------------------------------------

    def scaled(self, points: ArrayLike) -> Array:
        """World points (n, 3) in the own frame, in units of the semi-axes."""
        return self.to_local(check_points(points)) / self.semi_axes

    @quiet
    def implicit(self, points: ArrayLike) -> Array:
        """Inside-outside function F (P1, P11) at world points (n, 3): 1 on the surface, < 1 inside, > 1 outside."""
        return self._shape.implicit(self.scaled(points), self.exponents, self._hole)  # P11

    @quiet
    def gradient(self, points: ArrayLike) -> Array:
        """Gradient of F by the world point, (n, 3), in 1 / unit; finite everywhere, also on axes and at the centre."""
        by_point = self._shape.derivatives(self.scaled(points), self.exponents, self._hole).point
        return (by_point / self.semi_axes) @ self.rotation.T

    @quiet
    def parameter_derivatives(self, points: ArrayLike) -> tuple[Array, Array]:
        """F (n,) and its derivatives by every parameter, (n, 11) or (n, 12), in the order of `parameters`."""
        world = check_points(points)
        q = self.scaled(world)
        d = self._shape.derivatives(q, self.exponents, self._hole)
        by_local = d.point / self.semi_axes
        by_world = by_local @ self.rotation.T
        by_rotation = np.cross(by_world, world - self.translation)  # of a small rotation w: dF = (by_world x arm) . w
        columns = [-q * by_local, d.exponents, by_rotation @ pose.euler_axes(self.rotation).T, -by_world]
        if self.hole_radius is not None:
            columns.append(d.hole[:, None])
        return d.value, np.concatenate(columns, axis=1)

    # --- the surface ---------------------------------------------------------------------------------------------

    def surface(self, directions: ArrayLike) -> Array:
        """World points (n, 3) of the surface, by direction.

        Args:
            directions: for the ellipsoid unit directions (n, 3), the regular parametrisation of section 2.2; for
                the other kinds latitude and longitude (n, 2) in radians, their natural parametrisation.
        """
        if not self._shape.is_radial:
            return self.natural(directions)
        return self._world(self._shape.project(check_points(directions, "directions"), self.exponents, 0.0))

    def natural(self, angles: ArrayLike) -> Array:
        """World points (n, 3) by latitude and longitude (n, 2) in radians: P2 and its analogues."""
        pairs = np.asarray(angles, dtype=np.float64)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.isfinite(pairs).all():
            raise OptionError(f"angles: expected finite latitudes and longitudes of shape (n, 2), found {pairs.shape}")
        return self._world(self._shape.natural(pairs, self.exponents, self._hole))

    @quiet
    def project(self, points: ArrayLike) -> Array:
        """Surface points (n, 3) on the rays of world points (n, 3): from the centre for the ellipsoid."""
        return self._world(self._shape.project(self.scaled(points), self.exponents, self._hole))

    def _world(self, scaled: Array) -> Array:
        return self.to_world(scaled * self.semi_axes)

    def grid(self, resolution: int) -> tuple[Array, Faces]:
        """Evenly spread world points (n, 3) of the surface and quads (m, 4) between them; `resolution` as in `mesh`."""
        cut = (self.height or 0.0) / self.semi_axes[self._shape.cut_axis or 0]
        scaled, quads = self._shape.grid(resolution, self.exponents, self._hole, cut)
        return self._world(scaled), quads

    def mesh(self, resolution: int = 24) -> Mesh:
        """Triangles of the surface: closed for ellipsoid and toroid, open at the cut for hyperboloids.

        Args:
            resolution: cells along an edge of the cube that is projected onto the surface (6 n^2 + 2 vertices), or a
                quarter of the cells around a toroid or hyperboloid.
        """
        vertices, quads = self.grid(resolution)
        return Mesh(vertices, split_quads(quads, vertices))

    # --- distances and sizes -------------------------------------------------------------------------------------

    def radial_distance(self, points: ArrayLike) -> Array:
        """`|M0 M|` along the ray from the centre (paper 2.4), (n,), >= the true distance; ellipsoid only."""
        self._only_ellipsoid("radial_distance")
        world = check_points(points)
        return np.linalg.norm(world - self.project(world), axis=1)  # section 2.4

    @quiet
    def first_order_distance(self, points: ArrayLike) -> Array:
        """`|F - 1| / |grad F|` (P4), (n,); close to the true distance near the surface."""
        gradient_length = lengths(self.gradient(points))
        return np.abs(self.implicit(points) - 1) / np.maximum(gradient_length, 1e-300)  # P4

    @quiet
    def taubin_distance(self, points: ArrayLike) -> Array:
        """Taubin's distance of second order from F^2 - 1 (paper 2.4), (n,), finite everywhere; ellipsoid only.

        Never above the true distance when both exponents are 1; near a smooth part of any surface it errs by the square
        of the distance, as P4 does, which lies above it. Beside the edges of exponents above 1 it tends to zero.
        """
        self._only_ellipsoid("taubin_distance")
        value, gradient, hessian = squared_implicit(self.scaled(points), self.exponents)
        to_world = self.rotation / self.semi_axes
        return bounded_distance(value, gradient @ to_world.T, to_world @ hessian @ to_world.T)

    def volume(self) -> float:
        """Enclosed volume in cubed units, in closed form.

        Raises:
            OptionError: for hyperboloids, which enclose none.
        """
        e1, e2 = self.exponents
        if self._shape.volume is None:
            raise OptionError(f"kind={self.kind!r} encloses no volume")
        return self._shape.volume(float(np.prod(self.semi_axes)), e1, e2, self._hole)

    def area(self) -> float:
        """Surface area in squared units, from two meshes by Richardson's extrapolation (about 1e-4 relative)."""
        return richardson(self.mesh(48).area(), self.mesh(96).area())

    def compiled(self) -> _kernel.Surface:
        """The superquadric in the form of the compiled loops."""
        return _kernel.Surface(
            self._shape.codes, self.semi_axes, self.exponents, self.rotation, self.translation, self._hole
        )

    def _only_ellipsoid(self, what: str) -> None:
        if not self.is_radial:
            raise OptionError(f"{what} holds for kind='ellipsoid' only, found kind={self.kind!r}")
