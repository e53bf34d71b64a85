"""Stages of the refinement: steps return new states, and stopping rules end them."""

import numpy as np
import pytest
from shapes_made import even_directions

from quadriform.fitting.refinement.stage import (
    FixedWeights,
    InitialState,
    MixtureWeights,
    Nearest,
    Problem,
    Report,
    Stage,
    StoppingRule,
    TangentialSteps,
)
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

BALL = Superquadric()
POINTS = even_directions(400) * [1.2, 1.0, 0.9]


@pytest.fixture
def problem():
    return Problem(ControlBox.around(BALL, (3, 3, 3)), BALL.grid(4)[0], "bending", None, True, Report(None, 1))


@pytest.fixture
def start(problem):
    data = SurfaceData.of(BALL, POINTS, np.ones(len(POINTS))).with_nearest_foot_points(problem.box)
    return InitialState(problem.box, (data,))


@pytest.mark.parametrize("foot_points", [TangentialSteps(), Nearest()])
@pytest.mark.parametrize("weighting", [FixedWeights(), MixtureWeights()])
def test_a_step_leaves_its_state_as_it_was(problem, start, foot_points, weighting):
    """Old design: foot points and inliers of the caller changed, so that the order of calls mattered."""
    stage, (data,) = Stage(problem, foot_points, weighting, StoppingRule(1)), start.datasets
    origins, inliers = data.origins.copy(), data.inliers.copy()
    one, other = stage.step(start), stage.step(start)
    np.testing.assert_array_equal(one.box.control_points, other.box.control_points)
    np.testing.assert_array_equal(data.origins, origins)
    np.testing.assert_array_equal(data.inliers, inliers)
    assert start.history == () and len(one.history) == 1


def test_a_stage_ends_by_its_motion_or_after_its_rounds(problem, start):
    stages = [Stage(problem, TangentialSteps(), FixedWeights(), StoppingRule(5, motion)) for motion in (0.0, np.inf)]
    assert [len(stage.run(start).history) for stage in stages] == [5, 1]


def test_rounds_are_counted_for_the_caller(problem, start):
    counts = []
    report = Report(lambda done, total: counts.append((done, total)), 7)
    problem = Problem(problem.box, problem.probes, "bending", None, True, report)
    Stage(problem, TangentialSteps(), FixedWeights(), StoppingRule(3)).run(start)
    assert counts == [(1, 7), (2, 7), (3, 7)]
