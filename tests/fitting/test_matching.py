"""Step 1: both closest-point directions on cases small enough to do by hand."""

import numpy as np
import pytest
from shapes_made import even_directions, turned

from quadriform.fitting.paper.displacement import data_to_model, model_to_data

LINE = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0]])


def test_each_data_point_attracts_its_closest_model_point():
    data = np.array([[0.0, 1, 0], [10, -2, 0], [20, 0, 3]])
    np.testing.assert_allclose(data_to_model(LINE, data), [[0, 1, 0], [0, -2, 0], [0, 0, 3]])


def test_several_data_points_displace_by_their_mean():
    data = np.array([[0.0, 1, 0], [1, 3, 0], [10, 0, 0], [20, 0, 0]])
    np.testing.assert_allclose(data_to_model(LINE, data), [[0.5, 2, 0], [0, 0, 0], [0, 0, 0]])


def test_a_model_point_without_data_takes_the_inverse_distance_mean():
    """Distances 10 and 30 from the third point: weights 3/4 and 1/4."""
    model = np.array([[0.0, 0, 0], [40, 0, 0], [10, 0, 0]])
    data = np.array([[0.0, 4, 0], [40, 0, 8]])
    np.testing.assert_allclose(data_to_model(model, data)[2], [0, 3, 2], rtol=1e-12)


def test_only_the_four_nearest_count():
    model = np.array([[1.0, 0, 0], [-2, 0, 0], [0, 4, 0], [0, -5, 0], [0, 0, 6], [0, 0, 0]])
    data = model[:5] + np.array([[0, 0, 1], [0, 0, 2], [0, 0, 3], [0, 0, 4], [0, 0, 99]])
    weights = np.array([1, 1 / 2, 1 / 4, 1 / 5])
    assert data_to_model(model, data)[5, 2] == pytest.approx(weights @ [1, 2, 3, 4] / weights.sum(), rel=1e-12)
    nearest = data_to_model(model, data, neighbours=1)[5]
    np.testing.assert_allclose(nearest, [0, 0, 1], rtol=1e-12)


def test_neighbours_as_near_as_the_fourth_count_alike():
    """Six model points at one distance: the middle one takes the mean of all, whatever their order."""
    model = np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3))])
    pull = np.random.default_rng(0).normal(size=(6, 3)) * 0.1
    for order in (np.arange(6), np.array([5, 3, 1, 0, 2, 4])):
        shuffled = np.concatenate([model[:6][order], model[6:]])
        found = data_to_model(shuffled, shuffled[:6] + pull[order])
        np.testing.assert_allclose(found[6], pull.mean(axis=0), rtol=1e-12)


def test_the_other_direction_takes_the_closest_data_point():
    data = np.array([[0.0, 1, 0], [12, 0, 0]])
    np.testing.assert_allclose(model_to_data(LINE, data), [[0, 1, 0], [2, 0, 0], [-8, 0, 0]])


@pytest.mark.parametrize("match", [data_to_model, model_to_data])
def test_data_on_the_model_moves_nothing(match, rng):
    model = even_directions(200)
    np.testing.assert_array_equal(match(model, model[rng.permutation(200)]), np.zeros((200, 3)))


@pytest.mark.parametrize("match", [data_to_model, model_to_data])
def test_displacements_turn_with_the_points_and_not_with_their_order(match, rng):
    model, data = even_directions(150), 1.2 * even_directions(90) + 0.05 * rng.normal(size=(90, 3))
    turn, found = turned(2), match(model, data)
    np.testing.assert_allclose(match(model @ turn.T + 3, data @ turn.T + 3), found @ turn.T, atol=1e-12)
    np.testing.assert_allclose(match(model, data[rng.permutation(90)]), found, atol=1e-14)


def test_displacements_leave_along_the_normal():
    """Few model points, many data points off the surface: the mean pull is along the radius, as the paper wants."""
    model = even_directions(100)
    pull = data_to_model(model, 1.3 * even_directions(20000))
    cosine = (pull * model).sum(axis=1) / np.linalg.norm(pull, axis=1)
    assert cosine.min() > 0.99
