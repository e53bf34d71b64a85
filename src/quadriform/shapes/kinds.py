"""The kinds of superquadric, a table with one entry each, in their own frame and units of the semi-axes (2, A.1).

Each kind is a composition of two superellipse norms N_e (the spherical product of Barr 1981), so its inside-outside
function and each derivative is the chain rule over `superellipse.norm`:

    ellipsoid      F = N_e1(N_e2(x, y), z)                    closed; F of degree one
    toroid         F = N_e1(N_e2(x, y) - a4, z)               a4 the radius of the core of the tube
    hyperboloid1   F = N_e2(x, y) / N_e1(1, z)                around the z axis
    hyperboloid2   F = N_e2(N_e1(1, z), y) / |x|              two sheets along the x axis

The kind "ellipsoid" is the superellipsoid; in the names of functions an ellipsoid is a true one, with e1 = e2 = 1.

In these units a toroid has a tube of radius 1, a4 > 1 is its `hole_radius`, and the empty hole has the radius a4 - 1.

F = 1 on the surface, < 1 inside (around the axis for one sheet; for two sheets beyond each, away from the centre), > 1
outside (for two sheets between them).
The compiled loops and the viewer take their formulas from the same table (`Kind.codes`, `Kind.record`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import beta

from quadriform.points import Array
from quadriform.shapes.directions import disc_grid, sphere_grid, torus_grid, tube_grid
from quadriform.shapes.mesh import Faces
from quadriform.shapes.superellipse import TINY, norm, norm_derivatives, signed_power

LEAST_X = 1e-50
"""Stands for |x| = 0 of two sheets, where F is infinite: squares of its gradient stay finite."""
HOLE = 5
"""Place of the hole radius among the derivatives: after x, y, z, e1 and e2."""
TERMS = ("x", "y", "z", "one", "inner", "outer")
"""What norms and quotients are taken of; the compiled loops know them by their index. "one" is the constant 1."""


@dataclass(frozen=True)
class Norm:
    """A superellipse norm N_e(u, v) (P10) within F: the index of its exponent (0: e1, 1: e2) and its two terms."""

    exponent: int
    u: str
    v: str


AROUND_Z, ACROSS, WAIST = Norm(1, "x", "y"), Norm(0, "inner", "z"), Norm(0, "one", "z")


@dataclass(frozen=True)
class Derivatives:
    """F at n scaled points and its derivatives.

    Attributes:
        value: (n,).
        point: (n, 3), by the scaled point.
        exponents: (n, 2), by e1 and e2.
        hole: (n,), by the hole radius; zero for kinds without one.
    """

    value: Array
    point: Array
    exponents: Array
    hole: Array


@dataclass(frozen=True)
class Kind:
    """A kind of superquadric; in its methods `q` are (n, 3) scaled points, `e` (2,) the exponents.

    Attributes:
        name: of the option `kind`.
        title: its name in the field.
        layout: of the grid over the surface: a name in `LAYOUTS`.
        inner: the norm that is taken first; the hole radius is subtracted from it.
        outer: the norm that may be taken of it.
        over: F is this term ...
        under: ... divided by this one: "one", "outer", or "x" for |x|.
        powers: to which power of F each coordinate is multiplied to reach the surface: -1, 0 or 1. With a hole, the
            surface is reached from the core of the tube instead.
        curves: of the latitude, along z, and of the longitude, in x and y, in the natural parametrisation: "circle"
            (cosine and sine) or "hyperbola" (secant and tangent).
        volume: (product of the semi-axes, e1, e2, hole radius) -> enclosed volume; None for open kinds.
        cut_axis: the coordinate that an open kind is cut along; None for closed kinds.
        least_cut: the least height of the cut, in units of the semi-axis.
        has_hole: whether the hole radius is a twelfth parameter.
    """

    name: str
    title: str
    layout: str
    inner: Norm = AROUND_Z
    outer: Norm = ACROSS
    over: str = "outer"
    under: str = "one"
    powers: tuple[int, int, int] = (-1, -1, -1)
    curves: tuple[str, str] = ("circle", "circle")
    volume: Callable[[float, float, float, float], float] | None = None
    cut_axis: int | None = None
    least_cut: float = 0.0
    has_hole: bool = False

    @property
    def n_parameters(self) -> int:
        """The number of parameters of a surface: 11, and a hole radius where it has one."""
        return 12 if self.has_hole else 11

    @property
    def extra(self) -> str | None:
        """The attribute of a surface that this kind alone has beside sizes, exponents and pose; None for none."""
        return "hole_radius" if self.has_hole else None if self.cut_axis is None else "height"

    @property
    def is_radial(self) -> bool:
        """Whether rays from the centre lead to the surface: F is of degree one."""
        return self.powers == (-1, -1, -1) and not self.has_hole

    @property
    def codes(self) -> NDArray[np.int32]:
        """The composition as the compiled loops take it, (11,): both norms, the quotient, the powers."""
        norms = [code for n in (self.inner, self.outer) for code in (n.exponent, TERMS.index(n.u), TERMS.index(n.v))]
        return np.array([*norms, TERMS.index(self.over), TERMS.index(self.under), *self.powers], dtype=np.int32)

    def record(self) -> dict[str, Any]:
        """The composition as the viewer takes it: what it needs to lay out a grid, as JSON can hold it."""
        norms = {name: [n.exponent, n.u, n.v] for name, n in (("inner", self.inner), ("outer", self.outer))}
        return {**norms, "over": self.over, "under": self.under, "layout": self.layout, "cut_axis": self.cut_axis}

    def implicit(self, q: Array, e: Array, hole: float) -> Array:
        """The inside-outside function F, (n,): P1 and its analogues."""
        terms = self._terms(q, e, hole)
        return terms[self.over] / terms[self.under]  # P1, section 2

    def _terms(self, q: Array, e: Array, hole: float) -> dict[str, Array]:
        """Every term of F by its name, (n,) each; under a fraction "x" is |x|, kept from zero."""
        terms = {"x": q[:, 0], "y": q[:, 1], "z": q[:, 2], "one": np.ones(len(q))}
        terms["inner"] = norm(terms[self.inner.u], terms[self.inner.v], e[self.inner.exponent]) - hole
        terms["outer"] = norm(terms[self.outer.u], terms[self.outer.v], e[self.outer.exponent])
        return terms | {"x": np.maximum(np.abs(q[:, 0]), LEAST_X)}

    def derivatives(self, q: Array, e: Array, hole: float) -> Derivatives:
        """F and its derivatives, by the chain rule."""
        terms = dict(zip("xyz", q.T)) | {"one": np.ones(len(q))}
        # the inner norm less the hole radius, the outer norm of it, then their quotient
        inner = _Term.of(self.inner, terms, e, None)
        inner.value -= hole
        inner.by[HOLE] = -1.0 if self.has_hole else 0.0
        outer = _Term.of(self.outer, terms | {"inner": inner.value}, e, inner)
        f = inner if self.over == "inner" else outer
        if self.under == "outer":
            f = f.divided_by(outer)
        elif self.under == "x":
            f = f.divided_by(_Term.of_size(q[:, 0]))
        return Derivatives(f.value, np.stack(list(f.by[:3]), 1), np.stack(list(f.by[3:HOLE]), 1), f.by[HOLE])

    def natural(self, angles: Array, e: Array, hole: float) -> Array:
        """Scaled surface points (n, 3) by latitude and longitude (n, 2), the natural parametrisation (P2).

        Circles run a full turn (latitudes of the ellipsoid half of it), hyperbolas from -pi/2 to pi/2; a longitude of
        two sheets plus pi is on the other one.
        """
        (ring, z), (x, y) = (CURVES[curve](a, p) for curve, a, p in zip(self.curves, angles.T, e))
        ring = hole + ring
        return np.stack([ring * x, ring * y, z], axis=1)  # P2

    def project(self, q: Array, e: Array, hole: float) -> Array:
        """The surface point on the ray through each point: from the centre, the core of a tube, or an axis."""
        f = self.implicit(q, e, hole)
        if self.has_hole:
            # along the ray from the core of the tube, of radius `hole`: F grows in proportion to the distance from it
            s = norm(q[:, 0], q[:, 1], e[1])
            ring = (hole + (s - hole) / f) / s
            return np.stack([q[:, 0] * ring, q[:, 1] * ring, q[:, 2] / f], axis=1)
        columns = zip(q.T, self.powers)
        return np.stack([c * f if power > 0 else c / f if power else c for c, power in columns], axis=1)  # section 2.2

    def grid(self, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
        """Evenly spread surface points (n, 3) and quads (m, 4) between them; `cut` is the scaled height."""
        return LAYOUTS[self.layout](self, resolution, e, hole, cut)


@dataclass
class _Term:
    """A term of F (n,), and its derivatives by x, y, z, e1, e2 and the hole radius (6, n)."""

    value: Array
    by: Array

    @classmethod
    def of(cls, chosen: Norm, terms: dict[str, Array], e: Array, inner: "_Term | None") -> "_Term":
        """A norm of two terms, of which one may be the inner norm; coordinates have unit gradients."""
        value, by_u, by_v, by_exponent = norm_derivatives(terms[chosen.u], terms[chosen.v], e[chosen.exponent])
        by = np.zeros((6, len(value)))
        for name, factor in ((chosen.u, by_u), (chosen.v, by_v)):
            if name in ("x", "y", "z"):
                by["xyz".index(name)] += factor
            elif name == "inner" and inner is not None:
                by += factor * inner.by
        by[3 + chosen.exponent] += by_exponent
        return cls(value, by)

    @classmethod
    def of_size(cls, x: Array) -> "_Term":
        """|x|, kept from zero."""
        by = np.zeros((6, len(x)))
        by[0] = np.where(x < 0, -1.0, 1.0)
        return cls(np.maximum(np.abs(x), LEAST_X), by)

    def divided_by(self, other: "_Term") -> "_Term":
        """The quotient of two terms."""
        # the quotient rule with the quotient itself in it: no square of a small denominator
        f = self.value / other.value
        return _Term(f, (self.by - f * other.by) / other.value)


def _circle(angle: Array, exponent: float) -> tuple[Array, Array]:
    return signed_power(np.cos(angle), exponent), signed_power(np.sin(angle), exponent)


def _hyperbola(angle: Array, exponent: float) -> tuple[Array, Array]:
    cosine = np.cos(angle)
    secant = np.sign(cosine) * np.exp(-exponent * np.log(np.maximum(np.abs(cosine), TINY)))
    return secant, signed_power(np.tan(angle), exponent)


CURVES = {"circle": _circle, "hyperbola": _hyperbola}


def _sphere(kind: Kind, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
    """Points (n, 3) and quads by the projection of a cube's grid onto the surface."""
    directions, quads = sphere_grid(resolution)
    return kind.project(directions, e, hole), quads


def _torus(kind: Kind, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
    """Points (n, 3) and quads on even rays of both superellipses, over full circles."""
    angles, quads = torus_grid(resolution)
    tube, around = _ring(angles[:, 0], e[0]), _ring(angles[:, 1], e[1])
    return np.column_stack([(hole + tube[:, :1]) * around, tube[:, 1]]), quads


def _tube(kind: Kind, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
    """Points (n, 3) and quads at even heights along z between the cuts, on even rays around z."""
    angles, quads = tube_grid(np.linspace(-cut, cut, 2 * resolution + 1), 4 * resolution)
    ring, z = _ring(angles[:, 1], e[1]), angles[:, 0]
    radius = kind._terms(np.column_stack([ring, z]), e, hole)["outer"]
    return np.column_stack([ring * radius[:, None], z]), quads


def _two_sheets(kind: Kind, resolution: int, e: Array, hole: float, cut: float) -> tuple[Array, Faces]:
    """Points (n, 3) and quads over a disc of (y, z) scaled to the cut, once for each side of x = 0."""
    disc, quads = disc_grid(resolution)
    yz = disc * _reach(kind, disc, e, cut)[:, None]
    front = kind.project(np.column_stack([np.ones(len(yz)), yz]), e, hole)
    return np.concatenate([front, front * [-1.0, 1.0, 1.0]]), np.concatenate([quads[:, ::-1], quads + len(disc)])


def _reach(kind: Kind, disc: Array, e: Array, cut: float) -> Array:
    """Length of each ray of the (y, z) plane up to where the surface is at the cut, by bisection."""
    ray = disc / np.maximum(np.linalg.norm(disc, axis=1), TINY)[:, None]
    # the height grows along a ray, so halving finds where it is that of the cut
    low, high = np.zeros(len(ray)), np.full(len(ray), 2 * cut)
    for _ in range(60):
        middle = (low + high) / 2
        height = kind._terms(np.column_stack([np.ones(len(ray)), ray * middle[:, None]]), e, 0.0)["outer"]
        low, high = np.where(height < cut, middle, low), np.where(height < cut, high, middle)
    return low


def _ring(angle: Array, exponent: float) -> Array:
    """Points (n, 2) of the unit superellipse on even rays."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c, s], axis=1) / norm(c, s, exponent)[:, None]


LAYOUTS = {"sphere": _sphere, "torus": _torus, "tube": _tube, "two sheets": _two_sheets}


def _ellipsoid_volume(product: float, e1: float, e2: float, hole: float) -> float:
    return 2 * product * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)


def _toroid_volume(product: float, e1: float, e2: float, hole: float) -> float:
    """Pappus: 2 a4 times the areas of both unit superellipses, which is area times length around for two circles."""
    return 8 * product * hole * e1 * e2 * beta(e1 / 2, e1 / 2 + 1) * beta(e2 / 2, e2 / 2 + 1)


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("ellipsoid", "superellipsoid", "sphere", volume=_ellipsoid_volume),
        Kind("toroid", "supertoroid", "torus", volume=_toroid_volume, has_hole=True),
        Kind(
            "hyperboloid1",
            "superhyperboloid of one sheet",
            "tube",
            outer=WAIST,
            over="inner",
            under="outer",
            powers=(-1, -1, 0),
            curves=("hyperbola", "circle"),
            cut_axis=2,
        ),
        Kind(
            "hyperboloid2",
            "superhyperboloid of two sheets",
            "two sheets",
            inner=WAIST,
            outer=Norm(1, "inner", "y"),
            under="x",
            powers=(1, 0, 0),
            curves=("hyperbola", "hyperbola"),
            cut_axis=0,
            least_cut=1.0,
        ),
    )
}
