"""Parts of a round of refinement against plain sums: data, correspondences, steps, priors and penalties, samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions, made, turned

from quadriform.fitting.cloud import effective_fraction_of_points
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.noise import KnownNoise, mean_variance, partial_notes, variances_along
from quadriform.fitting.refinement import base_prior, large_clouds, left_out, point_to_plane, unfolding
from quadriform.fitting.refinement.correspondence import Correspondence
from quadriform.fitting.refinement.surface_data import OrientedCloud, SurfaceData, inlier_probabilities
from quadriform.shapes.closest import surface_normals, surface_points
from quadriform.shapes.control_box import ControlBox

SURFACE = made(exponents=(0.8, 1.1), semi_axes=(1.2, 0.9, 0.8))
SURFACE = replace(SURFACE, translation=np.zeros(3))
POINTS = SURFACE.surface(even_directions(60)) * np.random.default_rng(2).uniform(0.95, 1.05, (60, 1))
PLANE = (np.array([0.1, 0.0, 0.4]), np.array([0.0, 0.6, 0.8]))


def box(size=0.05, shape=(3, 3, 3)):
    rest = ControlBox.around(SURFACE, shape)
    moves = np.random.default_rng(4).normal(0, size, rest.control_points.shape)
    return rest.with_control_points(rest.control_points + moves)


def noisy():
    root = 0.3 * np.random.default_rng(5).normal(size=(60, 3, 3))
    return root @ np.swapaxes(root, 1, 2)


def data(noise=None, half_space=None, weights=None):
    weights = np.random.default_rng(6).uniform(0.5, 2, 60) if weights is None else weights
    found = SurfaceData.of(SURFACE, POINTS, weights, half_space, covariances=noise)
    return replace(found, inliers=np.random.default_rng(7).uniform(0, 1, 60)).with_nearest_foot_points(box())


@pytest.mark.parametrize("noise", [None, noisy()], ids=["alike", "known"])
def test_distances_are_divided_by_the_deviation_along_the_normal(noise):
    of, here = data(noise), box()
    feet, normals = here.deform(of.origins), surface_normals(SURFACE, here, of.origins)
    expected = []
    for i in range(60):
        variance = 1.0 if noise is None else normals[i] @ noise[i] @ normals[i] + 0.01 * np.trace(noise[i])
        expected.append(np.linalg.norm(POINTS[i] - feet[i]) / np.sqrt(variance))
    np.testing.assert_allclose(of.standardised_distances(here), expected, rtol=1e-9)
    np.testing.assert_allclose(of.distances(here), np.linalg.norm(POINTS - feet, axis=1))


def test_the_inlier_ratio_is_found_by_rounds_at_a_given_noise():
    of, distances = data(), np.append(np.full(45, 0.01), np.full(15, 0.9))
    for noise, sigma in ((0.02, 0.02), (0.001, 5e-3)):
        ratio = 0.9
        for _ in range(20):
            probabilities = Mixture(np.array([ratio]), np.array([sigma])).densities(distances[None])[0][0]
            ratio = np.clip(of.weights @ probabilities / of.weights.sum(), 0.02, 1 - 1e-6)
        found = of.with_inliers_at_distances(distances, noise)
        assert found.inlier_ratio == pytest.approx(ratio, rel=1e-12)
        np.testing.assert_allclose(found.inliers, probabilities, rtol=1e-12)


def test_points_in_the_half_space_are_beyond_its_plane():
    of = data(half_space=PLANE)
    on = PLANE[0] + np.array([[0, 0, 0], [0, 0.001, 0.001], [0, -0.001, -0.001]])
    assert of.in_half_space(on).tolist() == [False, True, False]
    assert data().in_half_space(on).tolist() == [False] * 3


def test_given_normals_are_sure_and_missing_ones_are_those_of_the_neighbours():
    of = data()
    normals = SURFACE.gradient(POINTS)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[::3] = 0
    found = replace(of, normals=normals).oriented()
    given = np.arange(60) % 3 > 0
    np.testing.assert_array_equal(found.normals[given], normals[given])
    np.testing.assert_array_equal(found.flatness, np.where(given, 1.0, of.neighbourhood.flatness))
    cosines = np.abs(np.einsum("ij,ij->i", found.normals, of.neighbourhood.normals))
    np.testing.assert_allclose(cosines[~given], 1, rtol=1e-12)


def test_data_beside_others_has_their_neighbourhoods_and_feet():
    of, near = data(noisy()), np.array([3, 3, 10])
    found = of.beside(POINTS[near] + 0.01, np.array([1.0, 2, 3]), near)
    np.testing.assert_array_equal(found.origins, of.origins[near])
    np.testing.assert_array_equal(found.neighbourhood.flatness, of.neighbourhood.flatness[near])
    assert found.inliers.tolist() == [1, 1, 1] and found.covariances is None and found.total_weight == 6


def test_costs_of_pairs_are_by_distance_and_by_the_angle_of_their_normals():
    cloud = OrientedCloud(POINTS[:9], turned(1)[[0, 1, 2] * 3], np.linspace(0, 1, 9))
    of, here = Correspondence.between(SURFACE, cloud), box()
    model, normals = surface_points(SURFACE, here, of.origins)
    costs = of.costs(here)
    for i in range(9):
        for j in (0, 17, 100):
            distance = ((cloud.points[i] - model[j]) ** 2).sum()
            angle = 0.4**2 * cloud.flatness[i] * (1 - cloud.normals[i] @ normals[j])
            assert costs[i, j] == pytest.approx(distance + angle, rel=1e-9, abs=1e-12)
    np.testing.assert_array_equal(of.matched(costs), of.origins[costs.argmin(axis=1)])
    matched = of.origins[[5, 5, 7]] + 1e-6
    origins, targets = of.unmatched(costs, matched)
    left = [j for j in range(len(of.origins)) if j not in (5, 7)]
    np.testing.assert_array_equal(origins, of.origins[left])
    np.testing.assert_array_equal(targets, cloud.points[costs[:, left].argmin(axis=0)])


def test_model_points_in_the_half_space_are_not_attracted():
    cloud = OrientedCloud(POINTS, SURFACE.gradient(POINTS), np.zeros(60))
    of, here = Correspondence.between(SURFACE, cloud), box()
    costs, some = of.costs(here), data(half_space=PLANE)
    found = of.attraction(costs, here, some)
    origins, targets = of.unmatched(costs, some.origins)
    below = (here.deform(origins) - PLANE[0]) @ PLANE[1] <= 0
    np.testing.assert_array_equal(found.origins, origins[below])
    np.testing.assert_array_equal(found.targets, targets[below])
    assert found.weight == pytest.approx(some.weights.sum() / len(of.origins)) and 0 < below.sum() < len(below)
    nowhere = data(half_space=(np.array([0, 0, -9.0]), PLANE[1]))
    assert of.attraction(costs, here, nowhere) is None
    all_matched = replace(some, origins=of.origins)
    assert of.attraction(costs, here, all_matched) is None


@pytest.mark.parametrize("noise", [None, noisy()], ids=["alike", "known"])
def test_rows_weigh_the_normal_part_and_a_little_of_the_rest(noise):
    of, here = data(noise), box()
    rows, normals = point_to_plane.data_rows(of, here), surface_normals(SURFACE, here, of.origins)
    for i in range(0, 60, 7):
        variance = 1.0 if noise is None else normals[i] @ noise[i] @ normals[i] + 0.01 * np.trace(noise[i])
        square = np.outer(normals[i], normals[i])
        metric = of.weights[i] * of.inliers[i] / variance * (square + 2e-3 * (np.eye(3) - square))
        np.testing.assert_allclose(rows.metric[i], metric, rtol=1e-9, atol=1e-12)


def test_the_linear_problem_is_the_sum_over_data_and_attracted_points(rng):
    """Its squares at any displacement are the weighted squares of what is left between each point and its target."""
    here, sets, shift = box(), [data(), data(noisy())], rng.normal(0, 0.1, (27, 3))
    attraction = point_to_plane.Attraction(SURFACE.grid(2)[0], SURFACE.grid(2)[0] + [0.2, -0.1, 0.3], 3.0)
    problem = point_to_plane.linear_problem_of(sets, [None, attraction], here, "springs", 0.7, 0.01)
    moved = here.with_control_points(here.rest + shift.reshape(here.rest.shape))
    normals = surface_normals(SURFACE, here, attraction.origins)
    left = attraction.targets - moved.deform(attraction.origins)
    expected = 3 * (0.002 * (left**2).sum() + 0.998 * (np.einsum("ij,ij->i", left, normals) ** 2).sum())
    for rows in (point_to_plane.data_rows(of, here) for of in sets):
        left = rows.targets - moved.deform(rows.origins)
        expected += np.einsum("ni,nij,nj->", left, rows.metric, left)
    assert problem.equations.squares(shift) == pytest.approx(expected, rel=1e-9)
    assert problem.total_weight == pytest.approx(sets[0].total_weight + sets[1].total_weight)
    assert (problem.effective_fraction, problem.least_sigma) == (0.7, 0.01)


def test_the_fraction_of_several_surfaces_is_a_mean_over_their_points():
    here, one = box(), data(noisy())
    other = replace(one, inliers=one.inliers**2, covariances=None)
    none = replace(one, inliers=np.zeros(60))
    fractions = []
    for of in (one, other):
        normals = surface_normals(SURFACE, here, of.origins)
        along = np.einsum("ij,ij->i", of.points - here.deform(of.origins), normals) / np.sqrt(of.variances(normals))
        fractions.append(effective_fraction_of_points(here.deform(of.origins), along, of.weights * of.inliers))
    expected = np.average(fractions, weights=[one.total_weight, other.total_weight])
    assert point_to_plane.effective_fraction_of_data([one, none, other], here) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("best", "length"), [(1.0, 1.0), (0.6, 1.0), (0.5, 1.0), (0.45, 0.5), (0.01, 1 / 64)])
def test_a_step_is_halved_until_the_sum_is_not_above_that_at_its_start(best, length):
    assert point_to_plane.step_length(lambda x: (x - best) ** 2) == length


def test_a_step_that_lowers_nothing_ends_below_a_thousandth():
    assert point_to_plane.step_length(lambda x: x) == 2**-10


def test_changes_of_a_round_are_root_mean_squares():
    before, after = box(0.02), box(0.05)
    probes = point_to_plane.probes([SURFACE])
    found = point_to_plane.record(before, after, probes, 0.3)
    step = after.control_points - before.control_points
    motion = after.deform(probes) - before.deform(probes)
    values = [
        np.sqrt((v.reshape(-1, 3) ** 2).sum(axis=1).mean()) for v in (step, after.control_points - after.rest, motion)
    ]
    assert list(vars(found).values())[:4] == pytest.approx([0.3, *values])


def test_heights_above_the_dome_cost_their_mean_square_over_the_area():
    here, prior = box(), base_prior.BasePrior(SURFACE, PLANE, 7.0)
    mesh = SURFACE.mesh(12)
    moved, share = here.deform(mesh.vertices), np.zeros(len(mesh.vertices))
    for face in mesh.faces:
        a, b, c = moved[face]
        share[face] += np.linalg.norm(np.cross(b - a, c - a)) / 6
    heights = (moved - PLANE[0]) @ PLANE[1] - 0.2
    expected = 7 * (share / share.sum()) @ np.maximum(heights, 0) ** 2
    assert prior.cost(here) == pytest.approx(expected, rel=1e-9)
    step = 0.01 * np.random.default_rng(1).normal(size=here.rest.size)
    equations = prior.equations(here)
    at = (here.control_points - here.rest).ravel()
    assert equations.squares(at) == pytest.approx(expected, rel=1e-9)
    above = heights > 0
    lifted = heights + (here.matrix(mesh.vertices) @ step.reshape(-1, 3)) @ PLANE[1]
    assert equations.squares(at + step) == pytest.approx(7 * (share / share.sum()) @ (above * lifted**2), rel=1e-9)


def test_the_prior_of_a_base_weighs_as_the_noise_over_its_spread():
    here, of = box(), data(half_space=PLANE)
    weights = of.weights * of.inliers
    noise = np.sqrt(weights @ of.standardised_distances(here) ** 2 / weights.sum())
    (found,) = base_prior.base_prior(of, here, 50.0)
    assert found.weight == pytest.approx(50 * (noise / 0.1) ** 2)
    far = replace(of, points=of.points * 2)
    assert base_prior.base_prior(far, here, 50.0)[0].weight == 50
    assert base_prior.base_prior(data(), here, 50.0) == []
    assert base_prior.base_prior(replace(of, inliers=np.zeros(60)), here, 50.0) == []
    both = base_prior.base_priors([of, data(), of], here)
    assert [each.weight for each in both] == pytest.approx([of.total_weight * (noise / 0.1) ** 2] * 2)


def test_the_penalty_on_small_determinants_is_their_sum_of_squares_below_a_tenth():
    here = box(0.6)
    surfaces = {"a": SURFACE}
    penalty = unfolding.JacobianPenalty.of(here, surfaces, 300.0, 0.05)
    assert penalty.weight == pytest.approx(1e-3 * 300 * (0.05 / 0.1) ** 2)
    grid = SURFACE.grid(12)[0]
    np.testing.assert_array_equal(penalty.points[-len(grid) :], grid)
    determinants = np.linalg.det(here.jacobian(penalty.points))
    assert penalty.minimum(here) == pytest.approx(determinants.min()) and determinants.min() < 0.1
    expected = penalty.weight * sum((0.1 - d) ** 2 for d in determinants if d < 0.1)
    assert penalty.cost(here) == pytest.approx(expected)
    at = (here.control_points - here.rest).ravel()
    equations, step = penalty.equations(here), 1e-6 * np.random.default_rng(1).normal(size=at.size)
    assert equations.squares(at) == pytest.approx(expected)
    moved = here.with_control_points(here.control_points + step.reshape(here.control_points.shape))
    slope = equations.squares(at + step) - equations.squares(at)
    assert slope == pytest.approx(penalty.cost(moved) - penalty.cost(here), rel=1e-2)
    assert penalty.stronger().weight == pytest.approx(2 * penalty.weight)
    plain = unfolding.JacobianPenalty.of(box(0), surfaces, 300.0, 0.05)
    assert plain.equations(box(0)).constant == 0 and plain.cost(box(0)) == 0


def state(sigma, folds=False):
    return SimpleNamespace(box=folds, solution=SimpleNamespace(sigma=sigma))


def test_folds_are_removed_in_rounds_under_a_growing_penalty():
    """With a penalty that verifies the third state, or none."""

    class Growing:
        def __init__(self, weight=1):
            self.weight = weight

        def check(self, box, surfaces):
            return box == "verified", self

        def stronger(self):
            return Growing(2 * self.weight)

    made_states = [state(1.0), state(1.0), state(1.0, "verified")]
    log = []

    def penalised(found, penalty, strength):
        log.append((penalty.weight, strength))
        return made_states[len(log)] if len(log) < 3 else None

    found = unfolding.remove_folds(penalised, made_states[0], Growing(), 0.3, {}, 1.0)
    assert found is made_states[2] and log == [(1, 0.3), (2, 0.3)]
    assert unfolding.remove_folds(penalised, state(1.1), Growing(), 0.3, {}, 1.0) is None
    log.clear()
    made_states[2] = state(1.0)
    assert unfolding.remove_folds(penalised, made_states[0], Growing(), 0.3, {}, 1.0) is None and len(log) == 3
    log.clear()
    always = unfolding.remove_folds(lambda s, p, a: log.append(p.weight) or s, state(1.0), Growing(), 0.3, {}, 1.0)
    assert always is None and log == [2**k for k in range(30)]


def test_more_points_of_the_penalty_are_those_of_low_determinants_and_around_the_lowest(monkeypatch):
    here, where = box(0.6), np.array([0.1, 0.2, 0.3])
    monkeypatch.setattr(unfolding, "jacobian_bound", lambda *of: SimpleNamespace(where=where))
    monkeypatch.setattr(unfolding, "FOLDS", replace(unfolding.FOLDS, fine_lattice=9, fine_grid=4, verifiable=0.5))
    found = unfolding._low_points(here, {"a": SURFACE}, 1.1)
    steps = [-1, -0.5, 0, 0.5, 1]
    cluster = {
        tuple(np.round(where + np.array([i, j, k]) / 9 @ here.edges, 9)) for i in steps for j in steps for k in steps
    }
    assert {tuple(np.round(p, 9)) for p in found[:125]} == cluster
    fine = np.concatenate([unfolding.grid_inside(here, [SURFACE], 9), SURFACE.grid(4)[0]])
    np.testing.assert_array_equal(found[125:], fine[np.linalg.det(here.jacobian(fine)) < 0.55])
    assert 0 < len(found) - 125 < len(fine)


def test_the_misfit_is_the_weighted_sum_of_squared_distances_to_foot_points():
    one, here = data(), box()
    other = replace(one, points=1.1 * one.points, weights=2 * one.weights)
    expected = sum(
        w * ((p - q) ** 2).sum()
        for of in (one, other)
        for w, p, q in zip(of.weights, of.points, here.deform(of.origins))
    )
    assert unfolding._misfit(SimpleNamespace(datasets=(one, other), box=here)) == pytest.approx(expected)


def test_the_accepted_noise_is_half_as_much_again_or_a_fortieth():
    assert unfolding.accepted_sigma(0.1) == pytest.approx(0.15)
    assert unfolding.accepted_sigma(0.001) == 0.025


@pytest.mark.parametrize("count", [2, 5])
def test_patches_are_those_of_the_nearest_of_centres_far_from_each_other(count):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(40, 3)) * [1, 2, 3]
    far, centres = np.linalg.norm(points - points.mean(axis=0), axis=1), []
    for _ in range(count):
        centres.append(points[far.argmax()])
        reached = np.linalg.norm(points - centres[-1], axis=1)
        far = reached if len(centres) == 1 else np.minimum(far, reached)
    expected = [np.argmin([np.linalg.norm(p - c) for c in centres]) for p in points]
    np.testing.assert_array_equal(left_out._patch_of(points, count), expected)


def test_a_smaller_strength_is_sought_while_errors_fall(monkeypatch):
    errors = {1e-2: 10.0, 1e-3: 8.0, 1e-4: 5.0, 1e-5: 5.0, 1e-6: 1.0}
    monkeypatch.setattr(left_out, "_patches", lambda problem, state: None)
    monkeypatch.setattr(
        left_out, "_squares", lambda patches, a: errors[min(errors, key=lambda k: abs(np.log(k / a)))] * np.ones(9)
    )
    of = SimpleNamespace(solution=SimpleNamespace(strength=1e-2))
    assert left_out.better_strength(None, of) == pytest.approx(1e-4)
    errors[1e-3] = 10.0
    assert left_out.better_strength(None, of) is None


def test_samples_of_a_large_cloud_are_its_lowest_hashes(monkeypatch, rng):
    monkeypatch.setattr(large_clouds, "LARGE", replace(large_clouds.LARGE, many=1000, sample=300, part=700))
    cloud, weights = rng.normal(size=(1500, 3)), (np.arange(1500) % 3 > 0).astype(float)
    hashes = [int(large_clouds._hashes(row[None])[0]) for row in cloud]
    limit = int(0.3 * (2**64 - 2**11))
    expected = [i for i in range(1500) if weights[i] > 0 and hashes[i] <= limit]
    np.testing.assert_array_equal(large_clouds.sampled(cloud, weights), expected)
    assert 240 < len(expected) < 360
    np.testing.assert_array_equal(large_clouds.sampled(cloud[:1000], weights[:1000]), np.arange(1000))
    assert large_clouds.sample_of_large({"a": cloud[:1000]}, {"a": weights}) is None
    both = large_clouds.sample_of_large({"a": cloud[:9], "b": cloud}, {"a": weights[:9], "b": weights})
    assert both["a"].tolist() == list(range(9)) and len(both["b"]) == len(expected)
    assert [(p.start, p.stop) for p in large_clouds._parts(1500)] == [(0, 700), (700, 1400), (1400, 1500)]


def test_hashes_are_those_of_the_bits_mixed(rng):
    points = np.append(rng.normal(size=(5, 3)), [[0.0, -0.0, 1.0], [-0.0, 0.0, 1.0]], axis=0)
    found, mask = large_clouds._hashes(points), 2**64 - 1
    mix = [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9]
    for row, value in zip(points, found):
        a, b, c = (int(np.float64(x + 0.0).view(np.uint64)) * m & mask for x, m in zip(row, mix))
        mixed = a ^ (b >> 21) ^ (c >> 42)
        mixed = (mixed ^ (mixed >> 29)) * mix[1] & mask
        assert int(value) == (mixed ^ (mixed >> 32)) * mix[2] & mask
    assert found[-1] == found[-2]


def test_priors_of_a_large_cloud_weigh_as_the_inliers_of_all_its_points():
    here, of = box(), data(half_space=PLANE)
    surface = SimpleNamespace(data=of, weights=np.full(500, 2.0))
    added = []
    linear = SimpleNamespace(with_extra_terms=lambda equations: added.append(equations) or linear)
    large_clouds._All.with_priors(SimpleNamespace(surfaces=[surface]), linear, here)
    count = of.total_weight / of.weights.sum() * 1000
    (prior,) = base_prior.base_prior(of, here, count)
    np.testing.assert_allclose(added[0].matrix, prior.equations(here).matrix, rtol=1e-12)


def test_known_noise_is_relative_to_its_mean_along_the_normals():
    covariances = {"a": noisy(), "b": 4 * noisy()}
    clouds = {"a": POINTS, "b": 2 * POINTS}
    normals = SurfaceData.of(SURFACE, POINTS, np.ones(60)).neighbourhood.normals
    along = [n @ c @ n + 0.01 * np.trace(c) for n, c in zip(normals, noisy())]
    np.testing.assert_allclose(variances_along(noisy(), normals), along)
    mean = (sum(along) + 4 * sum(along)) / 120
    assert mean_variance(covariances, clouds) == pytest.approx(mean)
    found = KnownNoise.of_local(covariances, clouds)
    assert found.least_sigma == pytest.approx(np.sqrt(mean))
    np.testing.assert_allclose(found.relative["b"], 4 * noisy() / mean)
    assert KnownNoise.of_local({}, clouds) == KnownNoise({}, 0.0)
    centred = SimpleNamespace(points=clouds)
    np.testing.assert_allclose(found.deviations("a", centred), np.sqrt(np.array(along) / mean))
    np.testing.assert_array_equal(KnownNoise({}, 0.0).deviations("a", centred), np.ones(60))
    assert partial_notes({"a": None, "b": None}) == () == partial_notes({"a": noisy()})
    assert "noise of 1 of 2 clouds is known" in partial_notes({"a": None, "b": noisy()})[0]


@pytest.mark.parametrize("excess", [0.0, 0.7])
def test_inliers_are_judged_by_the_known_noise_and_what_exceeds_it(excess):
    """What exceeds the known noise is alike in all directions: of relative variances v_i it makes v_i + x."""
    of, here = replace(data(noisy()), least_sigma=0.02, inlier_ratio=0.8, excess=excess), box()
    variances = of.known_variances(surface_normals(SURFACE, here, of.origins)) + excess
    distances = of.distances(here) * np.sqrt((1 + excess) / variances)
    for sigma in (0.01, 0.03, 0.3):
        expected = of.with_inliers_at_distances(distances, sigma).inliers
        np.testing.assert_allclose(of.with_inliers(here, sigma).inliers, expected, rtol=1e-6, atol=1e-12)
    same = of.with_inliers_at_ratio(here, 0.03)
    np.testing.assert_allclose(same.inliers, inlier_probabilities(distances, 0.03, 0.8), rtol=1e-6, atol=1e-12)
    assert same.inlier_ratio == of.inlier_ratio


@pytest.mark.parametrize("succeeds", [0, 2, 7, 8], ids=lambda n: f"at step {n} from the weakest")
def test_folds_are_removed_at_the_least_strength_at_which_that_succeeds(monkeypatch, succeeds):
    """Old fault: where it failed at the weakest, one of many times that strength was taken, far from its points."""
    tried = []

    def rounds(problem, state, penalty, strength):
        return SimpleNamespace(sigma=strength, solution=SimpleNamespace(strength=strength)), False

    def removed(penalised, state, penalty, strength, surfaces, largest):
        tried.append((state.solution.strength, strength, largest))
        return state if len(tried) > succeeds else None

    monkeypatch.setattr(unfolding, "_after_penalised_rounds", rounds)
    monkeypatch.setattr(unfolding, "remove_folds", removed)
    start = SimpleNamespace(solution=SimpleNamespace(strength=2.0))
    found = unfolding._by_decreasing_strength(SimpleNamespace(penalised=None), start, None, {}, 500.0)
    ladder = 2.0 * np.geomspace(1, 1e3, 8)[: succeeds + 1]
    assert (found is None) == (succeeds == 8)
    np.testing.assert_allclose(tried, np.stack([ladder, ladder, np.full(len(ladder), 500.0)], axis=1))
