"""A cycle of small clouds: what is doubtful in a frame is said of it, slices that say nothing stay, no step goes up."""

import re
from dataclasses import replace

import numpy as np
import pytest
from notes import note_of
from remembered import remember
from shapes_made import gap, lumpy

import quadriform as qf
from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.least_squares.regularisers import Bending
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.refinement.point_to_plane import SMALLEST_STEP
from quadriform.fitting.refinement.starts import nested_ellipsoids
from quadriform.fitting.refinement.unfolding import FOLDS
from quadriform.fitting.superquadric import fit as superquadrics
from quadriform.motion.cycle import Cycle
from quadriform.motion.cycle_equations import LinearCycleProblem
from quadriform.motion.cycle_rounds import ROUNDS, FromOneFrame, fit_cycle
from quadriform.motion.energies import Smoothness
from quadriform.motion.slice_motions import FEWEST_POINTS
from quadriform.points import Frame
from quadriform.shapes.control_box import common_box
from quadriform.shapes.splines import TimeBasis


@pytest.fixture(scope="module", autouse=True)
def remembered_starts():
    """The superquadric that a motion begins with is not what is tested here."""
    with pytest.MonkeyPatch.context() as patch:
        remember(patch, superquadrics, "solve")
        yield


FRAMES = [lumpy(100, seed=t) * [1 - 0.05 * t, 1 - 0.05 * t, 1] for t in range(3)]
RADIUS = Frame.of(FRAMES[0]).scale
LOCAL = [{"surface": Frame.of(np.concatenate(FRAMES)).to_local(cloud)} for cloud in FRAMES]


def tracked(frames=FRAMES, **options):
    return qf.track(frames, **{"box": (3, 3, 3), "strength": 1e-4} | options)


@pytest.fixture(scope="module")
def plain():
    return tracked()


@pytest.fixture
def cycle():
    surfaces, basis = nested_ellipsoids(LOCAL[0]), TimeBasis(np.arange(3.0), 3.0)
    box = common_box(surfaces, (3, 3, 3))
    values, unknown = basis.values(np.arange(3.0)), KnownNoise({}, 0.0)
    return Cycle(surfaces, box, LOCAL, values, basis, Smoothness("bending", (3, 3, 3)), True, None, unknown, [None] * 3)


def with_one_far(frame):
    return [np.vstack([cloud, [[10 * RADIUS, 0, 0]]]) if n == frame else cloud for n, cloud in enumerate(FRAMES)]


def test_an_outlier_is_reported_of_its_frame_and_changes_little(plain):
    found = tracked(with_one_far(1))
    assert note_of(found, "OUTLIERS") == f"frame 1: 1 of {len(FRAMES[1]) + 1} points are outliers: {len(FRAMES[1])}"
    assert max(gap(one, other) for one, other in zip(found.models, plain.models)) < 1e-2


def test_where_outliers_are_not_detected_one_attracts_the_surface(plain):
    found = tracked(with_one_far(1), robust=False)
    assert not note_of(found, "OUTLIERS") and "frame 1" in found.warnings["POOR_FIT"]
    assert max(gap(one, other) for one, other in zip(found.models, plain.models)) > 0.1


def filled(seed):
    return np.cbrt(np.random.default_rng(seed).uniform(size=(100, 1))) * FRAMES[seed]


def test_filled_bodies_are_a_poor_fit():
    found = tracked([filled(frame) for frame in range(3)])
    # frames whose distances are equal as printed share a sentence
    heads = [text.split(":")[0] for text in found.warnings["POOR_FIT"].split("; ")]
    assert re.findall(r"\d", " ".join(heads)) == ["0", "1", "2"]


def test_a_filled_body_among_surfaces_has_outliers():
    found = tracked([FRAMES[0], filled(1), FRAMES[2]])
    assert found.warnings["MANY_OUTLIERS"].startswith("frame 1: ")


def test_what_is_not_verified_to_be_free_of_folds_is_reported_of_its_frame(monkeypatch, plain):
    checks = []

    def all_but_the_second(self, state):
        checks.append(state)
        return (True, False, True), state

    monkeypatch.setattr(Cycle, "with_checked_folds", all_but_the_second)
    found = tracked()
    assert found.warnings["FOLDING"].startswith("frame 1: the map is not verified to be free of folds")
    assert "FOLDING" not in plain.warnings
    assert len(checks) <= 2 * ROUNDS.unfolding_rounds + FOLDS.descent * FOLDS.rounds + 1
    # what is kept is the state before any removal, not one that penalties have moved off its points
    assert found.rms == pytest.approx(plain.rms, rel=0.05)


@pytest.mark.parametrize("strategy", ["cycle", "previous", "alone"])
def test_progress_is_reported_to_its_end(strategy):
    told = []
    tracked(strategy=strategy, progress=lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    of_cycle = ROUNDS.affine_rounds + ROUNDS.falling_rounds + ROUNDS.least_rounds
    assert told[-1][0] == told[-1][1] == (of_cycle if strategy == "cycle" else 3)


def test_the_rms_of_the_frames_is_that_of_all(plain):
    counts = np.array([len(cloud) for cloud in FRAMES])
    assert np.sqrt(np.average(plain.frame_rms**2, weights=counts)) == pytest.approx(plain.rms)


@pytest.mark.parametrize("strategy", ["cycle", "alone"])
def test_in_the_other_frame_of_the_world_x_and_y_change_their_signs(strategy):
    numbers = [np.arange(100) // 50] * 3 if strategy == "cycle" else None
    found = tracked(strategy=strategy, slices=numbers)
    models = tuple(replace(model, space="LPS") for model in found.models)
    moving = None if found.moving is None else replace(found.moving, space="LPS")
    turned = replace(found, models=models, moving=moving).in_space("RAS")
    for one, other in zip(models, turned.models):
        np.testing.assert_allclose(other.mesh().vertices, one.mesh().vertices * [-1, -1, 1], atol=1e-9 * RADIUS)
    assert (turned.moving is None) == (strategy == "alone")
    assert list(turned.shifts) == list(found.shifts) == ([0, 1] if strategy == "cycle" else [])
    for number, shift in found.shifts.items():
        np.testing.assert_allclose(turned.shifts[number], shift * [-1, -1, 1])


def test_a_motion_that_does_not_repeat_has_a_knot_at_either_end():
    found = tracked(times=[2, 3, 5], period=None)
    assert found.moving.basis.period is None
    np.testing.assert_array_equal(found.moving.basis.knots[[0, -1]], [2, 5])


def test_points_of_no_slice_and_slices_of_few_points_are_not_moved(plain):
    few = np.full(100, -1)
    few[: FEWEST_POINTS - 1] = 7
    for numbers in (np.full(100, -1), few):
        found = tracked(slices=[numbers, *[np.full(100, -1)] * 2])
        assert found.shifts == {}
        assert max(gap(one, other) for one, other in zip(found.models, plain.models)) < 1e-6


def test_a_slice_may_be_missing_in_a_frame():
    numbers = [np.arange(100) // 34] * 3
    numbers[1] = np.where(numbers[1] == 2, -1, numbers[1])
    found = tracked(slices=numbers)
    assert list(found.shifts) == [0, 1, 2]
    assert np.isfinite(list(found.shifts.values())).all()


def test_strengths_of_nothing_leave_control_points_undetermined(cycle):
    assert cycle.linear_problem(cycle.init()).solve(0.0, 0.0) is None
    with pytest.raises(OptionError, match=r"option strength=1e-300 leaves control points undetermined"):
        fit_cycle(cycle, FromOneFrame(cycle.box), 1e-300)


def test_rounds_without_a_solution_change_nothing(monkeypatch, cycle):
    monkeypatch.setattr(LinearCycleProblem, "solve", lambda *words: None)
    assert cycle.step(cycle.init(), (1e-4, 1e-4)) is None
    with pytest.raises(DegenerateError, match="frames leave control points undetermined"):
        fit_cycle(cycle, FromOneFrame(cycle.box), None)


@pytest.mark.parametrize("strength", [1e3, 1e9, 1e15])
def test_very_strong_regularisation_leaves_motions_without_bending(cycle, strength):
    """Old bug: what costs nothing drowned in the rounding of what costs much, and the factorisation failed."""
    solution = cycle.linear_problem(cycle.init()).solve(strength, strength)
    assert np.abs(solution.displacement).max() > 1e-3
    bent = np.einsum("kl,alc->akc", Bending().matrix(cycle.shape), solution.displacement)
    assert np.abs(bent).max() < 1e-9 * max(1, 1e6 / strength)


def test_no_strength_in_time_is_found_where_none_in_space_holds(cycle):
    """Criteria that are infinite are no reason to fail: the search ends at a strength all the same."""
    assert np.isfinite(cycle.linear_problem(cycle.init()).best_in_time(0.0, 1e-300))


@pytest.mark.parametrize("too_far", [1.0, 4.0, -1.0], ids=["right", "too far", "uphill"])
def test_no_step_goes_far_up(monkeypatch, cycle, too_far):
    """A step too far is cut rather than left out; where the direction itself leads up next to nothing is gone."""
    start = cycle.init()
    steps, sums, solve, total = [], [], LinearCycleProblem.solve, Cycle.total

    def proposed(self, alpha, gamma):
        solution = solve(self, alpha, gamma)
        steps.append(too_far * (solution.displacement - start.displacement))
        return replace(solution, displacement=start.displacement + steps[-1])

    monkeypatch.setattr(LinearCycleProblem, "solve", proposed)
    monkeypatch.setattr(Cycle, "total", lambda *words: sums.append(total(*words)) or sums[-1])
    moved = cycle.step(start, (1e-4, 1e-4)).displacement
    if too_far > 0:
        assert sums[-1] < sums[0] and np.abs(moved).max() > 1e-3
    else:
        assert np.abs(moved).max() < 2 * SMALLEST_STEP * np.abs(steps[0]).max()


def test_a_cavity_that_empties_in_a_wall_that_does_not_move_is_tracked():
    """Three quarters of all points do not move; those of the cavity at the other time are no outliers for that."""
    outside = lumpy(300)
    clouds = [{"endo": 0.7 * outside, "epi": outside}, {"endo": 0.5 * outside, "epi": outside}]
    found = qf.track(clouds, box=(4, 4, 4))
    full, empty = (model.volume("endo") for model in found.models)
    assert empty / full == pytest.approx((0.5 / 0.7) ** 3, rel=0.05)
    assert not note_of(found, "OUTLIERS")
