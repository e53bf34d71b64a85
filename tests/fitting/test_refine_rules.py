"""Which start, box and strength a refinement ends with, by stand-ins whose noise and folds are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.errors import OptionError
from quadriform.fitting.refinement import refine, stages
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.control_box import ControlBox

SURFACE = replace(made(exponents=(1, 1), semi_axes=(1.2, 0.9, 0.8)), translation=np.zeros(3))


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((3, 3, 3), [(3, 3, 3)]),
        ((2, 2, 2), [(2, 2, 2)]),
        ((4, 4, 4), [(3, 3, 3), (4, 4, 4)]),
        ((5, 3, 6), [(3, 3, 3), (5, 3, 5), (5, 3, 6)]),
        ((7, 7, 7), [(3, 3, 3), (5, 5, 5), (7, 7, 7)]),
    ],
)
def test_boxes_grow_by_two_control_points_from_stage_to_stage(shape, expected):
    assert stages.control_point_counts(ControlBox.around(SURFACE, shape)) == expected


def trial(criterion=0.0, sigma=1.0, undeformed=9.0, intersects=False, surfaces=("a",)):
    return SimpleNamespace(
        first=SimpleNamespace(solution=SimpleNamespace(criterion=criterion), sigma=sigma),
        undeformed_rms=undeformed,
        coarse=SimpleNamespace(crosses_though_covered=intersects),
        surfaces=dict.fromkeys(surfaces),
        problem="problem",
        datasets=(),
        identity=object(),  # so that trials alike are not equal
    )


def ordered(monkeypatch, trials):
    given = iter(trials)
    monkeypatch.setattr(refine._Trial, "of", lambda problem, surfaces, shape: next(given))
    return [trials.index(each) for each in refine._ordered(None, trials, None)]


def test_starts_are_ordered_by_evidence_and_a_much_nearer_one_comes_first(monkeypatch):
    assert ordered(monkeypatch, [trial(3.0), trial(1.0), trial(2.0)]) == [1, 2, 0]
    assert ordered(monkeypatch, [trial(1.0), trial(2.0, undeformed=0.51), trial(3.0)]) == [0, 1, 2]
    assert ordered(monkeypatch, [trial(1.0), trial(2.0), trial(3.0, undeformed=0.49)]) == [2, 0, 1]
    assert ordered(monkeypatch, [trial(1.0), trial(2.0, sigma=0.9, undeformed=0.46)]) == [0, 1]
    assert ordered(monkeypatch, [trial(1.0, undeformed=0.1)]) == [0]
    last = [trial(intersects=True), trial(), trial(intersects=True), trial()]
    assert [last.index(each) for each in refine._crossing_last(last)] == [1, 3, 0, 2]


def certified(monkeypatch, trials, noises, unfolded, largest=None, far=None):
    """Trials whose refinements have these noises, and those without folds; and the limits that were asked for.

    `far` has the RMS distance from data of the parts without data by the noise of the refinement; else it is zero.
    """
    limits = []
    monkeypatch.setattr(refine, "rms_far_from_data", lambda refined: (far or {}).get(refined.sigma, 0.0))
    monkeypatch.setattr(refine, "_ordered", lambda *of: trials)
    refined = iter([SimpleNamespace(sigma=sigma) for sigma in noises])
    monkeypatch.setattr(refine, "fine_stage", lambda *of: next(refined))
    each = iter(unfolded)

    def without_folds(problem, found, surfaces, limit):
        limits.append(limit)
        return [SimpleNamespace(sigma=sigma) for sigma in next(each)]

    monkeypatch.setattr(refine, "without_folds", without_folds)
    (first, found, _), best = refine._first_and_best(None, trials, None, largest)
    assert first is trials[0] and found.sigma == noises[0]
    return None if best is None else (trials.index(best.trial), best.refined.sigma), limits


def test_the_first_start_without_folds_at_an_accepted_noise_is_taken(monkeypatch):
    two = [trial(), trial()]
    assert certified(monkeypatch, two, [0.1, 0.2], [[0.12], [0.05]]) == ((0, 0.12), [pytest.approx(0.15)])
    found, limits = certified(monkeypatch, two, [0.1, 0.2], [[], [0.14]])
    assert found == (1, 0.14) and limits == pytest.approx([0.15, 0.15])  # one and a half times that of the first
    assert certified(monkeypatch, two, [0.1, 0.2], [[], []])[0] is None
    assert certified(monkeypatch, two, [0.1, 0.2], [[], [0.5]], 0.6) == ((1, 0.5), [0.6, 0.6])


def test_a_refinement_with_a_part_far_from_data_gives_way_to_one_without(monkeypatch):
    """Old bug: the tip of a start beyond the end of a scanned body stayed, though the next start fits on all sides."""
    two, noises = [trial(), trial()], [0.1, 0.1]
    unfolded = [[0.12, 0.11], [0.13, 0.05]]
    assert certified(monkeypatch, two, noises, unfolded, far={0.12: 0.3, 0.11: 0.2})[0] == (1, 0.13)
    # less than the noise: no other is tried
    assert certified(monkeypatch, two, noises, unfolded, far={0.12: 0.1})[0] == (0, 0.12)
    # where all have such parts, the points to the surfaces and the surfaces to the points count alike
    all_far = {0.12: 0.3, 0.11: 0.2, 0.13: 0.4, 0.05: 0.5}
    assert certified(monkeypatch, two, noises, unfolded, far=all_far)[0] == (0, 0.11)
    # one of more noise is no better for having no such part
    assert certified(monkeypatch, two, [0.05, 0.05], [[0.01], [0.07]], far={0.01: 0.02})[0] == (0, 0.01)


def far_from_data(body, semi_axes=(1, 1, 1), half_space=None):
    """Of an ellipsoid with these semi-axes, undeformed, as the surface of a body."""
    surface = replace(SURFACE, semi_axes=np.array(semi_axes, dtype=float))
    data = SurfaceData.of(surface, body, np.ones(len(body)), half_space)
    refined = SimpleNamespace(box=ControlBox.around(surface, (3, 3, 3)), datasets=(data,), sigma=0.001)
    return refine.rms_far_from_data(refined)


def test_a_tip_beyond_a_body_with_data_on_all_sides_is_far_from_data():
    """Points say nothing of it, for none belongs to it."""
    ball = even_directions(1500)
    assert far_from_data(ball) == 0
    assert far_from_data(ball, (1, 1, 2)) > 0.2
    assert far_from_data(ball[ball[:, 2] < 0.3], (1, 1, 2)) == 0  # a surface that goes on beyond its data
    above, below = (np.array([0, 0, 0.0]), np.array([0, 0, 1.0])), (np.array([0, 0, 0.0]), np.array([0, 0, -1.0]))
    cut = (far_from_data(ball, (1, 1, 2), end) for end in (above, below))
    assert sum(each**2 for each in cut) == pytest.approx(far_from_data(ball, (1, 1, 2)) ** 2, rel=0.05)


def test_between_several_surfaces_a_fold_is_worse_than_noise(monkeypatch):
    walls = [trial(surfaces=("endo", "epi")), trial(surfaces=("endo", "epi"))]
    found, limits = certified(monkeypatch, walls, [0.1, 0.1], [[0.4, 0.3], [0.35]])
    assert found == (0, 0.3) and limits == [np.inf, np.inf]
    assert certified(monkeypatch, walls, [0.1, 0.1], [[0.4], [0.12]])[0] == (1, 0.12)


@pytest.mark.parametrize(
    ("sigma", "found", "robust", "expected"),
    [
        (0.01, "one", True, "one"),
        (0.06, None, True, "regularised"),
        (0.06, None, False, "regularised"),
        (0.04, None, True, "unweighted"),
        (0.04, None, False, "folded"),
    ],
)
def test_without_a_start_that_is_free_of_folds_others_are_tried(monkeypatch, sigma, found, robust, expected):
    """A poor fit with more regularisation, another without robust weights."""
    calls = []
    folded, found = SimpleNamespace(sigma=sigma, box="box"), found and SimpleNamespace(name=found, sigma=1.5 * sigma)
    others = {name: SimpleNamespace(name=name, sigma=sigma) for name in ("regularised", "unweighted")}

    def first_and_best(given, starts, shape, largest=None):
        calls.append(largest)
        first = refine.Attempt(SimpleNamespace(problem="p", surfaces="s"), folded)
        best = found if len(calls) == 1 else others["unweighted"]
        return first, refine.Attempt("trial", best) if best else None

    class Local:
        options = SimpleNamespace(robust=robust)

    monkeypatch.setattr(refine, "_first_and_best", first_and_best)
    monkeypatch.setattr(refine, "least_regularised", lambda *of: others["regularised"])
    monkeypatch.setattr(refine, "replace", lambda of, **more: of)
    monkeypatch.setattr(refine, "folding", lambda model: {"FOLDING": "x"})
    monkeypatch.setattr(refine, "DeformableModel", lambda *of: "model")
    monkeypatch.setattr(refine, "_result", lambda attempt, warnings: (attempt.refined, warnings))
    result, warnings = refine._best_start(Local, [], None)
    assert getattr(result, "name", "folded") == expected
    assert warnings == ({"FOLDING": "x"} if expected == "folded" else {})
    assert calls == ([None, pytest.approx(0.06)] if expected == "unweighted" else [None])


@pytest.mark.parametrize(("sigma", "is_poor"), [(0.06, False), (0.0601, True)])
def test_surfaces_without_folds_much_farther_from_the_points_are_a_poor_fit(monkeypatch, sigma, is_poor):
    """Of several surfaces at half as much noise again: any noise is accepted for them."""
    first = refine.Attempt(SimpleNamespace(problem="p", surfaces="s"), SimpleNamespace(sigma=0.04))
    best = refine.Attempt("trial", SimpleNamespace(sigma=sigma))
    monkeypatch.setattr(refine, "_first_and_best", lambda *of: (first, best))
    monkeypatch.setattr(refine, "_result", lambda attempt, warnings: warnings)
    assert ("POOR_FIT" in refine._best_start(None, [], None)) == is_poor


@pytest.mark.parametrize(
    ("errors", "side", "poor"), [([0.1], 3, False), ([0.2, 0.1], 5, False), ([0.4, 0.3, 0.11], 7, True)]
)
def test_a_box_is_as_small_as_its_error_allows(monkeypatch, errors, side, poor):
    sides, left = [], iter(errors)
    result = SimpleNamespace(sigma=0.05, warnings={})
    monkeypatch.setattr(refine, "_best_start", lambda problem, starts, shape: sides.append(shape) or result)
    monkeypatch.setattr(refine, "_error", lambda *of: next(left))
    monkeypatch.setattr(refine, "replace", lambda of, warnings: warnings)
    given = SimpleNamespace(warm_start=None, max_error=0.1, clouds={}, weights={}, options=None)
    found = refine.refine_tangent(given, {}, None)
    assert sides == [(n, n, n) for n in (3, 5, 7) if n <= side]
    if poor:
        assert found["POOR_FIT"].startswith("no box up to 7 control points a side reached max_error")
        assert "1.10 times it" in found["POOR_FIT"] and "0.50 times" in found["POOR_FIT"]
    else:
        assert found is result


def test_the_error_is_the_rms_distance_of_the_inliers_each_counted_as_often_as_it_was_given():
    """Old fault: copies of a point, which are merged into its weight, counted once."""
    model = SimpleNamespace(distance=lambda cloud, name: cloud[:, 0] * (2 if name == "b" else 1))
    clouds = {"a": np.array([[1.0], [3.0]]), "b": np.array([[2.0]])}
    result = SimpleNamespace(model=model, inliers={"a": np.array([1.0, 0.5]), "b": np.array([0.25])})
    ones = {"a": np.ones(2), "b": np.ones(1)}
    assert refine._error(result, clouds, ones) == pytest.approx(np.sqrt((1 + 4.5 + 4) / 1.75))
    weights = {"a": np.array([1.0, 2.0]), "b": np.array([4.0])}
    assert refine._error(result, clouds, weights) == pytest.approx(np.sqrt((1 + 9 + 16) / 3))


def data(points):
    return SurfaceData.of(SURFACE, points, np.ones(len(points)))


def test_foot_points_of_all_points_begin_at_those_of_the_nearest_few():
    few = SURFACE.surface(even_directions(40))
    part = replace(data(few), origins=SURFACE.surface(even_directions(40)[::-1]))
    points = 1.05 * SURFACE.surface(even_directions(90))
    found = stages._first_origins(data(points), part)
    nearest = [int(np.linalg.norm(few - p, axis=1).argmin()) for p in points]
    np.testing.assert_allclose(found, part.origins[nearest], atol=1e-9)
    twice = replace(data(np.repeat(few[:20], 2, axis=0)), origins=part.origins)
    middle = (part.origins[0] + part.origins[1]) / 2
    tied = stages._first_origins(data(few[:20]), twice)
    np.testing.assert_allclose(tied[0], SURFACE.project(middle[None])[0], atol=1e-9)


@pytest.mark.parametrize(("factor", "kept"), [(1.01, False), (0.99, True)])
def test_coarse_stages_that_lead_away_are_left_out(monkeypatch, factor, kept):
    """Compared by the squared distances to the undeformed surface and to the deformed one."""
    box = ControlBox.around(SURFACE, (3, 3, 3))
    of = data(1.1 * SURFACE.surface(even_directions(50))).with_nearest_foot_points(box)
    before = (of.distances(box) ** 2).sum()
    monkeypatch.setattr(
        SurfaceData, "distances", lambda self, b: np.sqrt(np.full(50, before / 50 * (1 if b is not box else factor)))
    )
    monkeypatch.setattr(stages, "warm_start", lambda problem, datasets, undeformed, found: "warm")
    found = SimpleNamespace(box=box, datasets=(of,))
    assert stages._not_worse(SimpleNamespace(box=box), found, [of]) is (found if kept else "warm")


def test_details_are_sought_while_patches_left_out_are_predicted_better(monkeypatch):
    strengths, runs = iter([1e-3, 1e-4, None, 1e-9]), []

    class Ran:
        def __init__(self, strength):
            self.strength = strength

        def run(self, start):
            runs.append(self.strength)
            return state(0.5)

    def state(fraction):
        solution = SimpleNamespace(effective_fraction=fraction)
        return SimpleNamespace(box=None, datasets=(), solution=solution, sigma=0.1, history=())

    monkeypatch.setattr(stages, "better_strength", lambda problem, found: next(strengths))
    monkeypatch.setattr(stages, "_stage", lambda problem, rounds: Ran((problem, rounds)))
    monkeypatch.setattr(stages, "replace", lambda problem, strength: strength)
    stages.with_details("problem", state(0.5))
    assert runs == [(1e-3, 3), (1e-4, 3)]
    independent = state(1)
    assert stages.with_details("problem", independent) is independent and len(runs) == 2
    strengths = iter([0.5, 0.4, 0.3, 0.2])
    stages.with_details("problem", state(0.5))
    assert len(runs) == 5  # three searches at most


@pytest.mark.parametrize(("n", "runs"), [(3000, [(3000, 10)]), (3001, [(3000, 10), (3001, 3)])])
def test_many_points_come_after_fewer_of_them(monkeypatch, n, runs):
    log = []

    class Ran:
        def __init__(self, rounds):
            self.rounds = rounds

        def run(self, datasets):
            log.append((len(datasets[0].points), self.rounds))
            return SimpleNamespace(solution=SimpleNamespace(strength=1e-3))

    sampled = lambda count, robust: SimpleNamespace(points=range(count))  # noqa: E731
    datasets = [SimpleNamespace(points=range(n), subsample=sampled)]
    coarse = SimpleNamespace(box=None, datasets=(), history=())
    monkeypatch.setattr(stages, "_on_points", lambda state, datasets, coarse: datasets)
    monkeypatch.setattr(stages, "_stage", lambda problem, rounds: Ran(rounds))
    stages.fine_stage(SimpleNamespace(strength=1e-3), datasets, coarse)
    assert log == runs
    with pytest.raises(OptionError, match=r"largest at 1\.0e-03"):
        stages.fine_stage(SimpleNamespace(strength=1e-9), datasets, coarse)
