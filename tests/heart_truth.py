"""The true measures of the synthetic ventricle, by integrals of its formulas, without box or mesh.

The ventricle is a body of revolution that twists about its axis, so all measures are integrals over height or latitude.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.points import Array

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)
STEP = 1e-6
"""Of central differences, which have an error of 1e-9."""
LATITUDES, DEPTHS = 20000, 6


def true_volume(heart: SyntheticVentricle, name: str, time: float, up_to: float = np.inf) -> float:
    """Return the volume of a surface's inside in ml, below a height (mm, along the long axis, at that time)."""
    across, along = heart.semi_axes(name)
    top = _before(heart, min(up_to, float(heart.height(np.array(along), time))), time, along)
    z = -along + (top + along) * (NODES + 1) / 2
    rho = across * np.sqrt(1 - (z / along) ** 2)
    derivative = (heart.height(z + STEP, time) - heart.height(z - STEP, time)) / (2 * STEP)
    area = np.pi * heart.radius(rho, z, time) ** 2
    return float((top + along) / 2 * WEIGHTS @ (area * derivative)) / 1000


def _before(heart: SyntheticVentricle, height: float, time: float, along: float) -> float:
    """The z before deformation of a height, by bisection."""
    low, high = -along, along
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if heart.height(np.array(middle), time) < height else (low, middle)
    return (low + high) / 2


@dataclass(frozen=True)
class Grid:
    """Points of the wall by latitude and depth, (m,) each, and their weights.

    Attributes:
        latitude: of the ray from the centre, in the endocardium's own units.
        depth: from 0 at the endocardium to 1 at the epicardium.
        weight: of the point in an integral by both.
    """

    latitude: Array
    depth: Array
    weight: Array

    @classmethod
    def dense(cls) -> "Grid":
        """Return even latitudes, which a cut across them suits, and Gauss points in depth."""
        step = np.pi / LATITUDES
        nodes, weights = np.polynomial.legendre.leggauss(DEPTHS)
        latitude = -np.pi / 2 + step * (np.arange(LATITUDES) + 0.5)
        rows = np.repeat(latitude, DEPTHS), np.tile((nodes + 1) / 2, LATITUDES)
        return cls(*rows, np.tile(weights / 2 * step, LATITUDES))


def _before_deformation(heart: SyntheticVentricle, latitude: Array, depth: Array) -> tuple[Array, Array]:
    """Distance from the axis and height of points on rays from the centre."""
    (a, c), (b, d) = heart.endo, heart.epi
    across, along = a * np.cos(latitude), c * np.sin(latitude)
    scale = 1 + depth * (1 / np.hypot(across / b, along / d) - 1)
    return scale * across, scale * along


def _at(heart: SyntheticVentricle, latitude: Array, depth: Array, time: float) -> Array:
    """Distance, angle and height (3, m) of such points at a time."""
    rho, z = _before_deformation(heart, latitude, depth)
    return np.stack([heart.radius(rho, z, time), heart.angle(z, time), heart.height(z, time)])


def _derivatives(heart: SyntheticVentricle, grid: Grid, time: float) -> tuple[Array, Array, Array]:
    """Distance (m,), and derivatives (3, m) by latitude and by depth as lengths in cylindrical directions."""
    here = _at(heart, grid.latitude, grid.depth, time)
    latitudes = [_at(heart, grid.latitude + step, grid.depth, time) for step in (-STEP, STEP)]
    depths = [_at(heart, grid.latitude, grid.depth + step, time) for step in (-STEP, STEP)]
    lengths = np.stack([np.ones_like(here[0]), here[0], np.ones_like(here[0])])
    return here[0], *(lengths * (b - a) / (2 * STEP) for a, b in (latitudes, depths))


def _strain(heart: SyntheticVentricle, grid: Grid, time: float) -> Array:
    """Green's strain (m, 3, 3) along the radial, circumferential and longitudinal directions at end diastole."""
    radius, along, across = _derivatives(heart, grid, 0.0)
    after, along_after, across_after = _derivatives(heart, grid, time)
    around, around_after = (r * np.array([[0.0], [1.0], [0.0]]) for r in (radius, after))
    before = np.stack([along, around, across], axis=1).transpose(2, 0, 1)
    later = np.stack([along_after, around_after, across_after], axis=1).transpose(2, 0, 1)
    gradient = np.linalg.solve(before.transpose(0, 2, 1), later.transpose(0, 2, 1)).transpose(0, 2, 1)
    tangent = (along / np.linalg.norm(along, axis=0)).T
    circle = np.broadcast_to([0.0, 1.0, 0.0], tangent.shape)
    axes = np.stack([np.cross(circle, tangent), circle, tangent], axis=1)
    fibres = axes @ gradient.transpose(0, 2, 1)
    return (fibres @ fibres.transpose(0, 2, 1) - np.eye(3)) / 2


def true_measures(heart: SyntheticVentricle, time: float, fraction: float = 0.8) -> dict[str, float]:
    """Return the measures of `measure`, by their names, from end diastole to a time.

    Args:
        heart: the ventricle.
        time: of end systole.
        fraction: of the length of the cavity, where `heart.mitral_points(time, fraction)` are the base.
    """
    apex, base = -heart.endo[1], heart.endo[1] * (2 * fraction - 1)
    after = float(heart.height(np.array(base), time))
    cavity = [true_volume(heart, "endo", t, top) for t, top in ((0.0, base), (time, after))]
    muscle = true_volume(heart, "epi", 0.0, base) - cavity[0]
    lengths = [_meridian(heart, t, base) for t in (0.0, time)]
    found = {
        "end-diastolic volume": cavity[0],
        "end-systolic volume": cavity[1],
        "stroke volume": cavity[0] - cavity[1],
        "ejection fraction": 100 * (1 - cavity[1] / cavity[0]),
        "myocardial mass": 1.05 * muscle,
        "longitudinal strain": 100 * (lengths[1] / lengths[0] - 1),
    }
    levels = apex + (base - apex) * np.array([0.25, 0.75])
    return found | _wall_measures(heart, time, base, levels) | _twist(heart, time, levels)


def _meridian(heart: SyntheticVentricle, time: float, base: float) -> float:
    """Length of the endocardium's contour from the apex to a height before deformation."""
    latitude = np.linspace(-np.pi / 2, np.arcsin(base / heart.endo[1]), LATITUDES)
    rho, z = heart.endo[0] * np.cos(latitude), heart.endo[1] * np.sin(latitude)
    return float(np.hypot(np.diff(heart.radius(rho, z, time)), np.diff(heart.height(z, time))).sum())


def _wall_measures(heart: SyntheticVentricle, time: float, base: float, levels: Array) -> dict[str, float]:
    grid = Grid.dense()
    radius, along, across = _derivatives(heart, grid, 0.0)
    heights = _at(heart, grid.latitude, grid.depth, 0.0)[2]
    volume = grid.weight * 2 * np.pi * radius * np.abs(along[0] * across[2] - along[2] * across[0]) * (heights <= base)
    lines = volume.reshape(LATITUDES, DEPTHS).sum(axis=1)
    thickness = [_thickness(heart, grid, t) for t in (0.0, time)]
    area = lines / thickness[0]
    before, after = (float(area @ t / area.sum()) for t in thickness)
    strain = _strain(heart, grid, time)
    green = np.einsum("m,mkk->k", volume, strain) / volume.sum()
    around = volume @ (np.sqrt(1 + 2 * strain[:, 1, 1]) - 1) / volume.sum()
    slab = volume * ((heights >= levels[0]) & (heights <= levels[1]))
    found = {
        "wall thickness, end diastole": before,
        "wall thickness, end systole": after,
        "wall thickening": 100 * (after / before - 1),
        "radial strain": 100 * float(area @ (thickness[1] / thickness[0] - 1) / area.sum()),
        "circumferential strain": 100 * float(around),
        "torsional shear strain": float(slab @ strain[:, 1, 2] / slab.sum()),
    }
    for k, name in enumerate(("radial", "circumferential", "longitudinal")):
        found[f"Green strain, {name}"] = float(green[k])
    return found


def _thickness(heart: SyntheticVentricle, grid: Grid, time: float) -> Array:
    """Length (LATITUDES,) of the lines across the wall at a time."""
    speed = np.linalg.norm(_derivatives(heart, grid, time)[2], axis=0).reshape(LATITUDES, DEPTHS)
    return speed @ np.polynomial.legendre.leggauss(DEPTHS)[1] / 2


def _twist(heart: SyntheticVentricle, time: float, levels: Array) -> dict[str, float]:
    angles = np.degrees(heart.angle(levels, time))
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 20001)
    middle, _, heights = _at(heart, latitude, np.full_like(latitude, 0.5), 0.0)
    angle, distance = float(angles[1] - angles[0]), float(levels[1] - levels[0])
    mean_radius = float(np.interp(levels, heights, middle).mean())
    return {
        "twist angle": angle,
        "twist per length": angle / distance,
        "torsional shear angle": angle * mean_radius / distance,
    }
