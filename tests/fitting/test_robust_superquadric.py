"""The robust superquadric: exact recovery, invariances, outliers, other bodies, missing parts, weights, held values."""

from dataclasses import replace

import numpy as np
import pytest
from notes import note_of
from shapes_made import even_directions, made, turned

from quadriform import fit_superquadric
from quadriform.errors import OptionError
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.initial import bound_of_axes
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.multistart import acceptable, annealed_starts, em
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.search_settings import SEARCH
from quadriform.points import Frame
from quadriform.shapes.superquadric import Superquadric

EXACT, SAME, NEAR = 1e-9, 1e-7, 0.02
"""Of the RMS radius: noise-free recovery, one problem posed in two ways, close to the truth under noise."""


def apart(one, other):
    """Largest distance between two superellipsoids, both ways, over the RMS radius of the first."""
    points, others = (s.surface(even_directions(2000)) for s in (one, other))
    radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    return max(one.first_order_distance(others).max(), other.first_order_distance(points).max()) / radius


def cloud(rng, exponents=(0.6, 1.4), n=600, noise=0.02):
    """A superellipsoid and noisy points of it."""
    truth = made(exponents=exponents)
    points = truth.surface(rng.normal(size=(n, 3)))
    return truth, points + noise * rng.normal(size=points.shape)


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.4), (0.1, 0.1), (0.02, 1.0), (1.9, 0.3), (1.7, 1.8)])
@pytest.mark.parametrize("semi_axes", [(3, 2, 4), (3, 3, 3.1), (0.3, 0.25, 4)])
def test_noise_free_points_give_the_shape_back(exponents, semi_axes, rng):
    truth = made(exponents=exponents, semi_axes=semi_axes)
    found = fit_superquadric(truth.surface(rng.normal(size=(700, 3)) * semi_axes))
    assert apart(truth, found.superquadric) < EXACT
    assert found.noise < 1e-8
    assert (found.inliers > 0.99).all()


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.4), (0.3, 0.3)])
@pytest.mark.parametrize("kind", ["toroid", "hyperboloid1", "hyperboloid2"])
def test_the_other_kinds_come_back(kind, exponents):
    truth = made(kind, exponents)
    found = fit_superquadric(truth.grid(10)[0], kind).superquadric
    assert found.kind == kind
    for one, other in ((found, truth), (truth, found)):
        assert np.abs(one.implicit(other.grid(8)[0]) - 1).max() < 1e-7


@pytest.mark.parametrize("kind", ["toroid", "hyperboloid1", "hyperboloid2"])
def test_starts_of_the_other_kinds_move_on_the_part_that_they_are_made_from(kind, rng):
    """Old fault: they are all made from the first part, and half of them moved on the second one."""
    points = made(kind).grid(10)[0]
    points = (points - points.mean(axis=0)) / np.sqrt(points.var(axis=0).sum())
    one = np.ones(len(points))
    problem = SearchProblem(points, one, kind, {}, 0 * one, one, longest=bound_of_axes(points))
    other = (points @ rng.normal(size=3) > 0).astype(float)
    alone, beside = (annealed_starts(problem, parts, None, 160) for parts in (one[None], np.stack([one, other])))
    np.testing.assert_array_equal(alone.distances, beside.distances)


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_moved_scaled_mirrored_or_shuffled_cloud_has_the_same_surface(seed, rng):
    exponents = [(0.6, 1.4), (0.2, 0.8), (1.2, 1.0)][seed]
    _, points = cloud(rng, exponents)
    points = np.concatenate([points, rng.uniform(-8, 8, (60, 3))])
    found = fit_superquadric(points).superquadric
    turn, offset, mirror = turned(seed), np.array([1e3, -2e3, 5e2]), np.diag([1.0, 1.0, -1.0])

    moved = fit_superquadric(points @ turn.T + offset).superquadric
    back = replace(moved, rotation=turn.T @ moved.rotation, translation=turn.T @ (moved.translation - offset))
    assert apart(found, back) < SAME
    scaled = fit_superquadric(1e-6 * points).superquadric.transformed(1e6, np.zeros(3))
    assert apart(found, scaled) < SAME
    assert apart(found, fit_superquadric(points[rng.permutation(len(points))]).superquadric) < SAME
    other = fit_superquadric(points @ mirror).superquadric
    back = replace(other, rotation=mirror @ other.rotation @ mirror, translation=mirror @ other.translation)
    assert apart(found, back) < SAME


def test_far_from_the_origin_nothing_changes(rng):
    _, points = cloud(rng)
    found, far = fit_superquadric(points).superquadric, np.full(3, 1e6)
    moved = fit_superquadric(points + far).superquadric.transformed(1.0, -far)
    assert apart(found, moved) < SAME


def test_a_weight_counts_copies_and_zero_is_absent(rng):
    _, points = cloud(rng)
    weights = rng.integers(0, 4, len(points)).astype(float)
    weighted = fit_superquadric(points, weights=weights)
    copied = fit_superquadric(np.repeat(points, weights.astype(int), axis=0))
    assert apart(weighted.superquadric, copied.superquadric) < SAME
    assert note_of(copied, "DUPLICATES") and not note_of(weighted, "DUPLICATES")
    assert apart(weighted.superquadric, fit_superquadric(points, weights=2 * weights).superquadric) < SAME
    assert apart(weighted.superquadric, fit_superquadric(points).superquadric) > 100 * SAME
    assert (weighted.inliers[weights == 0] == 0).all()


@pytest.mark.parametrize("share", [0.1, 0.6, 1.5])
def test_outliers_are_found_and_do_no_harm(share, rng):
    truth, points = cloud(rng, n=1000)
    strays = rng.uniform(-12, 12, (int(share * 1000), 3)) + truth.translation
    found = fit_superquadric(np.concatenate([points, strays]))
    assert apart(truth, found.superquadric) < NEAR
    assert found.noise == pytest.approx(0.02, rel=0.1)
    assert found.inliers[:1000].mean() > 0.98
    assert found.inliers[1000:].mean() < 0.1
    many = share > 0.5
    assert found.status == ("warned" if many else "ok")
    outside = int((found.inliers < 0.5).sum())
    assert f"{outside} of {1000 + len(strays)}" in (
        found.warnings["MANY_OUTLIERS"] if many else note_of(found, "OUTLIERS")
    )


def test_one_gross_outlier_is_named(rng):
    _, points = cloud(rng)
    found = fit_superquadric(np.concatenate([points, [[60.0, 0, 0]]]))
    assert note_of(found, "OUTLIERS").endswith(": 600")
    assert apart(fit_superquadric(points).superquadric, found.superquadric) < 1e-2


def test_a_smaller_body_beside_is_left_out(rng):
    truth, points = cloud(rng, n=900)
    beside = Superquadric(
        semi_axes=(0.8, 1.0, 0.7), exponents=(0.4, 0.9), translation=truth.translation + np.array([4.0, 1, 1])
    )
    found = fit_superquadric(np.concatenate([points, beside.surface(rng.normal(size=(400, 3)))]))
    assert apart(truth, found.superquadric) < NEAR
    assert found.inliers[900:].mean() < 0.2


def test_half_a_surface_gives_the_whole(rng):
    truth, points = cloud(rng, n=1600)
    found = fit_superquadric(points[(points - truth.translation) @ [1.0, 2.0, 0.5] > 0])
    assert apart(truth, found.superquadric) < 3 * NEAR
    assert "PARTIAL_COVERAGE" in found.warnings
    assert found.condition < 1e4


def test_an_open_tube_does_not_diverge_and_is_warned_of(rng):
    angle, height = rng.uniform(-np.pi, np.pi, 500), rng.uniform(-1, 1, 500)
    points = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    found = fit_superquadric(points)
    assert found.superquadric.semi_axes.max() <= 2 * np.ptp(points, axis=0).max()
    assert found.status == "warned"
    assert found.condition > 1e4 or found.rank < 11
    assert "ILL_CONDITIONED" in found.warnings


def test_an_octant_is_worse_determined_than_the_whole(rng):
    truth, points = cloud(rng, n=3000)
    octant = fit_superquadric(points[((points - truth.translation) @ truth.rotation > 0).all(axis=1)])
    whole = fit_superquadric(points)
    assert whole.condition < 50 < octant.condition
    assert whole.status == "ok" and "PARTIAL_COVERAGE" in octant.warnings
    assert np.trace(octant.covariance) > 10 * np.trace(whole.covariance)


def test_a_sphere_is_symmetric(rng):
    truth = Superquadric(semi_axes=(2, 2, 2))
    found = fit_superquadric(truth.surface(rng.normal(size=(400, 3))))
    assert apart(truth, found.superquadric) < 1e-6
    assert {"NEAR_SYMMETRIC", "ILL_CONDITIONED"} <= found.warnings.keys()
    assert found.rank == 8


@pytest.mark.parametrize("name", ["semi_axes", "exponents", "rotation", "translation"])
def test_held_values_stay_and_the_rest_is_fitted(name, rng):
    truth, points = cloud(rng)
    value = getattr(truth, name)
    found = fit_superquadric(points, fixed={name: value})
    np.testing.assert_allclose(getattr(found.superquadric, name), value, rtol=0, atol=1e-12)
    assert apart(truth, found.superquadric) < NEAR
    held = {"semi_axes": slice(0, 3), "exponents": slice(3, 5), "rotation": slice(5, 8), "translation": slice(8, 11)}
    assert not found.covariance[held[name]].any()
    assert (np.delete(np.diag(found.covariance), held[name]) > 0).all()


def test_fixed_parameters_are_not_called_undetermined():
    """Of a sphere as an ellipsoid only its three rotations are: six of nine are determined, not of eleven."""
    found = fit_superquadric(even_directions(300), fixed={"exponents": (1, 1)})
    assert found.rank == 6 and "determine 6 of 9 superquadric parameters" in found.warnings["ILL_CONDITIONED"]


def test_an_ellipsoid_is_a_superquadric_with_held_exponents(rng):
    _, points = cloud(rng, exponents=(0.5, 0.5))
    found = fit_superquadric(points, fixed={"exponents": (1, 1)})
    assert found.superquadric.exponents.tolist() == [1, 1]
    assert found.noise > fit_superquadric(points).noise


def test_the_covariance_is_that_of_repeated_measurements(rng):
    truth = made()
    clean = truth.surface(even_directions(300))
    start = np.concatenate([truth.semi_axes, truth.exponents, truth.translation])
    errors, variances = [], []
    for _ in range(25):
        found = fit_superquadric(clean + 0.03 * rng.normal(size=clean.shape))
        s = found.superquadric
        order = np.argsort(s.semi_axes)[[1, 0, 2]]  # made with 3, 2, 4
        assert order[2] == 2
        numbers = np.concatenate([s.semi_axes[order], s.exponents, s.translation])
        errors.append(numbers - start)
        spread = np.diag(found.covariance)
        variances.append(np.concatenate([spread[order], spread[3:5], spread[8:11]]))
    ratio = (np.array(errors) ** 2).mean(axis=0) / np.mean(variances, axis=0)
    assert ((ratio > 0.4) & (ratio < 2.5)).all()  # more than three sigma of 25 draws


def test_few_points_leave_the_exponents_near_one(rng):
    _, points = cloud(rng, exponents=(1, 1), n=14, noise=0.05)
    found = fit_superquadric(points)
    assert np.isfinite(found.covariance).all()
    assert found.superquadric.semi_axes.max() < 2 * np.ptp(points, axis=0).max()


def test_points_on_axes_planes_and_in_the_centre_do_no_harm(rng):
    truth = Superquadric(semi_axes=(3, 2, 4), exponents=(0.5, 1.3))
    directions = np.concatenate([even_directions(300), np.eye(3), -np.eye(3), [[1, 1, 0], [0, 1, 1], [1, 0, 1]]])
    with np.errstate(all="raise"):
        found = fit_superquadric(np.concatenate([truth.surface(directions), np.zeros((1, 3))]))
    assert apart(truth, found.superquadric) < EXACT
    assert found.inliers[-1] < 0.5


def test_the_input_stays_as_it_was_and_the_answer_repeats(rng):
    _, points = cloud(rng)
    kept = points.copy()
    one, two = fit_superquadric(points), fit_superquadric(np.asfortranarray(points))
    np.testing.assert_array_equal(points, kept)
    np.testing.assert_array_equal(one.superquadric.parameters, two.superquadric.parameters)
    np.testing.assert_array_equal(one.covariance, two.covariance)


ALL_FIXED = {"semi_axes": (1, 1, 1), "exponents": (1, 1), "rotation": np.eye(3), "translation": np.zeros(3)}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fixed": {"exponent": (1, 1)}}, "exponents"),
        ({"fixed": ALL_FIXED}, "nothing is left to fit"),
        ({"fixed": {"exponents": (1, 3)}}, "fixed"),
        ({"fixed": {"semi_axes": (1, 2)}}, "semi_axes"),
        ({"method": "paper", "fixed": {"exponents": (1, 1)}}, "robust"),
        ({"method": "best"}, "'robust'"),
    ],
)
def test_wrong_options_are_named(options, said, rng):
    with pytest.raises(OptionError, match=said):
        fit_superquadric(cloud(rng)[1], **options)


@pytest.mark.parametrize(("seed", "rests"), [(2, False), (0, True), (1, True), (3, True)])
def test_a_descent_ends_where_shorter_steps_gain_nothing_either(seed, rests):
    """On a body that is nearly one of revolution it once tried ever shorter ones, up to the last it was allowed.

    Where its damping alone made them short it is not at rest; where they are short by themselves it is, refused or not.
    """
    rng = np.random.default_rng(seed)
    around = rng.normal(size=(1000, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    egg = around * [1.4, 1, 1] * (1 + 0.1 * around[:, :1]) + 0.02 * rng.normal(size=(1000, 3))
    points = Frame.of(egg).to_local(egg)
    best = Candidates.of([fit_superquadric(points).superquadric])
    problem = SearchProblem(points, np.ones(1000), "ellipsoid", {}, np.zeros(1000), np.ones(1000))
    descent = Descent(problem, best, Mixture(np.array([0.99]), np.array([0.02])))
    assert descent.run(SEARCH.most_steps, em, SEARCH.crease_tolerance) == rests
    assert len(descent.history) < SEARCH.most_steps / 2


@pytest.mark.parametrize(("inliers", "accepted"), [(0.48, False), (0.52, True)])
def test_a_candidate_needs_half_of_the_points(inliers, accepted, rng):
    truth, points = cloud(rng)
    problem = SearchProblem(points, np.ones(600), "ellipsoid", {}, np.zeros(600), np.ones(600))
    mixture = Mixture(np.array([inliers]), np.array([0.02]))
    assert acceptable(Descent(problem, Candidates.of([truth]), mixture)).tolist() == [accepted]
