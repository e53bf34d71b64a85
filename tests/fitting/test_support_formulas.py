"""Each measure of support against a plain computation, triangle by triangle and point by point."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, made, turned

from quadriform.fitting import interpolation
from quadriform.fitting import support as supports
from quadriform.fitting.support import Arrangement, Reach, Support, rms_without_data, spread_by_distance
from quadriform.fitting.support_settings import LIMITS, ONE
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric

MESH = made(exponents=(1, 1)).mesh(8)
BASE = BasePlane(np.array([1.2, -1.8, 0.4]), np.array([0.6, 0.0, 0.8]))
ABOVE = BasePlane(MESH.vertices.mean(axis=0) + 4 * BASE.direction, BASE.direction)
"""The surface closes below it, in part without data."""


def part_of_the_surface(n=150, seed=3):
    """Points near the part of the surface on one side, and their nearest vertices as feet."""
    rng = np.random.default_rng(seed)
    points = made(exponents=(1, 1)).surface(even_directions(n))
    points = (
        points[points @ [0.3, 0.8, 0.2] < 0] + 0.05 * rng.normal(size=(n, 3))[: (points @ [0.3, 0.8, 0.2] < 0).sum()]
    )
    gaps = np.linalg.norm(points[:, None] - MESH.vertices, axis=2)
    return points, MESH.vertices[gaps.argmin(axis=1)]


@pytest.mark.parametrize("base", [None, BASE, ABOVE], ids=["whole", "cut by a base", "below a base"])
@pytest.mark.parametrize("step", [0.0, 0.3])
def test_support_is_the_share_of_the_triangles_within_the_limit(step, base):
    """Of cones to the middle of the data or the base; of columns up to the base where the surface closes below it."""
    points, feet = part_of_the_surface()
    noise = 0.02
    triangles = MESH.vertices[MESH.faces]
    middles = np.array([(a + b + c) / 3 for a, b, c in triangles])
    areas = np.array([np.linalg.norm(np.cross(b - a, c - a)) / 2 for a, b, c in triangles])
    data, distances, limit = supports._distances_from_data(points, feet, middles, areas, max(3 * noise, step))
    found, near = supports.support_of(MESH, points, feet, noise, base, step), distances <= limit
    middle = points[data].mean(axis=0)
    apex = middle if base is None else base.point
    cones, below, within = [], [], []
    for (a, b, c), m, supported, area in zip(triangles, middles, near, areas):
        cones.append(abs(np.linalg.det([a - middle, b - middle, c - middle])) / 6)
        below.append(abs(np.linalg.det([a - apex, b - apex, c - apex])) / 6)
        height = -1.0 if base is None else (m - base.point) @ base.direction
        below[-1] *= height <= 0
        within.append(area * (base is None or height <= -2 * noise))
        up = 0.0 if base is None else np.cross(b - a, c - a) @ base.direction / 2
        if up > 0 >= height and not supported:
            below[-1] = -height * up
    shares = [sum(np.array(of)[near]) / sum(of) for of in (areas, cones, below, within)]
    if base is not None:
        assert found.by_volume == (shares[2] < shares[3])
        shares[3] = min(shares[2:])
    np.testing.assert_allclose([found.area, found.volume, found.below, found.within], shares, rtol=1e-9)
    assert found.limit == limit and 0 < min(shares) < max(shares) < 1
    vertices = MESH.vertices if base is None else MESH.vertices[base.heights(MESH.vertices) <= 0]
    assert found.reach == Reach.of(vertices, points[data])
    assert found.extends_beyond == Reach.of(MESH.vertices, points[data]).distance


def test_reach_is_the_largest_over_even_directions(monkeypatch):
    points, _ = part_of_the_surface()
    rows = []
    for direction in sphere_grid(LIMITS.directions)[0]:
        of_points, of_vertices = points @ direction, MESH.vertices @ direction
        rows.append((of_vertices.max() - of_points.max(), of_points.max() - of_points.min()))
    expected = max(rows)
    for at_once in (10, 4_000_000):
        monkeypatch.setattr(supports, "LIMITS", replace(LIMITS, at_once=at_once))
        found = Reach.of(MESH.vertices, points)
        np.testing.assert_allclose([found.distance, found.width], expected, rtol=1e-9)


def test_without_data_the_surface_reaches_its_radius_beyond():
    found = supports.support_of(MESH, np.empty((0, 3)), np.empty((0, 3)), 1.0, BASE)
    middle = MESH.vertices.mean(axis=0)
    far = max(np.linalg.norm(vertex - middle) for vertex in MESH.vertices)
    assert found == Support(0.0, 0.0, 0.0, 0.0, 0.0, found.extends_beyond, Reach(found.extends_beyond, 0.0))
    np.testing.assert_allclose(found.extends_beyond, far, rtol=1e-12)


def test_lengths_are_scaled_and_shares_are_not():
    found = Support(0.1, 0.2, 0.3, 0.4, 5.0, 6.0, Reach(7.0, 8.0)).scaled(3)
    assert found == Support(0.1, 0.2, 0.3, 0.4, 15.0, 18.0, Reach(21.0, 24.0))


def plain_limit(distances, areas, first):
    """Rounds of three medians by area of the parts within the limit, at least the first."""
    limit = first
    for _ in range(60):
        parts = sorted((d, a) for d, a in zip(distances, areas) if d <= limit)
        if not parts:
            return limit
        total = np.cumsum([a for _, a in parts])
        median = next(d for (d, _), below in zip(parts, total) if below >= total[-1] / 2)
        before, limit = limit, max(first, 3 * median)
        if limit == before:
            break
    return limit


@pytest.mark.parametrize("seed", range(6))
def test_the_limit_grows_with_the_median_of_what_it_supports(seed):
    rng = np.random.default_rng(seed)
    distances, areas = rng.gamma(1 + seed, size=40), rng.uniform(0.5, 2, 40)
    for first in (0.01, 1.0, 3.0):
        expected = plain_limit(distances, areas, first)
        np.testing.assert_allclose(interpolation._grown(distances, areas, first), expected, rtol=1e-9)


def test_growing_limits_end_after_sixty_rounds():
    """Each round supports one more part, of half the area again, three halves as far."""
    distances, areas = 0.5 * 1.5 ** np.arange(200), 1e3 ** np.arange(100.0).repeat(2)
    found = interpolation._grown(distances, areas, 1.0)
    np.testing.assert_allclose(found, plain_limit(distances, areas, 1.0), rtol=1e-9)
    assert found < distances[-1]


@pytest.mark.parametrize("seed", range(6))
def test_a_surface_is_interpolated_to_four_medians_of_what_lies_between_data(seed):
    """Parts nearest to the same points as those beyond the grown limit do not lie between data."""
    rng = np.random.default_rng(seed)
    distances = np.concatenate([rng.uniform(0, 1, 60), [50.0, 60, 70]])
    areas, nearest = rng.uniform(0.5, 2, 63), rng.integers(0, 12, 63)
    grown, beyond = plain_limit(distances, areas, 0.6), {nearest[k] for k in range(60, 63)}
    between = sorted((d, a) for d, a, n in zip(distances, areas, nearest) if d <= grown and n not in beyond)
    total = np.cumsum([a for _, a in between])
    median = next(d for (d, _), below in zip(between, total) if below >= total[-1] / 2)
    assert total[-1] > 0.1 * areas.sum()
    found = interpolation.interpolated(distances, nearest, areas, 0.3)
    np.testing.assert_allclose(found, max(0.6, 4 * median), rtol=1e-9)
    assert interpolation.interpolated(distances, np.zeros(63, dtype=int), areas, 0.3) == pytest.approx(grown)


@pytest.mark.parametrize("n", [0, 40, 191, 192, 400, 800, 3000, 5000])
def test_covered_cells_are_those_nearest_to_a_point(n):
    surface = made()
    points = surface.surface(np.random.default_rng(n).normal((0, 0, 1.5), size=(n, 3))) if n else np.empty((0, 3))
    found = [supports.covered_fraction(surface, points, half) for half in (None, (BASE.point, BASE.direction))]
    if not n:
        assert found == [0, 0]
        return
    resolution = max(k for k in (2, 4, 6, 8) if k == 2 or n >= 8 * 6 * k**2)
    cells = sphere_grid(resolution)[0]
    local = surface.to_local(points) / surface.semi_axes
    cosines = (local / np.linalg.norm(local, axis=1, keepdims=True)) @ cells.T
    seen = np.isin(np.arange(len(cells)), cosines.argmax(axis=1))
    below = (surface.surface(cells) - BASE.point) @ BASE.direction <= 0
    np.testing.assert_allclose(found, [seen.mean(), seen[below].mean()], rtol=1e-12)


def test_a_surface_that_is_not_around_its_centre_is_covered_and_one_beyond_a_plane_is_not():
    torus = made("toroid")
    assert supports.covered_fraction(torus, torus.grid(2)[0]) == 1
    points = Superquadric().surface(even_directions(50))
    assert supports.covered_fraction(Superquadric(), points, (np.array([0, 0, -5.0]), np.array([0, 0, 1.0]))) == 0


def test_clusters_that_are_closed_bodies_are_counted():
    ball, aside = even_directions(150), np.array([1.0, 0, 0])
    gap = ONE.distant * 0.3
    near, far = ball + (2 + 0.9 * gap) * aside, ball + (2 + 1.3 * gap) * aside
    assert supports.closed_bodies(np.concatenate([ball, near]), 0.3) == 1
    assert supports.closed_bodies(np.concatenate([ball, far]), 0.3) == 2
    assert supports.closed_bodies(np.concatenate([ball, far[:12] + 9 * aside]), 0.3) == 1
    half = ball[ball[:, 2] < 0]
    assert supports.closed_bodies(np.concatenate([half, half + 9 * aside]), 0.5) == 0
    assert supports.closed_bodies(ball[:99], 5.0) == 0
    third = np.concatenate([even_directions(300), 20 + even_directions(110), 40 + even_directions(99)])
    assert supports.closed_bodies(third, 0.3) == 2
    few = np.concatenate([even_directions(1400), 20 + even_directions(120)])  # below a tenth of all
    assert supports.closed_bodies(few, 0.3) == 1


def test_of_many_points_an_even_sample_is_looked_at():
    points = np.arange(17.0)[:, None] * [1, 0, 0]
    far = np.abs(points[:, 0] - 8)
    np.testing.assert_array_equal(far[spread_by_distance(points, 5)], np.sort(far)[[0, 4, 8, 12, 16]])
    np.testing.assert_array_equal(spread_by_distance(points[:3], 5), [1, 0, 2])


@pytest.mark.parametrize(("cut", "closed"), [(20, True), (44, True), (62, True), (80, False)])
def test_a_body_is_closed_where_its_widest_empty_cone_is_below_40_degrees(cut, closed):
    """In units of its own axes, whatever its pose and size."""
    u = even_directions(3000)
    points = u[u[:, 2] < np.cos(np.radians(cut))] * [5, 1, 3] @ turned(2).T + 7
    centred = points - points.mean(axis=0)
    values, axes = np.linalg.eigh(centred.T @ centred)
    units = centred @ axes / np.sqrt(values)
    cosines = (units / np.linalg.norm(units, axis=1, keepdims=True)) @ sphere_grid(ONE.directions)[0].T
    empty = np.degrees(np.arccos(cosines.max(axis=0).min()))
    assert supports._is_closed(points) == closed == (empty < 40)


def test_flat_clusters_and_few_points_are_no_bodies():
    ball = even_directions(120)
    assert not supports._is_closed(ball * [1, 1, 0])
    assert not supports._is_closed(ball * [1, 1, 1e-7])
    assert supports._is_closed(ball * [1, 1, 1e-5])
    assert supports._is_closed(even_directions(100)) and not supports._is_closed(even_directions(99))


def plain_layered(feet, deviations, radius):
    """The best of all splits of each neighbourhood into at least four inner and four outer points."""
    found = []
    for foot in feet:
        near = np.argsort(np.linalg.norm(feet - foot, axis=1))[:16]
        ordered, best = np.sort(deviations[near]), (-1.0, 0.0)
        for k in range(4, 13):
            inner, outer = ordered[:k].mean(), ordered[k:].mean()
            explained = (k * (inner - ordered.mean()) ** 2 + (16 - k) * (outer - ordered.mean()) ** 2) / 16
            best = max(best, (explained, outer - inner))
        found.append(best[0] > 0.85 * ordered.var() and best[1] > 0.1 * radius)
    return np.mean(found)


@pytest.mark.parametrize("step", [0.08, 0.12, 0.3])
def test_two_layers_are_the_best_split_of_neighbouring_deviations(step, rng):
    feet = even_directions(400)
    # one layer on a part, two on another, three points of a second one on a third
    second = np.where(feet[:, 2] > 0.3, rng.random(400) < 0.4, (feet[:, 2] > -0.4) & (rng.random(400) < 0.12))
    deviations = step * second + rng.normal(0, 0.01, 400) * (1 + 3 * (feet[:, 0] > 0))
    expected = plain_layered(feet, deviations, 1.0)
    np.testing.assert_allclose(supports.layered_fraction(feet, deviations, 1.0), expected, rtol=1e-12)
    np.testing.assert_allclose(supports.layered_fraction(7 * feet, 7 * deviations, 7.0), expected, rtol=1e-12)
    assert (step > 0.1) == (expected > 0.1)


def test_layers_need_sixteen_points():
    feet, deviations = even_directions(16), np.repeat([0.0, 1.0], 8)
    assert supports.layered_fraction(feet, deviations, 1.0) == 1
    assert supports.layered_fraction(feet[:15], deviations[:15], 1.0) == 0
    assert supports.layered_fraction(feet, np.zeros(16), 1.0) == 0


def test_points_deeper_than_a_third_of_the_thickness_fill_a_body():
    assert supports.deep_fraction(np.array([-0.34, -0.33, 0.5, 0.0]), 1.0) == 0.25
    assert supports.deep_fraction(np.array([-0.6, -0.7, 0.5, 0.0]), 2.0) == 0.25
    assert supports.deep_fraction(np.empty(0), 1.0) == 0


def test_whether_points_are_of_one_surface_by_all_three_tests():
    """The mean thickness is twice the volume over the area: two thirds of the radius of a ball."""
    ball = Superquadric().mesh(16)
    points = even_directions(200)
    signed = np.where(np.arange(200) % 4 == 0, -0.215, -0.235)
    found = Arrangement.of(ball, points, points, signed, 0.3)
    assert found.bodies == 1 and found.layered == 0 and found.filled == 0.75
    thick = np.where(np.arange(200) % 2, 0.0, 0.12)
    assert Arrangement.of(ball, points, points, thick, 0.3).layered > 0.9
    assert Arrangement.of(ball, 2 * points, points, thick, 0.3).layered == 0
    assert ONE.most == 0.1


@pytest.mark.parametrize("radius", [0.02, 0.05])
def test_the_distance_of_a_part_without_data_counts_by_its_area(radius):
    """A ball of radius r at a distance of two has r^2 / (1 + r^2) of the area, at a distance of one from the data."""
    data, ball = even_directions(3000), Superquadric().mesh(24)
    mesh = Mesh(
        np.concatenate([ball.vertices, radius * ball.vertices + [2, 0, 0]]),
        np.concatenate([ball.faces, ball.faces + len(ball.vertices)]),
    )
    nowhere, there = np.zeros(len(mesh.faces), dtype=bool), np.repeat([False, True], len(ball.faces))
    expected = radius / np.sqrt(1 + radius**2)
    assert rms_without_data(mesh, data, data, 0.0, nowhere) == pytest.approx(expected, rel=0.01)
    assert rms_without_data(mesh, data, data, 0.0, there) == 0  # where no data is expected
    assert rms_without_data(ball, data, data, 0.0, nowhere[: len(ball.faces)]) == 0
    assert rms_without_data(ball, data[:0], data[:0], 0.0, nowhere[: len(ball.faces)]) == 0
