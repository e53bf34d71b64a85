"""Rules of the rounds of a refinement: how many points count, when a stage ends, and how strengths are recorded."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.fitting.refinement import stage as stages
from quadriform.fitting.refinement.point_to_plane import displaced, probes
from quadriform.fitting.refinement.stage import (
    Problem,
    Report,
    Stage,
    StoppingRule,
    independent_fraction,
    tangential_steps,
)
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.control_box import ControlBox

SURFACE = replace(made(exponents=(1, 1), semi_axes=(1.2, 0.9, 0.8)), translation=np.zeros(3))
BOX = ControlBox.around(SURFACE, (3, 3, 3))


def data(n=80, bump=0.05, seed=1):
    rng = np.random.default_rng(seed)
    points = SURFACE.surface(even_directions(n)) * (1 + bump * np.sin(3 * even_directions(n)[:, :1]))
    return SurfaceData.of(SURFACE, points + 0.01 * rng.normal(size=(n, 3)), np.ones(n)).with_nearest_foot_points(BOX)


@pytest.mark.parametrize(
    ("least", "found", "first", "later"), [(20, 0.1, 0.25, 0.25), (20, 0.9, 0.25, 0.9), (200, 0.5, 1, 1)]
)
def test_at_least_as_many_points_count_as_there_are_unknowns(monkeypatch, least, found, first, later):
    monkeypatch.setattr(stages, "effective_fraction_of_data", lambda datasets, box: found)
    datasets = (SimpleNamespace(total_weight=50.0), SimpleNamespace(total_weight=30.0))
    assert independent_fraction(datasets, None, least) == first and independent_fraction(datasets, BOX, least) == later


def test_at_first_the_noise_is_that_of_the_median_distance_of_all_surfaces():
    of = (data(), data(30, 0.2))
    distances = np.concatenate([each.standardised_distances(BOX) for each in of])
    sigma = 1.4826 * np.median(distances)
    robust, plain = (replace(stage(1, 0.0)[0].problem, robust=each) for each in (True, False))
    for noise, used in ((None, sigma), (0.3, 0.3)):
        for found, each in zip(robust.weighting.weighted(BOX, of, noise), of):
            np.testing.assert_array_equal(
                found.inliers, each.with_inliers_at_distances(each.standardised_distances(BOX), used).inliers
            )
    assert plain.weighting.weighted(BOX, of, None) is of


def stage(rounds, motion, strength=1e-3):
    log = []
    problem = Problem(BOX, probes([SURFACE]), "bending", strength, False, Report(lambda *of: log.append(of), 9))
    return Stage(problem, tangential_steps, problem.weighting, StoppingRule(rounds, motion)), log


def test_a_stage_ends_after_its_rounds_or_where_the_surface_is_still():
    start = stages.InitialState(BOX, (data(),))
    of, log = stage(4, 0.0)
    found = of.run(start)
    assert len(found.history) == 4 and log == [(k, 9) for k in range(1, 5)]
    motions = [each.surface_motion / found.sigma for each in found.history]
    between = (motions[1] + motions[2]) / 2
    sooner, _ = stage(4, between)
    assert len(sooner.run(start).history) == next(k + 1 for k, m in enumerate(motions) if m < between)
    once, _ = stage(1, 0.0)
    first = once.run(start)
    np.testing.assert_array_equal(first.box.control_points, displaced(BOX, first.solution).control_points)
    assert first.sigma == first.solution.sigma and len(first.history) == 1


class Towards:
    """A penalty on the distance of the control points from given ones, which its equations overstate."""

    def __init__(self, box, target, weight, wrong=1.0):
        self.box, self.target, self.weight, self.wrong = box, target, weight, wrong

    def equations(self, box):
        k = self.target.size
        rows = np.eye(k)
        at = (self.wrong * self.target).ravel()
        return stages.NormalEquations.of_rows(rows, at, self.weight)

    def cost(self, box):
        return self.weight * float((((box.control_points - box.rest) - self.target) ** 2).sum())


@pytest.mark.parametrize(("wrong", "length"), [(1.0, 1.0), (3.5, 0.5)])
def test_a_step_under_a_penalty_is_halved_where_the_sum_would_grow(wrong, length):
    of, _ = stage(1, 0.0)
    state = of.run(stages.InitialState(BOX, (data(),)))
    target = 0.02 * np.random.default_rng(3).normal(size=BOX.control_points.shape)
    penalty = Towards(BOX, target, 1e6, wrong)
    found = of.problem.penalised(state, penalty, 1e-3)
    whole = displaced(state.box, found.solution).control_points
    expected = state.box.control_points + length * (whole - state.box.control_points)
    np.testing.assert_allclose(found.box.control_points, expected, rtol=1e-12)
    assert len(found.history) == 2 and found.solution.strength == 1e-3
    shift = found.box.control_points - found.box.rest
    np.testing.assert_allclose(shift if wrong == 1 else target, target, atol=1e-5)
