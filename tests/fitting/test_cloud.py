"""Each property of a cloud against a plain computation, point by point."""

from itertools import pairwise

import numpy as np
import pytest
from shapes_made import even_directions, turned

from quadriform.fitting import cloud as clouds
from quadriform.fitting.cloud import NEAR, Centred, Distinct, Neighbourhood


def bumpy(n=80, seed=1):
    """Random points about a sphere, and their distances from each other."""
    rng = np.random.default_rng(seed)
    points = even_directions(n) * rng.uniform(0.9, 1.2, (n, 1))
    return points, np.linalg.norm(points[:, None] - points, axis=2)


def test_distinct_points_of_a_cloud_with_copies_and_weights_of_zero(rng):
    points = rng.integers(0, 3, (40, 3)).astype(float)
    weights = np.where(rng.random(40) < 0.2, 0.0, rng.random(40))
    found = Distinct.of(points, weights)
    counted = [i for i in range(40) if weights[i] > 0]
    expected = sorted({tuple(points[i]) for i in counted})
    np.testing.assert_array_equal(found.points, expected)
    sums = [sum(weights[i] for i in counted if tuple(points[i]) == each) for each in expected]
    np.testing.assert_allclose(found.weights, sums, rtol=1e-12)
    assert found.copies == len(counted) - len(expected) > 0
    np.testing.assert_array_equal(found.counted, weights > 0)
    np.testing.assert_array_equal(found.points[found.index], points[counted])
    firsts = [next(i for i in counted if tuple(points[i]) == each) for each in expected]
    np.testing.assert_array_equal(found.of_distinct(np.arange(40)), firsts)
    expanded = found.expand_to_duplicates(np.arange(1.0, len(expected) + 1))
    for i in range(40):
        assert expanded[i] == (1 + expected.index(tuple(points[i])) if weights[i] > 0 else 0)


def test_two_points_of_one_x_are_distinct_and_keep_the_order_of_their_rows():
    points = np.array([[1.0, 5, 0], [0, 0, 0], [1, 2, 0]])
    found = Distinct.of(points, np.ones(3))
    np.testing.assert_array_equal(found.points, [[0, 0, 0], [1, 2, 0], [1, 5, 0]])
    assert found.copies == 0


def test_clouds_share_one_frame_and_one_mean_weight(rng):
    points = {"one": rng.normal(size=(20, 3)) + 5, "other": rng.normal(size=(30, 3))}
    points["one"][1] = points["one"][0]
    weights = {"one": rng.random(20), "other": 3 * rng.random(30)}
    found = Centred.of(points, weights)
    every = np.concatenate([np.delete(points["one"], 1, axis=0), points["other"]])
    centre = every.mean(axis=0)
    scale = np.sqrt(sum((p - centre) @ (p - centre) for p in every) / 49)
    np.testing.assert_allclose([*found.frame.centre, found.frame.scale], [*centre, scale])
    assert found.distinct["one"].copies == 1 and found.distinct["other"].copies == 0
    np.testing.assert_allclose(found.mean_weight, (weights["one"].sum() + weights["other"].sum()) / 49, rtol=1e-12)
    for name in points:
        distinct = Distinct.of(points[name], weights[name])
        np.testing.assert_allclose(found.points[name], (distinct.points - centre) / scale, rtol=1e-9)
        np.testing.assert_allclose(found.weights[name], distinct.weights / found.mean_weight, rtol=1e-12)


def test_the_order_is_by_distance_then_by_the_first_moment_then_by_coordinates(rng):
    lattice = np.stack(np.meshgrid(*[np.arange(-2.0, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = rng.permutation(lattice[rng.random(125) < 0.5])
    far = np.linalg.norm(points, axis=1)
    moment = sum(f * p for f, p in zip(far, points)) / far.max() / (far / far.max()).sum() / far.max()

    def key(i):
        x, y, z = points[i] / far.max()
        return [round(float(v), 9) + 0.0 for v in (far[i] / far.max(), points[i] / far.max() @ moment, z, y, x)]

    np.testing.assert_array_equal(clouds.canonical_order(points), sorted(range(len(points)), key=key))
    shifted = points + np.array([7, 8, 9])
    order = clouds.canonical_order(points - points.mean(axis=0))
    np.testing.assert_array_equal(clouds.evenly_chosen(shifted, len(points)), order)


def test_the_order_of_a_lattice_is_the_same_in_any_unit_and_pose():
    lattice = np.stack(np.meshgrid(*[np.arange(-3.0, 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = lattice[(np.linalg.norm(lattice - [0.2, 0.3, 0.1], axis=1) < 3)]
    points = points - points.mean(axis=0)
    order = clouds.canonical_order(points)
    for unit in (1e-3, 1e4):
        np.testing.assert_array_equal(clouds.canonical_order(unit * points @ turned(2).T), order)
    assert clouds.canonical_order(points[:1]).tolist() == [0]


@pytest.mark.parametrize(("n", "count"), [(1, 1), (5, 9), (10, 4), (10, 1), (11, 3)])
def test_an_even_choice_runs_from_the_first_to_the_last(n, count):
    order = np.arange(n)[::-1]
    expected = (
        [order[0]] if min(n, count) == 1 else [order[i * (n - 1) // (min(n, count) - 1)] for i in range(min(n, count))]
    )
    np.testing.assert_array_equal(clouds.evenly_spread(order, count), expected)


@pytest.mark.parametrize("count", [1, 4, 12, 60])
def test_neighbours_are_the_nearest_and_all_as_near_as_the_last_of_them(count):
    lattice = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:50]
    near, counts = clouds.nearest(lattice, lattice[:9], count)
    assert near.shape == counts.shape == (9, min(count + 12, 50))
    for point, row, of in zip(lattice, near, counts):
        distances = np.linalg.norm(lattice - point, axis=1)
        np.testing.assert_allclose(distances[row], np.sort(distances)[: len(row)])
        last = np.sort(distances)[min(count, 50) - 1]
        assert of.sum() == min((distances < last + 1e-9).sum(), len(row))
        assert of[: of.sum()].all()


def test_principal_axes_of_neighbours_are_those_of_their_scatter():
    points, distances = bumpy()
    found = Neighbourhood.of(points)
    for i, row in enumerate(distances):
        near = points[np.argsort(row)[:12]]
        offset = near - near.mean(axis=0)
        values, axes = np.linalg.eigh(offset.T @ offset)
        np.testing.assert_allclose(np.abs(found.normals[i] @ axes[:, 0]), 1, rtol=1e-9)
        np.testing.assert_allclose(np.abs(found.along[i] @ axes[:, 2]), 1, rtol=1e-9)
        np.testing.assert_allclose(found.flatness[i], (values[1] - values[0]) / values[2], rtol=1e-6)
    some = np.array([3, 1])
    np.testing.assert_array_equal(found.take(some).flatness, found.flatness[some])
    np.testing.assert_array_equal(found.take(some).along, found.along[some])
    np.testing.assert_array_equal(found.take(some).normals, found.normals[some])


def test_copies_of_one_point_are_not_flat():
    found = Neighbourhood.of(np.ones((20, 3)))
    np.testing.assert_array_equal(found.flatness, 0)


def test_a_surface_is_one_whose_median_point_is_flat():
    for flat, expected in ((0.41, True), (0.39, False)):
        of = Neighbourhood(np.zeros((3, 3)), np.zeros((3, 3)), np.array([0.0, flat, 1.0]))
        assert clouds.is_surface(of) == expected


def test_the_flattest_paths_are_a_least_spanning_tree():
    """Kruskal's algorithm over all neighbours, at the cost of the change of the normal and the way along it."""
    points, distances = bumpy(60)
    normals = Neighbourhood.of(points).normals
    costs = {}
    for i, row in enumerate(distances):
        for j in np.argsort(row)[1:12]:
            edge = (points[j] - points[i]) / row[j]
            cost = 1 - abs(normals[i] @ normals[j]) + max((edge @ normals[i]) ** 2, (edge @ normals[j]) ** 2) + 1e-6
            costs[min(i, j), max(i, j)] = cost
    part, expected = list(range(60)), {}
    for (i, j), cost in sorted(costs.items(), key=lambda each: each[1]):
        if part[i] != part[j]:
            expected[i, j] = cost
            part = [part[i] if p == part[j] else p for p in part]
    tree = clouds._flattest_paths(points, normals).tocoo()
    found = {(i, j): value for i, j, value in zip(tree.row, tree.col, tree.data) if i < j}
    assert found.keys() == expected.keys() and len(expected) == 59
    np.testing.assert_allclose([found[key] for key in expected], list(expected.values()), rtol=1e-9)
    np.testing.assert_allclose((tree - tree.T).toarray(), 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_normals_that_agree_are_turned_together(sign):
    points, _ = bumpy()
    outward = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_array_equal(clouds.outward_normals(points + 5, sign * outward), outward)


@pytest.mark.parametrize(("wrong", "kept"), [(1, True), (12, False)])
def test_few_normals_that_disagree_stay_and_many_are_found(wrong, kept):
    points, _ = bumpy(300)
    outward = points / np.linalg.norm(points, axis=1, keepdims=True)
    given = outward.copy()
    given[50 : 50 + 20 * wrong : 20] *= -1
    found = clouds.outward_normals(points, given)
    np.testing.assert_array_equal(found, given if kept else clouds.oriented(points, given))
    np.testing.assert_array_equal(clouds.oriented(points, given), outward)


@pytest.mark.parametrize("away", [0, 5, -5])
def test_an_open_surface_faces_away_from_its_own_centre_wherever_it_lies(away, rng):
    """A cap of a sphere, seen from any side; one that is closed would face outwards from any centre."""
    outward = even_directions(400)
    outward = outward[outward[:, 2] > 0.5]
    given = outward * rng.choice([-1.0, 1.0], (len(outward), 1))
    points = outward + np.array([0, 0, away])
    np.testing.assert_array_equal(clouds.oriented(points, given), outward)
    np.testing.assert_array_equal(clouds.outward_normals(points, -outward), outward)


def test_points_are_dense_whose_tenth_point_is_within_three_times_the_median(rng):
    points = rng.normal(size=(60, 3)) ** 3
    tenth = [np.sort(np.linalg.norm(points - p, axis=1))[9] for p in points]
    expected = np.array(tenth) <= 3 * np.median(tenth)
    np.testing.assert_array_equal(clouds.dense_points(points), expected)
    assert 0 < expected.sum() < 60
    np.testing.assert_array_equal(clouds.dense_points(points[:4]), [True] * 4)


def test_the_widest_empty_angle_is_the_largest_gap_around_the_circle(rng):
    angles = rng.uniform(-np.pi, np.pi, (20, 5))
    for row, found in zip(angles, clouds.widest_empty_angle(angles)):
        ordered = sorted(row)
        gaps = [b - a for a, b in zip(ordered, [*ordered[1:], ordered[0] + 2 * np.pi])]
        np.testing.assert_allclose(found, max(gaps), rtol=1e-12)


def test_creases_are_where_the_median_height_is_far_from_every_quadratic(rng):
    along, across = rng.normal(size=(2, 40, 12)) * rng.uniform(0.5, 3, (40, 1))
    counts = np.arange(12) < rng.integers(8, 13, (40, 1))
    height = 0.1 * along**2 + np.where(np.arange(40) % 2, 0.5, 0.001)[:, None] * rng.normal(size=(40, 12))
    size, middle = [], []
    for x, y, z, counted in zip(along, across, height, counts):
        x, y, z = x[counted], y[counted], z[counted]
        size.append(np.sqrt(np.mean(x**2 + y**2)))
        x, y, z = x / size[-1], y / size[-1], z / size[-1]
        terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
        left = np.abs(z - terms @ np.linalg.lstsq(terms, z, rcond=None)[0])
        middle.append(np.sort(left)[len(left) // 2])
    least = max(0.05, 4 * np.quantile(middle, 0.1))
    expected = (np.array(size) < np.sqrt(2) * np.median(size)) & (np.array(middle) > least)
    np.testing.assert_array_equal(clouds._creased(along, across, height, counts), expected)
    assert 2 < expected.sum() < 38


@pytest.mark.parametrize("ends", [0, 9, 10, 40])
def test_a_cloud_has_an_edge_where_a_hundredth_of_its_points_have_a_wide_empty_angle(monkeypatch, ends):
    """Of 1000 points; creases aside, which are told by another rule."""
    points = even_directions(1000) * 5
    wide = np.where(np.arange(1000) < ends, NEAR.edge_angle + 1e-6, NEAR.edge_angle)
    monkeypatch.setattr(clouds, "widest_empty_angle", lambda angles: wide)
    monkeypatch.setattr(clouds, "_creased", lambda *of: np.zeros(1000, dtype=bool))
    assert clouds.has_edge(points, Neighbourhood.of(points)) == (ends >= 10)
    monkeypatch.setattr(clouds, "_creased", lambda *of: np.arange(1000) < 31)
    assert clouds.has_edge(points, Neighbourhood.of(points)) == (ends >= 41)


def test_angles_and_heights_of_neighbours_are_those_in_the_tangent_plane(monkeypatch):
    points, distances = bumpy(70)
    of, given = Neighbourhood.of(points), {}
    monkeypatch.setattr(clouds, "widest_empty_angle", lambda angles: given.update(angles=angles) or np.full(70, 9.0))
    monkeypatch.setattr(clouds, "_creased", lambda *each: given.update(creased=each) or np.zeros(70, dtype=bool))
    assert clouds.has_edge(points, of)
    along, across, height, counts = given["creased"]
    for i, row in enumerate(distances):
        near = np.argsort(row)[1 : 1 + counts.shape[1]]
        assert counts[i].sum() == 20 and counts[i, :20].all()
        offset = points[near] - points[i]
        third = np.cross(of.normals[i], of.along[i])
        np.testing.assert_allclose(along[i], offset @ of.along[i], atol=1e-12)
        np.testing.assert_allclose(across[i], offset @ third, atol=1e-12)
        np.testing.assert_allclose(height[i], offset @ of.normals[i], atol=1e-12)
        angles = np.arctan2(offset @ third, offset @ of.along[i])
        np.testing.assert_allclose(given["angles"][i], [*angles[:20], *[angles[0]] * (len(near) - 20)], atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 16, 17, 100, 512])
def test_groups_of_ranks_are_pairs_and_then_an_eighth_of_all_before(count):
    found = clouds._groups_of_ranks(count)
    exact, expected = 16.0, [0, 2, 4, 6, 8, 10, 12, 14, 16]
    while expected[-1] < count:
        exact *= 1.125
        expected.append(int(np.ceil(exact)))
    np.testing.assert_array_equal(found, [*[r for r in expected if r < count], count])


def plain_fraction(feet, deviations, weights, most):
    """The sum over groups of neighbours of all points, until a correlation is within three standard errors of zero."""
    order = np.argsort(np.linalg.norm(feet[:, None] - feet, axis=2), axis=1)
    variance = sum(w * d * d for w, d in zip(weights, deviations)) / weights.sum()
    total, ranks = 0.0, clouds._groups_of_ranks(min(most, len(feet) - 1))
    for begin, end in pairwise(ranks):
        pairs = products = 0.0
        for i, rank in ((i, rank) for i in range(len(feet)) for rank in range(begin, end)):
            j = order[i, rank + 1]
            pairs += weights[i] * weights[j]
            products += weights[i] * weights[j] * deviations[i] * deviations[j]
        if products / (pairs * variance) < 3 / np.sqrt(pairs):
            break
        total += (end - begin) * products / (pairs * variance)
    return 1 / (1 + total)


@pytest.mark.parametrize("smooth", [0.7, 1.5])
def test_the_effective_fraction_is_the_sum_over_neighbours_that_are_alike(smooth):
    rng = np.random.default_rng(6)
    feet, distances = bumpy(90, 2)
    noise = np.exp(-((distances / smooth) ** 2)) @ rng.normal(size=90) + 0.3 * rng.normal(size=90)
    weights = rng.uniform(0.2, 1, 90)
    expected = plain_fraction(feet, noise, weights, 64)
    assert 0.01 < expected < 0.7
    np.testing.assert_allclose(clouds.effective_fraction_of_points(feet, noise, weights), expected, rtol=1e-9)


def test_where_errors_are_alike_beyond_the_neighbours_more_of_them_are_asked_for(monkeypatch):
    """Of one stroke on each half, all points err together: the sum reaches farther with each pair of numbers."""
    monkeypatch.setattr(clouds, "NEAR", clouds.Neighbours(correlation=((60, 8), (60, 16), (60, 24))))
    feet = np.concatenate([even_directions(30), even_directions(30) + np.array([50, 0, 0])])
    noise = np.repeat([1.0, -1.0], 30)
    assert clouds.effective_fraction_of_points(feet, noise, np.ones(60)) == pytest.approx(1 / 25, rel=1e-9)


def test_values_are_equal_within_a_billionth_of_their_size():
    for size, scale in ((1.0, 1.0), (0.1, 1.0), (-30.0, 30.0), (0.0, 1.0), (1e300, 1e300)):
        for factor, expected in ((0.96, [0, 1]), (1.04, [1, 0])):
            assert clouds.best_first(np.array([size, size + factor * 1e-9 * scale])).tolist() == expected
    for least, expected in ((1 + 0.9e-9, 0), (1 + 1.1e-9, 1)):
        assert clouds.first_least(np.array([least, 1.0])) == expected


def test_directions_turn_with_the_cloud():
    points, _ = bumpy()
    one, other = Neighbourhood.of(points), Neighbourhood.of(points @ turned(4).T)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", other.normals, one.normals @ turned(4).T)), 1, rtol=1e-9)
