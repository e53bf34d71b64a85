"""Stages of the refinement: steps return new states, and stopping rules end them."""

from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions

from quadriform.fitting.refinement import stages
from quadriform.fitting.refinement.stage import (
    FixedWeights,
    InitialState,
    MixtureWeights,
    Problem,
    Report,
    Stage,
    StoppingRule,
    nearest_foot_points,
    tangential_steps,
)
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

BALL = Superquadric()
POINTS = even_directions(400) * [1.2, 1.0, 0.9]


@pytest.fixture
def problem():
    return Problem(ControlBox.around(BALL, (3, 3, 3)), BALL.grid(4)[0], "bending", None, False, Report(None, 1))


@pytest.fixture
def start(problem):
    data = SurfaceData.of(BALL, POINTS, np.ones(len(POINTS))).with_nearest_foot_points(problem.box)
    return InitialState(problem.box, (data,))


@pytest.mark.parametrize("foot_points", [tangential_steps, nearest_foot_points])
@pytest.mark.parametrize("weighting", [FixedWeights(), MixtureWeights()])
def test_a_step_leaves_its_state_as_it_was(problem, start, foot_points, weighting):
    """Old design: foot points and inliers of the caller changed, so that the order of calls mattered."""
    stage, (data,) = Stage(problem, foot_points, weighting), start.datasets
    origins, inliers = data.origins.copy(), data.inliers.copy()
    one, other = stage.step(start), stage.step(start)
    np.testing.assert_array_equal(one.box.control_points, other.box.control_points)
    np.testing.assert_array_equal(data.origins, origins)
    np.testing.assert_array_equal(data.inliers, inliers)
    assert start.history == () and len(one.history) == 1


def test_a_stage_ends_by_its_motion_or_after_its_rounds(problem, start):
    made = [Stage(problem, tangential_steps, stop=StoppingRule(5, motion)) for motion in (0.0, np.inf)]
    assert [len(stage.run(start).history) for stage in made] == [5, 1]


def test_rounds_are_counted_for_the_caller(problem, start):
    counts = []
    report = Report(lambda done, total: counts.append((done, total)), 7)
    problem = Problem(problem.box, problem.probes, "bending", None, False, report)
    Stage(problem, tangential_steps, stop=StoppingRule(3)).run(start)
    assert counts == [(1, 7), (2, 7), (3, 7)]


@pytest.mark.parametrize("intersecting", range(6))
def test_coarse_stages_that_intersect_themselves_are_repeated_with_correlated_errors_and_on_other_points(
    monkeypatch, intersecting
):
    """Old fault: a surface followed displaced slices from the start, folded, and amplified rounding to millimetres."""
    used = []

    def coarse(problem, first, sample, independent=stages.all_independent):
        used.append((first, sample, independent))
        number = len(used)
        return SimpleNamespace(number=number, crosses_though_covered=number <= intersecting)

    monkeypatch.setattr(stages, "coarse_stages", coarse)
    monkeypatch.setattr(stages, "first_stage", lambda problem, sample: f"first of {sample}")
    monkeypatch.setattr(stages.Subsample, "of", lambda datasets, count, robust: count)
    monkeypatch.setattr(stages, "_not_worse", lambda problem, state, datasets: state)
    box = ControlBox.around(BALL, (3, 3, 3))
    found = stages.all_coarse_stages(SimpleNamespace(box=box, robust=True), "given", [])
    firsts = ("given", 1000), ("first of 700", 700), ("first of 1500", 1500)
    rules = stages.all_independent, stages.independent_fraction
    expected = [(*first, rule) for first in firsts for rule in rules]
    assert used == expected[: intersecting + 1] and found.number == len(used)
