"""The rules of the search for a superquadric: what is compared, accepted and kept, and on how many points."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import SKEW, even_directions, made, turned

from quadriform.fitting.mixture import Mixture, density_log_odds
from quadriform.fitting.superquadric import initial, multistart
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.initial import START_ROTATIONS, ellipsoids, principal_axes, starts_not_radial
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.multistart import ENOUGH_PAIRS
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.search_settings import SEARCH

SPHERE = even_directions(300)


def problem(points=SPHERE, kind="ellipsoid", **more):
    n = len(points)
    return SearchProblem(points, np.ones(n), kind, more.pop("fixed", {}), np.zeros(n), np.ones(n), **more)


def state(distances, inliers=1.0, sigma=0.1, ratio=0.9, weights=1.0, points=SPHERE, scores=None):
    """What is known of M candidates at the end of a descent."""
    distances = np.atleast_2d(distances)
    m, n = distances.shape
    return SimpleNamespace(
        distances=distances,
        inliers=np.broadcast_to(inliers, (m, n)).astype(float),
        weights=np.broadcast_to(weights, n).astype(float),
        mixture=Mixture(np.broadcast_to(ratio, m).astype(float), np.broadcast_to(sigma, m).astype(float)),
        points=points[:n],
        scores=lambda: np.array(scores, dtype=float),
    )


def test_surfaces_nearer_than_half_a_sigma_at_their_inliers_are_one():
    n = 100
    level = np.array([0.0, 0.049, 0.051, 0.2, 0.26])[:, None]
    of = state(np.tile(level, n), sigma=[0.1, 0.1, 0.1, 0.1, 0.1])
    assert multistart.distinct(of, np.array([5.0, 4, 3, 2, 1]), 9).tolist() == [0, 2, 3, 4]
    assert multistart.distinct(of, np.array([1.0, 2, 3, 4, 5]), 9).tolist() == [4, 3, 2, 0]
    assert multistart.distinct(of, np.array([5.0, 4, 3, 2, 1]), 2).tolist() == [0, 2]
    # at its own inliers and by its own sigma
    distances = np.zeros((2, n))
    distances[1, :10] = 1.0
    away = state(distances, np.stack([np.ones(n), np.arange(n) >= 10]))
    assert multistart.distinct(away, np.array([2.0, 1.0]), 9).tolist() == [0]
    assert multistart.distinct(away, np.array([1.0, 2.0]), 9).tolist() == [1, 0]
    half = state(np.tile([[0.0], [0.15]], n), sigma=[0.4, 0.2])
    assert multistart.distinct(half, np.array([2.0, 1.0]), 9).tolist() == [0, 1]
    assert multistart.distinct(half, np.array([1.0, 2.0]), 9).tolist() == [1]


def plain_white(points, distances, inliers, weights):
    """Sums over pairs of each point and its nearest others: of pairs, squared differences and both squares."""
    pairs = difference = both = 0.0
    for i, point in enumerate(points):
        gaps = np.linalg.norm(points - point, axis=1)
        gaps[i] = np.inf
        near = np.flatnonzero(gaps <= gaps.min() * (1 + 1e-6))
        for j in near:
            pair = inliers[i] * inliers[j] * weights[i] / len(near)
            pairs += pair
            difference += pair * (distances[i] - distances[j]) ** 2
            both += pair * (distances[i] ** 2 + distances[j] ** 2)
    return pairs, difference, both


@pytest.mark.parametrize("common", [0.0, 0.3, 0.7, 1.0])
def test_distances_that_neighbours_have_in_common_are_a_pattern(common, rng):
    lattice = np.stack(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for points in (SPHERE, lattice):
        n = len(points)
        smooth = np.sin(2 * points / np.ptp(points)).sum(axis=1) if common else np.zeros(n)
        smooth = smooth / max(smooth.std(), 1e-9)
        distances = np.sqrt(common) * smooth + np.sqrt(1 - common) * rng.normal(size=n)
        inliers, weights = rng.uniform(0.7, 1, n), rng.uniform(0.5, 1.5, n)
        pairs, difference, both = plain_white(points, distances, inliers, weights)
        white = difference > 0.5 * both
        of = state(distances, inliers, weights=weights, points=points)
        assert multistart.acceptable(of).tolist() == [pairs > 64 and white]
        assert common not in (0, 1) or white == (common == 0)


def test_pairs_of_a_lattice_count_once_for_each_point(rng):
    """Of points with three to six nearest others; by chance some distances are a pattern and some are none."""
    lattice = np.stack(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    expected, found = [], []
    inner = (np.abs(lattice - 2).max(axis=1) < 2).astype(float)
    for _ in range(30):
        distances = np.sqrt(0.5) * np.sin(lattice).sum(axis=1) * (1 + inner) + rng.normal(size=125) * rng.uniform(
            0.5, 1.5
        )
        pairs, difference, both = plain_white(lattice, distances, np.ones(125), np.ones(125))
        expected.append(pairs > 64 and difference > 0.5 * both)
        found.append(bool(multistart.acceptable(state(distances, points=lattice))[0]))
    assert found == expected and 3 < sum(expected) < 27


def test_a_candidate_is_accepted_with_half_of_the_points_and_enough_pairs(rng):
    distances = rng.normal(size=(2, 300))
    assert ENOUGH_PAIRS == 64
    assert multistart.acceptable(state(distances, ratio=[0.5, 0.49])).tolist() == [True, False]
    pairs = plain_white(SPHERE, distances[0], np.ones(300), np.ones(300))[0]
    for count, enough in ((64.5, True), (63.5, False)):
        of = state(distances[:1], np.sqrt(count / pairs))
        assert multistart.acceptable(of).tolist() == [enough]
    # noise that is rounding may be correlated
    same = state(np.ones((2, 300)), sigma=[0.9e-6, 1.1e-6])
    assert multistart.acceptable(same).tolist() == [True, False]


def test_accepted_candidates_are_a_tenth_for_each_point_better():
    of = state(np.zeros((2, 4)), weights=[1.0, 2, 3, 4], scores=[7.0, 8.0])
    np.testing.assert_allclose(multistart._ranking(of, np.array([True, False])), [8.0, 8.0])


def test_surfaces_within_a_hundredth_of_the_cost_are_alternatives():
    """The log likelihood of n inliers falls by n / 2 times the growth of the cost: by one of 200."""
    of = state(np.arange(4.0)[:, None] * np.ones(200))
    ranking = np.array([10.0, 9.01, 8.99, 11.0 - 1e-9 - 1.0])
    assert multistart._alternatives(of, ranking).tolist() == [0, 3, 1]
    fewer = state(np.arange(4.0)[:, None] * np.ones(200), 0.5)
    assert multistart._alternatives(fewer, ranking).tolist() == [0, 3]


def test_the_best_candidate_has_the_highest_score_of_equal_ones_the_first():
    taken = []
    of = SimpleNamespace(scores=lambda: np.array([1.0, 3.0, 3.0 + 1e-12]), picked=lambda index: taken.append(index))
    multistart._best_by_score(of)
    assert [each.tolist() for each in taken] == [[1]]


def test_em_counts_free_parameters_and_keeps_sigma_within_its_bounds(rng):
    known = problem(least_sigma=0.3, fixed={"semi_axes": np.ones(3)})
    of = Descent(known, Candidates.of([made(exponents=(1, 1))]), Mixture(np.array([0.9]), np.array([1.0])))
    of.distances = 0.001 * rng.normal(size=(1, 300))
    assert multistart.em(of).sigma.tolist() == [0.3]
    of.problem, of.inliers = replace(known, least_sigma=0.0), np.ones((1, 300))
    expected = np.sqrt((of.distances[0] ** 2).sum() / (300 - 8))
    np.testing.assert_allclose(multistart.em(of).sigma, [expected], rtol=1e-12)
    of.problem = replace(of.problem, largest_sigma=1e-4)
    assert multistart.em(of).sigma.tolist() == [1e-4]


class Recorded:
    """A descent that notes on how many points and candidates it runs, how many steps, and its tolerance."""

    def __init__(self, log, points, candidates, mixture):
        self.log, self.points, self.candidates, self.mixture = log, points, candidates, mixture
        self.fixed_mask = np.zeros(11, dtype=bool)

    def run(self, steps, reestimate, tolerance=0.0):
        self.log.append((len(self.points), len(self.candidates), steps, tolerance))
        return True

    def converge(self, steps, reestimate, tolerance):
        self.log.append((len(self.points), "converge", steps, tolerance))
        return len(self.points) % 2 == 0

    def scores(self):
        return np.arange(float(len(self.candidates)))

    def picked(self, index):
        return self.candidates.take(index), self.mixture.take(index)


@pytest.mark.parametrize(
    ("n", "samples"), [(300, []), (15_999, []), (16_000, []), (16_001, [8000]), (300_001, [8000, 128_000])]
)
def test_most_steps_are_made_on_growing_samples(monkeypatch, n, samples):
    log = []
    monkeypatch.setattr(multistart, "Descent", lambda of, c, m: Recorded(log, of.points, c, m))
    monkeypatch.setattr(SearchProblem, "thinned", lambda self, most: np.arange(min(most, len(self.points))))
    two = Candidates.of([made(exponents=(1, 1)), made()])
    mixture = Mixture(np.array([0.9, 0.8]), np.array([0.1, 0.2]))
    found = multistart._final_descent(problem(np.zeros((n, 3))), (two, mixture), 5)
    count = 1 if samples else 2
    expected = [(size, 2 if size == 8000 else 1, 15, 1e-6) for size in samples]
    expected += [(n, count, 40, 1e-2), (n, "converge", 40, 1e-10)]
    expected += [] if n % 2 == 0 else [(n, 1, 40, 1e-6)]
    assert log == expected
    assert found.n_alternatives == 5 and found.converged
    assert found.descent.mixture.sigma.tolist() == [0.2]


def test_isolated_outliers_of_a_best_candidate_lose_odds(rng):
    """By their distances to near neighbours among a sample of all, at the inlier probabilities of the candidate."""
    points = np.concatenate([even_directions(1900), 3 * rng.normal(size=(100, 3))])
    best = Candidates.of([made(exponents=(1, 1), semi_axes=(1, 1, 1))])
    best = replace(best, translations=np.zeros((1, 3)))
    of, mixture = problem(points), Mixture(np.array([0.9]), np.array([0.02]))
    found = multistart._with_density_log_odds(of, (best, mixture))
    distances = initial.neighbour_distance(points, of.sample(1500).points)
    expected = density_log_odds(distances, Descent(of, best, mixture).inliers[0])
    np.testing.assert_array_equal(found.log_odds, expected)
    assert expected[:1900].mean() > -0.1 and expected[1900:].mean() < -1


def test_starts_of_parts_are_annealed_on_a_sample(monkeypatch):
    """First on their own part, then on all with a sigma of half their size at most, annealed, at last estimated."""
    log, given = [], []

    def recorded(of, candidates, mixture, weights=None):
        given.append((candidates, of.weights if weights is None else weights, mixture, of.size))
        return Recorded(log, of.points, candidates, replace(mixture, sigma=3 * mixture.sigma))

    monkeypatch.setattr(multistart, "Descent", recorded)
    cloud = replace(problem(SPHERE * [1, 2, 3]), weights=np.random.default_rng(5).uniform(0.5, 2, 300))
    parts = np.stack([np.ones(300), (np.arange(300) < 100).astype(float)])
    rotations = multistart.orientations(cloud, parts, START_ROTATIONS[:2])
    multistart.annealed_starts(cloud, parts, rotations, 160)
    assert log == [(160, 4, 4, 0), (160, 4, 8, 0), (160, 4, 6, 1e-4)]
    (starts, weights, mixture, size), (_, all_weights, wide, _) = given
    expected = ellipsoids(cloud.points, parts * cloud.weights, rotations)
    np.testing.assert_allclose(starts.log_axes, expected.log_axes)
    sizes = [np.sqrt((axes**2).mean()) for axes in np.exp(starts.log_axes)]
    np.testing.assert_allclose(mixture.sigma, 0.5 * np.array(sizes))
    np.testing.assert_allclose(wide.sigma, 0.5 * np.array(sizes))
    assert (mixture.inlier_ratio == 0.999).all() and size == 0
    index = cloud.thinned(160)
    np.testing.assert_array_equal(weights, np.maximum(parts[[0, 0, 1, 1]][:, index], 1e-6) * cloud.weights[index])
    np.testing.assert_array_equal(all_weights, cloud.weights[index])


def test_orientations_are_the_principal_axes_of_each_part_or_the_fixed_rotation():
    cloud = replace(problem(SPHERE * [1, 2, 3] @ SKEW.T), weights=np.random.default_rng(5).uniform(0.5, 2, 300))
    parts = np.stack([np.ones(300), np.arange(300.0)])
    found = multistart.orientations(cloud, parts, START_ROTATIONS)
    axes = principal_axes(cloud.points, parts * cloud.weights)
    np.testing.assert_allclose(found, [[part @ frame for frame in START_ROTATIONS] for part in axes], atol=1e-12)
    fixed = problem(fixed={"rotation": turned(1)})
    np.testing.assert_array_equal(
        multistart.orientations(fixed, parts, START_ROTATIONS), np.tile(turned(1), (2, 1, 1, 1))
    )


def test_other_kinds_start_from_the_first_part():
    torus = made("toroid", (1, 1))
    points = torus.grid(6)[0]
    cloud = problem(points, "toroid")
    part = (np.arange(len(points)) % 2).astype(float)
    found, owner = multistart._starts(cloud, np.stack([part, np.ones(len(points))]), START_ROTATIONS[None])
    expected = starts_not_radial(points[part > 0], "toroid")
    np.testing.assert_array_equal(found.log_axes, expected.log_axes)
    np.testing.assert_array_equal(owner, np.zeros(len(expected)))


def test_odds_by_density_and_what_is_of_another_body(monkeypatch):
    """Inliers that are not connected to the others have no odds, in each round, until none are left."""
    ball, beside = SPHERE, np.array([[2.5, 0, 0], [2.6, 0, 0], [2.5, 0.1, 0]])
    cloud = problem(np.concatenate([ball, beside]))
    rounds = [np.array([300]), np.array([301, 302]), np.array([], dtype=np.int64), np.array([5])]
    monkeypatch.setattr(multistart, "_unconnected_inliers", lambda *of: rounds.pop(0))
    monkeypatch.setattr(multistart, "restarted", lambda cloud, best: best + 1)
    found, best = multistart._restarted_with_connected(cloud, 0)
    assert best == 3 and len(rounds) == 1
    np.testing.assert_array_equal(found.log_odds, np.append(np.zeros(300), [-100.0] * 3))
    np.testing.assert_array_equal(cloud.log_odds, 0)


@pytest.mark.parametrize("covered", [True, False])
def test_only_a_surface_that_is_not_covered_may_have_inliers_of_a_neighbour(covered):
    ball = SPHERE if covered else SPHERE[SPHERE[:, 2] > 0.3]
    far = np.array([[0.0, 0, -1]])
    cloud = problem(np.concatenate([ball, far]))
    sphere = Candidates.of([made(exponents=(1, 1), semi_axes=(1.0, 1.0, 1.0))])
    sphere = replace(sphere, translations=np.zeros((1, 3)))
    best = Descent(cloud, sphere, Mixture(np.array([0.9]), np.array([0.01])))
    others = multistart._unconnected_inliers(cloud, best)
    assert others.tolist() == ([] if covered else [len(ball)])


def test_exact_points_of_part_of_a_body_lead_through_all_of_them():
    body = made(exponents=(0.7, 1.2), semi_axes=(1.2, 0.9, 0.7))
    points = body.surface(even_directions(600)) - body.translation
    found = multistart.through_all_points(problem(points))
    assert found is not None and found[1].sigma[0] < 1e-6
    noisy = points + 0.1 * np.random.default_rng(1).normal(size=points.shape)
    assert multistart.through_all_points(problem(noisy)) is None
    assert multistart.through_all_points(problem(points, "toroid")) is None


def test_descents_from_near_starts_find_the_surface():
    body = made(exponents=(0.7, 1.2), semi_axes=(1.2, 0.9, 0.7))
    points = body.surface(even_directions(600))
    starts = [made(exponents=(1, 1), semi_axes=a) for a in ((0.2, 3.0, 0.4), (1.0, 1.0, 0.8))]
    found = multistart.best_of_descents(problem(points), starts)
    np.testing.assert_allclose(found.semi_axes, body.semi_axes, rtol=1e-2)
    assert SEARCH.damped_tolerance == 1e-2


def test_restarts_are_improved_on_a_sample_before_they_are_compared():
    body = made(exponents=(1, 1), semi_axes=(1.2, 0.9, 0.7))
    points = body.surface(even_directions(600)) - body.translation
    one = Candidates.of([replace(body, translation=np.zeros(3))])
    best = Mixture(np.array([0.9]), np.array([0.05]))
    found, mixture = multistart._from_boxes(problem(points), np.ones(600), one, best)
    assert mixture.sigma.min() < 0.05
    np.testing.assert_allclose(np.sort(np.exp(found.log_axes[mixture.sigma.argmin()])), [0.7, 0.9, 1.2], rtol=0.05)
