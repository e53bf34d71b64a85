"""The search beside ridges: its formulas, derivatives and steps against plain ones, point by point."""

from itertools import product

import numpy as np
import pytest
from shapes_made import KINDS, made

from quadriform.points import LARGEST
from quadriform.shapes import ridges
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.ridges import FAR, SCAN, _logarithms, _octants, _rounding, _Search, beside_ridges

HOLE = 2.5


def search(kind="ellipsoid", exponents=(1.5, 0.8), n=40, seed=2, size=0.2):
    """A search of n targets over a deformed surface, and logarithms where to look at it."""
    surface, rng = made(kind, exponents), np.random.default_rng(seed)
    box = ControlBox.around(surface)
    box = box.with_control_points(box.control_points + rng.normal(0, size, box.control_points.shape))
    targets = surface.grid(6)[0][:n] + rng.normal(size=(n, 3))
    return _Search(surface, box, targets, rng.choice([-1.0, 1.0], (n, 4))), rng.uniform(-1.5, 1.5, (n, 2))


def plain(kind, exponents, signs, t, u):
    """A scaled surface point by the formulas of the module, with powers."""
    k1, k2 = 2 / np.array(exponents)
    of_t, of_u = (1 + np.exp(k2 * t)) ** (1 / k2), (1 + np.exp(k1 * u)) ** (1 / k1)
    s, z = (1 / of_u, np.exp(u) / of_u) if kind in ("ellipsoid", "toroid") else (of_u, np.exp(u))
    if kind == "toroid":
        s = HOLE + signs[3] * s
    x, y = (s * of_t, s * np.exp(t)) if kind == "hyperboloid2" else (s / of_t, s * np.exp(t) / of_t)
    return signs[:3] * [x, y, z]


@pytest.mark.parametrize(("kind", "exponents"), [*product(KINDS, [(1.5, 0.8), (0.5, 2.0)])])
def test_scaled_points_are_those_of_the_formulas_and_on_the_surface(kind, exponents):
    of, at = search(kind, exponents)
    index = np.arange(40)[::-1]
    found = of.scaled(index, at)
    expected = [plain(kind, exponents, of.signs[i], *row) for i, row in zip(index, at)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    points = of.points(at)
    np.testing.assert_allclose(of.superquadric.implicit(points), 1, rtol=1e-9)
    np.testing.assert_allclose(of.superquadric.scaled(points), of.scaled(np.arange(40), at), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_far_along_a_plane_no_power_overflows(kind):
    of, _ = search(kind, (0.02, 2.0), 4)
    at = FAR * np.array([[1.0, 1], [-1, 1], [1, -1], [-1, -1]])
    found = of.scaled(np.arange(4), at)
    expected = [plain(kind, (1.0, 1.0), signs, *row) for signs, row in zip(of.signs, at)]  # the same for each exponent
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-18)
    by_t, by_u = of.derivatives(np.arange(4), at, found)
    assert np.isfinite(by_t).all() and np.isfinite(by_u).all()


@pytest.mark.parametrize(("kind", "exponents"), [*product(KINDS, [(1.5, 0.8), (0.5, 2.0)])])
def test_derivatives_are_those_of_differences(kind, exponents):
    of, at = search(kind, exponents)
    index, h = np.arange(40), 1e-6
    for column, found in enumerate(of.derivatives(index, at, of.scaled(index, at))):
        ahead = h * np.eye(2)[column]
        expected = (of.scaled(index, at + ahead) - of.scaled(index, at - ahead)) / (2 * h)
        np.testing.assert_allclose(found, expected, atol=1e-7)
        slope = (of.value(index, at + ahead) - of.value(index, at - ahead)) / (2 * h)
        np.testing.assert_allclose(of.gradient(index, at)[:, column], slope, atol=1e-6)


def test_directions_are_scaled_and_turned_but_not_moved(rng):
    of, _ = search()
    for row in rng.normal(size=(5, 3)):
        moved = of.superquadric.to_world((row * of.superquadric.semi_axes)[None]) - of.superquadric.translation
        np.testing.assert_allclose(of.to_world(row[None]), moved, rtol=1e-12, atol=1e-12)


def test_the_value_is_half_the_squared_distance_and_infinite_out_of_range():
    of, at = search("hyperboloid1")
    index = np.array([3, 1, 8])
    points = of.box.deform(of.superquadric.to_world(of.scaled(index, at[index]) * of.superquadric.semi_axes))
    expected = [0.5 * sum((of.targets[i] - p) ** 2) for i, p in zip(index, points)]
    np.testing.assert_allclose(of.value(index, at[index]), expected, rtol=1e-12)
    of, reach = search("hyperboloid1", size=0)[0], np.log(LARGEST)
    assert of.value(index[:1], np.array([[0.0, reach + 3]])) == np.inf
    assert of.value(index[:1], np.array([[0.0, 10 * reach]])) == np.inf
    assert of.value(index[:1], np.array([[0.0, 20.0]])) < np.inf


@pytest.mark.parametrize("kind", KINDS)
def test_logarithms_lead_back_to_the_points(kind, rng):
    """In each octant, on both sides of a tube's core."""
    of, at = search(kind, n=60)
    scaled = of.scaled(np.arange(60), at)
    np.testing.assert_allclose(_logarithms(of.superquadric, scaled), at, atol=1e-9)
    none = np.zeros((60, 3), dtype=bool)
    index, signs, start = _octants(of.superquadric, scaled, none)
    np.testing.assert_array_equal(index, np.arange(60))
    np.testing.assert_array_equal(signs[:, :3], of.signs[:, :3])
    np.testing.assert_array_equal(signs[:, 3], of.signs[:, 3] if kind == "toroid" else np.ones(60))
    np.testing.assert_allclose(start, at, atol=1e-9)


def test_points_in_a_plane_are_as_far_along_as_numbers_reach():
    surface = made()
    scaled = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    np.testing.assert_array_equal(_logarithms(surface, scaled), [[-FAR, -FAR], [FAR, -FAR], [0, FAR]])


def test_each_coordinate_beside_a_plane_doubles_the_octants():
    of, at = search(n=8)
    scaled = of.scaled(np.arange(8), at)
    beside = np.array(list(product([False, True], repeat=3)))
    index, signs, start = _octants(of.superquadric, scaled, beside)
    found = {(int(i), *map(int, row)) for i, row in zip(index, signs[:, :3])}
    expected = set()
    for i in range(8):
        for mirror in product((1, -1), repeat=3):
            if all(factor == 1 or small for factor, small in zip(mirror, beside[i])):
                expected.add((i, *(int(np.sign(c)) * factor for c, factor in zip(scaled[i], mirror))))
    assert found == expected
    assert len(index) == len(expected)
    np.testing.assert_array_equal(start, _logarithms(of.superquadric, scaled)[index])


@pytest.mark.parametrize("n", [0, 3])
def test_candidates_are_no_farther_than_the_origins_and_on_the_surface(n):
    of, at = search(n=3)
    origins = of.points(at)[:n]
    index, points = beside_ridges(of.superquadric, of.box, of.targets, origins, np.ones((n, 3), dtype=bool))
    assert points.shape == (len(index), 3) and len(index) == 8 * n
    if not n:
        return
    np.testing.assert_allclose(of.superquadric.implicit(points), 1, rtol=1e-9)
    distance = np.linalg.norm(of.box.deform(points) - of.targets[index], axis=1)
    for i in range(n):
        assert distance[index == i].min() <= np.linalg.norm(of.box.deform(origins[i : i + 1]) - of.targets[i])


def test_along_an_arm_both_the_start_and_what_the_scan_found_are_searched():
    of, at = search(exponents=(3.0, 1.0), n=5)
    beside = np.tile([False, False, True], (5, 1))
    arguments = of.box, of.targets, of.points(at), beside
    index, points = beside_ridges(of.superquadric, *arguments)
    parts, signs, start = _octants(of.superquadric, of.superquadric.scaled(arguments[2]), beside)
    both = _Search(of.superquadric, of.box, of.targets[parts], signs)
    scanned = both.scanned(start, beside[parts])
    moved = [i for i in range(len(start)) if any(scanned[i] != start[i])]
    assert len(moved) > 0
    np.testing.assert_array_equal(index, [*parts, *parts[moved]])
    np.testing.assert_array_equal(points[: len(parts)], both.points(both.least(scanned)))
    np.testing.assert_array_equal(points[len(parts) :], both.points(both.least(start))[moved])
    mild = made(exponents=(2.0, 1.0))
    assert len(beside_ridges(mild, *arguments)[0]) == len(parts)


def test_the_scan_takes_the_best_of_all_logarithms_that_are_beside_planes():
    of, at = search(n=16)
    beside = np.array(list(product([False, True], repeat=3)) * 2)
    found = of.scanned(at, beside)
    for i, (x, y, z) in enumerate(beside):
        every = [at[i]]
        for t in SCAN if x or y else [at[i, 0]]:
            every += [(t, u) for u in (SCAN if z or (x and y) else [at[i, 1]])]
        values = [of.value(np.array([i]), np.array([row]))[0] for row in every]
        np.testing.assert_array_equal(found[i], every[int(np.argmin(values))])


def trust_region_step(of, i, at, radius):
    """One step and its predicted gain by eigenvectors of the scaled Hessian."""
    one = np.array([i])
    gradient, h = of.gradient(one, at[None])[0], 1e-5 * np.minimum(1, of.superquadric.exponents[::-1])
    rows = [(of.gradient(one, (at + h[k] * np.eye(2)[k])[None])[0] - gradient) / h[k] for k in range(2)]
    hessian = (np.array(rows) + np.array(rows).T) / 2
    scale = np.sqrt(np.abs(np.diag(hessian)))
    values, axes = np.linalg.eigh(hessian / np.outer(scale, scale))
    newton = -axes @ ((axes.T @ (gradient / scale)) / np.abs(values)) / scale
    steps = [np.clip(newton, -radius, radius)]
    steps += [np.clip(-gradient[k] / scale[k] ** 2, -radius, radius) * np.eye(2)[k] for k in range(2)]
    # alone, a step along one coordinate takes its curvature as positive, as the Newton step does
    gains = [-(gradient @ step + step @ hessian @ step / 2) for step in steps]
    best = 0 if gains[0] >= max(gains[1:]) else int(np.argmax(gains))
    return steps[best], gains[best]


@pytest.mark.parametrize(("kind", "exponents"), [("ellipsoid", (1.5, 0.8)), ("toroid", (2, 2)), ("ellipsoid", (3, 1))])
def test_a_step_is_newtons_within_the_radius_and_downhill(kind, exponents):
    of, at = search(kind, exponents, 150)
    radius = np.resize([8.0, 1.0, 0.1], len(at))
    step, gain = of._step(np.arange(len(at)), at, radius)
    expected = [trust_region_step(of, i, at[i], radius[i]) for i in range(len(at))]
    np.testing.assert_allclose(step, [each[0] for each in expected], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(gain, [each[1] for each in expected], rtol=1e-6, atol=1e-9)
    assert (gain > 0).all() and (np.abs(step) <= radius[:, None]).all()


@pytest.mark.parametrize("exponents", [(1.5, 1.5), (2.5, 1.5)])
@pytest.mark.parametrize("steps", [1, 3, 6, 9])
def test_the_search_shortens_its_steps_after_a_poor_one_and_lengthens_them_after_a_good_one(
    monkeypatch, steps, exponents
):
    """Point by point, the rule in scalars."""
    monkeypatch.setattr(ridges, "STEPS", steps)
    of, at = search(exponents=exponents, n=30)
    for i, found in enumerate(of.least(at)):
        one, here, radius, growth = np.array([i]), at[i : i + 1].copy(), 1.0, 1.0
        for _ in range(steps):
            step, predicted = of._step(one, here, np.array([radius]))
            step = step * [growth if abs(each) > 6 else 1 for each in here[0]]
            trial = np.clip(here + step, -FAR, FAR)
            gain = of.value(one, here)[0] - of.value(one, trial)[0]
            if gain < 0.25 * predicted[0]:
                radius = 0.25 * np.linalg.norm(step)
            elif gain > 0.5 * predicted[0]:
                radius = min(2 * radius, 8.0)
            growth = min(2 * growth, 8.0 if max(exponents) <= 2 else 1.0) if gain > 1.2 * predicted[0] else 1.0
            here = trial if gain > 0 else here
        np.testing.assert_allclose(found, here[0], rtol=1e-6, atol=1e-6)


def test_the_search_ends_where_the_distance_is_least():
    of, at = search(exponents=(1.5, 1.5), n=30)
    found, every = of.least(at), np.arange(30)
    assert (of.value(every, found) <= of.value(every, at)).all()
    slope = np.abs(of.gradient(every, found)).max(axis=1)
    assert slope.max() < 1e-6 * np.linalg.norm(of.box.edges) ** 2


def test_rounding_of_a_gain_grows_with_the_square_of_lengths():
    value = np.array([0.0, 0.02, 8.0])
    found = _rounding(3.0, value)
    np.testing.assert_allclose(found, 3e-15 * np.array([3e-13, 0.2, 4.0]), rtol=1e-9)
    np.testing.assert_allclose(_rounding(30.0, 100 * value), 100 * found, rtol=1e-12)
