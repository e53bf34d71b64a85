"""Rays of a sensor that met nothing, and planes below a body: what a body must not contain, on a ball and a box."""

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import turned

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import candidates
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.empty_space import EmptySpace, empty_space
from quadriform.fitting.superquadric.surroundings import Surroundings
from quadriform.points import unit_vectors

EYE = np.array([0.0, 0, 10])
MIXTURE = Mixture(np.array([0.9]), np.array([0.05]))
POINTS = random_directions(6000, 1)
BALL = POINTS[POINTS @ EYE > 1.0]
"""The part of the unit ball that faces the sensor."""


def cost(empty, at=(0.0, 0, 0), size=1.0):
    """What a ball loses."""
    return float(
        empty.penalty(Candidates.of([qf.Superquadric("ellipsoid", 3 * [size], translation=at)]), MIXTURE).cost[0]
    )


def seen(points, of_ball=None):
    """Empty space of what was seen from the sensor."""
    of_ball = np.ones(len(points), dtype=bool) if of_ball is None else of_ball
    return empty_space(Surroundings(np.broadcast_to(EYE, points.shape)), points, of_ball)


def board(count, rng):
    """Points of a board between the sensor and the right half of the ball."""
    return rng.uniform([0, -2, 3], [2, 2, 3], (count, 3))


def test_the_penalty_has_its_derivatives(rng):
    empty = EmptySpace(rng.uniform(-1.2, 1.2, (50, 4, 3)), rng.uniform(1, 2, 50))
    ball = Candidates.of([qf.Superquadric("ellipsoid", (0.9, 1.0, 1.1))])
    terms = empty.penalty(ball, MIXTURE)
    for index in [0, 1, 2, 8, 9, 10]:
        step = np.zeros((1, 11))
        step[0, index] = 1e-5
        more, less = (empty.penalty(ball.moved(s, 10.0), MIXTURE).cost[0] for s in (step, -step))
        expected = terms.gradient[0, index] / MIXTURE.sigma[0] ** 2
        assert (more - less) / 2e-5 == pytest.approx(
            expected, rel=0.05, abs=0.02 * np.abs(terms.gradient).max() / 0.05**2
        )
    assert (np.linalg.eigvalsh(terms.matrix[0]) > -1e-9).all()
    assert empty.of_sample(0.5).penalty(ball, MIXTURE).cost == pytest.approx(terms.cost / 2)


def test_a_ball_is_where_it_was_seen_and_not_where_nothing_was():
    empty = seen(BALL)
    assert cost(empty) == 0 and cost(empty, (0, 0, -0.3), 0.9) == 0  # behind what was seen
    assert cost(empty, size=1.3) > 50 and cost(empty, (0.4, 0, 0)) > 50


def test_what_is_nearer_hides_also_where_it_was_thinned_out(rng):
    hidden = BALL[BALL[:, 0] < 0]
    for count in (200, 3000):
        points = np.concatenate([hidden, board(count, rng)])
        empty = seen(points, np.arange(len(points)) < len(hidden))
        assert cost(empty) == 0 and cost(empty, (0.2, 0, 0)) == 0
        assert cost(empty, (-0.5, 0, 0)) > 50
    assert cost(seen(hidden)) > 50  # with nothing before it the right half would have been seen


def test_of_several_positions_each_sees_its_own():
    other = BALL @ np.diag([1.0, -1, -1])
    points = np.concatenate([BALL, other])
    eyes = np.concatenate([np.broadcast_to(EYE, BALL.shape), np.broadcast_to(-EYE, other.shape)])
    empty = empty_space(Surroundings(eyes), points, np.ones(len(points), dtype=bool))
    assert cost(empty) == 0 and cost(empty, (0, 0, -0.6), 1.2) > 50
    few = Surroundings(eyes + 1e-3 * points)  # every point from another position
    assert empty_space(few, points, np.ones(len(points), dtype=bool)) is None


def test_a_ball_does_not_pass_the_plane_below_it():
    at, normal = np.array([5.0, 5, -1]), np.array([0.0, 0, 1])
    empty = empty_space(Surroundings(None, (at, normal)), BALL, np.ones(len(BALL), dtype=bool))
    assert cost(empty) == pytest.approx(0, abs=1e-9) and cost(empty, (0, 0, 0.5)) == 0
    assert cost(empty, (0, 0, -0.3)) > 50


def strip(rng, count=6000):
    """Two faces of a long box, seen along its ends, with noise along the ray."""
    box = np.array([1.5, 0.6, 0.5])
    points = rng.uniform(-1, 1, (count, 3))
    points[np.arange(count), rng.integers(1, 3, count)] = 1.0
    points, eye = points * box, np.array([0.0, 6, 6])
    return points + 0.01 * rng.normal(size=(count, 1)) * unit_vectors(points - eye), eye, box


def test_a_box_is_no_longer_than_the_sensor_saw_it(rng, monkeypatch):
    points, eye, box = strip(rng)
    monkeypatch.setattr(candidates, "SIZE_PENALTY", 0.0)
    found = qf.fit_superquadric(points, viewpoint=eye).superquadric
    along = np.argmax(np.abs(found.rotation[0]))
    assert found.semi_axes[along] == pytest.approx(box[0], rel=0.1)
    rotation = turned(3)
    moved = qf.fit_superquadric(10 * points @ rotation.T + 5, viewpoint=10 * rotation @ eye + 5).superquadric
    np.testing.assert_allclose(np.sort(moved.semi_axes), 10 * np.sort(found.semi_axes), rtol=0.02)


def test_a_box_ends_at_the_plane_on_which_it_stands(rng):
    points, _, box = strip(rng)
    high = points[points[:, 2] > 0]  # the lower half of the front is hidden
    found = qf.fit_superquadric(high, support=((0, 0, -box[2]), (0, 0, 1)))
    assert found.superquadric.mesh(32).vertices[:, 2].min() > -box[2] - 0.05


def test_a_fit_takes_both():
    plane = ((0, 0, -1), (0, 0, -3))  # of any length and sign: the body is where the points are
    found = qf.fit(BALL, viewpoint=EYE, support=plane, box=(3, 3, 3))
    named = qf.fit({"a": BALL}, viewpoint={"a": EYE}, support=plane, box=(3, 3, 3))
    np.testing.assert_array_equal(found.model.mesh(resolution=8).vertices, named.model.mesh("a", 8).vertices)


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("viewpoint", (1, 2), "expected"),
        ("viewpoint", np.ones((5, 3)), "5 positions for"),
        ("viewpoint", (np.nan, 0, 0), "finite"),
        ("viewpoint", "above", "viewpoint"),
        ("viewpoint", (0, 0, 0), "lies among the points"),
        ("support", (0, 0, 1), "point, normal"),
        ("support", ((0, 0, 1), (0, 0, 0)), "zero"),
        ("support", ((0, 0, 0.5), (0, 0, 1)), "beyond the plane"),
        ("support", ((0, 0), (0, 0, 1)), "support"),
    ],
)
def test_what_no_sensor_or_support_can_be_is_refused(option, value, text):
    for fit in (qf.fit, qf.fit_superquadric):
        with pytest.raises(OptionError, match=text):
            fit(BALL, **{option: value})
        with pytest.raises(OptionError, match="paper"):
            fit(BALL, method="paper", viewpoint=EYE)
