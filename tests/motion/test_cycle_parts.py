"""Each part of a round of a cycle against plain sums over frames, surfaces and points."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import lumpy

from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.refinement.base_prior import base_priors
from quadriform.fitting.refinement.point_to_plane import data_rows, effective_fraction_of_data
from quadriform.fitting.refinement.stage import independent_fraction
from quadriform.fitting.refinement.starts import nested_ellipsoids
from quadriform.motion import cycle as cycles
from quadriform.motion.cycle import Cycle, named
from quadriform.motion.energies import Smoothness
from quadriform.motion.slice_motions import SlicePlanes
from quadriform.points import Frame
from quadriform.shapes.control_box import common_box
from quadriform.shapes.splines import TimeBasis

CLOUDS = [lumpy(60, seed=t) * [1 - 0.05 * t, 1 - 0.05 * t, 1] for t in range(3)]
FRAME = Frame.of(np.concatenate(CLOUDS))
LOCAL = [{"surface": FRAME.to_local(cloud)} for cloud in CLOUDS]
SURFACES, BASIS = nested_ellipsoids(LOCAL[0]), TimeBasis(np.arange(3.0), 3.0)
BOX, VALUES = common_box(SURFACES, (3, 3, 3)), BASIS.values(np.array([0.0, 1.2, 2.1]))
PLANE = (np.array([0.0, 0, 0.6]), np.array([0, 0, 1.0]))


def cycle(planes=None, noise=None, bases=(None, None, None), robust=True):
    known = KnownNoise(noise or {}, 0.0)
    return Cycle(
        SURFACES, BOX, LOCAL, VALUES, BASIS, Smoothness("bending", (3, 3, 3)), robust, planes, known, list(bases)
    )


def sliced():
    numbers = [np.digitize(frame["surface"][:, 2], [-0.5, 0.3]) for frame in LOCAL]
    slices = [{"surface": each} for each in numbers]
    return SlicePlanes.of(LOCAL, slices), slices


def moved(of, seed=5, size=0.03):
    """A state whose control points moved, each knot for itself."""
    state = of.init()
    displacement = size * np.random.default_rng(seed).normal(size=state.displacement.shape)
    boxes = of._boxes(displacement)
    datasets = [[replace(d, inliers=np.linspace(0.2, 1, 60)) for d in each] for each in state.datasets]
    return replace(state, displacement=displacement, boxes=boxes, datasets=datasets).nearest()


def test_a_cycle_begins_with_the_undeformed_box_and_the_median_distance():
    of = cycle()
    state = of.init()
    distances = np.concatenate([d.standardised_distances(BOX) for each in state.datasets for d in each])
    assert state.sigma == pytest.approx(1.4826 * np.median(distances))
    assert state.displacement.shape == (3, 27, 3) and not state.displacement.any()
    assert state.slices.motions.shape == (0, 6)
    assert state.fold_penalties[0].weight == pytest.approx(1e-3 * 60 * (state.sigma / 0.1) ** 2)
    with_planes = cycle(sliced()).init()
    assert with_planes.slices.motions.shape == (3, 6)
    noise = np.tile(np.eye(3), (60, 1, 1))
    known = cycle(noise={named(1, "surface"): noise}, bases=(None, None, PLANE)).init()
    assert [each[0].covariances is not None for each in known.datasets] == [False, True, False]
    assert [each[0].half_space is not None for each in known.datasets] == [False, False, True]


def test_a_cycle_begins_with_ellipsoids():
    assert [surface.exponents.tolist() for surface in SURFACES.values()] == [[1.0, 1.0]]


def test_boxes_are_the_knots_times_their_splines():
    of, state = cycle(), moved(cycle())
    for values, box in zip(VALUES, of._boxes(state.displacement)):
        expected = BOX.rest + sum(v * d.reshape(3, 3, 3, 3) for v, d in zip(values, state.displacement))
        np.testing.assert_allclose(box.control_points, expected, atol=1e-12)


def test_the_extreme_frames_are_those_of_the_least_and_the_largest_distances():
    of, state = cycle(), moved(cycle())
    squares = [
        sum(((d.points - box.deform(d.origins)) ** 2).sum() for d in each)
        for box, each in zip(state.boxes, state.datasets)
    ]
    assert of.extremes(state) == (int(np.argmin(squares)), int(np.argmax(squares)))


def test_the_strength_in_space_is_the_smallest_of_its_frames(monkeypatch):
    of, state, given = cycle(), moved(cycle()), []

    def best(self, start):
        given.append((self.effective_fraction, start))
        return type("S", (), {"strength": [3.0, 1.0, 2.0][len(given) - 1]})

    monkeypatch.setattr(LinearProblem, "best", best)
    assert of.strength_in_space(state, (0, 2, 1), 0.5) == 1
    expected = [independent_fraction(tuple(state.datasets[k]), state.boxes[k], 81.0) for k in (0, 2, 1)]
    assert given == [(pytest.approx(each), 0.5) for each in expected]


def test_independent_points_are_a_mean_over_frames():
    of, state = cycle(), moved(cycle())
    fractions, counts = [], []
    for box, each in zip(state.boxes, state.datasets):
        count = sum(d.total_weight for d in each)
        least = 81 / max(count, 81)  # a third of 243 unknowns for each of three frames
        fractions.append(max(least, effective_fraction_of_data(each, box)))
        counts.append(count)
    assert of.effective_fraction(state) == pytest.approx(np.average(fractions, weights=counts))
    assert of.effective_fraction(state, before_rounds=True) == pytest.approx(
        np.average([81 / max(c, 81) for c in counts], weights=counts)
    )


@pytest.mark.parametrize("planes", [False, True])
def test_the_linear_problem_is_the_sum_over_the_points_of_all_frames(planes, rng):
    of = cycle(sliced() if planes else None)
    state = moved(of)
    if planes:  # linearised at other motions than zero
        state = replace(state, slices=replace(state.slices, motions=0.1 * rng.normal(size=(3, 6))))
    linear = of.linear_problem(state)
    assert linear.total_weight == pytest.approx(sum(d.total_weight for each in state.datasets for d in each))
    displacement = 0.05 * rng.normal(size=(3, 27, 3))
    motions = 0.01 * rng.normal(size=(3, 6)) if planes else np.zeros((0, 6))
    expected = 0.0
    for frame, (values, box, each) in enumerate(zip(VALUES, state.boxes, state.datasets)):
        of_frame = np.einsum("a,aki->ki", values, displacement)
        for data, points in zip(each, LOCAL[frame].values()):
            rows = data_rows(data, box)
            if planes:
                points = linearised(of.planes[0], state.slices.motions, motions, of.planes[1][frame]["surface"], points)
            left = points - rows.origins - BOX.matrix(rows.origins) @ of_frame
            expected += np.einsum("ni,nij,nj->", left, rows.metric, left)
    if planes:
        precision = state.slices.noise**2 * state.slices.prior.precision()
        expected += motions.ravel() @ precision @ motions.ravel()
    assert linear.cost(displacement, motions.ravel(), 0.0, 0.0) == pytest.approx(expected, rel=1e-6)


def test_the_sum_that_a_round_lowers_has_the_penalties_of_every_frame(rng):
    of = cycle(bases=(None, PLANE, PLANE))
    state = moved(of)
    linear, penalties = of.linear_problem(state), cycles._penalties(state)
    displacement = state.displacement + 0.05 * rng.normal(size=state.displacement.shape)
    expected = linear.cost(displacement, np.zeros(0), 1e-3, 1e-4)
    for box, before, each, folds in zip(of._boxes(displacement), state.boxes, state.datasets, state.fold_penalties):
        expected += folds.cost(box) + sum(prior.cost(box) for prior in base_priors(each, before))
    assert [len(each) for each in penalties] == [1, 2, 2]
    assert of.total(state, linear, penalties, displacement, np.zeros(0), (1e-3, 1e-4)) == pytest.approx(expected)


def linearised(planes, at, motions, numbers, points):
    """Points under motions, by the derivatives of the moved points at others."""
    step = 1e-5 * (motions - at)
    change = planes.moved(at + step, numbers, points) - planes.moved(at - step, numbers, points)
    return planes.moved(at, numbers, points) + change / 2e-5


def test_points_move_with_their_slices(rng):
    of = cycle(sliced())
    state, motions = of.init(), rng.normal(size=(3, 6))
    planes, slices = of.planes
    for frame, each in enumerate(of._moved(state.datasets, motions)):
        expected = planes.moved(motions, slices[frame]["surface"], LOCAL[frame]["surface"])
        np.testing.assert_array_equal(each[0].points, expected)
    plain = cycle()
    assert plain._moved(state.datasets, motions[:0]) is state.datasets


def test_where_most_points_are_far_the_noise_is_their_own():
    state = cycle().init()
    data, box = state.datasets[0][0], state.boxes[0]
    distances = data.standardised_distances(box)
    near = cycles._weighted(data, box, 10 * distances.max())
    np.testing.assert_array_equal(near.inliers, data.with_inliers_at_distances(distances, 10 * distances.max()).inliers)
    assert near.inliers.mean() > 0.5
    far = replace(data, points=2.5 * data.points)
    found, away = cycles._weighted(far, box, 1e-3), far.standardised_distances(box)
    assert far.with_inliers_at_distances(away, 1e-3).inliers.mean() < 0.5
    np.testing.assert_array_equal(found.inliers, far.with_inliers_at_distances(away, 1.4826 * np.median(away)).inliers)


def test_a_result_has_the_control_points_and_what_is_verified_of_each_frame():
    of = cycle()
    state = replace(of.init(), displacement=np.tile((0.1 * BOX.rest).reshape(1, 27, 3), (3, 1, 1)))
    found = of.result(state, (1.0, 2.0), (True, False, True))
    np.testing.assert_allclose(found.control_points, np.tile(1.1 * BOX.rest, (3, 1, 1, 1, 1)))
    assert found.verified == (True, False, True) and list(found.datasets[0]) == ["surface"]


def test_folds_strengthen_the_penalties_of_their_frames_alone(monkeypatch):
    of = cycle()
    state = of.init()
    verified = iter([True, False, True])
    monkeypatch.setattr(cycles.JacobianPenalty, "check", lambda self, box, surfaces: (next(verified), self))
    found, after = of.with_checked_folds(state)
    assert found == (True, False, True)
    weights = [penalty.weight / state.fold_penalties[0].weight for penalty in after.fold_penalties]
    assert weights == pytest.approx([1, 2, 1])
