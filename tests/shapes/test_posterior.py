"""Samples of the posterior of a model: units, frames of the world, times, and boxes with more control points."""

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric

SURFACE = Superquadric("ellipsoid", (3, 2, 1), (1, 1), np.eye(3), (0.5, 0, 0))
KNOTS = TimeBasis(np.arange(4.0), 4.0)


@pytest.fixture
def box():
    return ControlBox.around(SURFACE, (3, 3, 3))


@pytest.fixture
def still(box, rng):
    return DeformableModel(
        {"surface": SURFACE}, box, space="LPS", posterior=Posterior(rng.normal(size=(5, 3, 3, 3, 3)))
    )


@pytest.fixture
def moving(box, rng):
    control = box.rest + 0.1 * rng.normal(size=(4, *box.rest.shape))
    posterior = Posterior(rng.normal(size=(5, *control.shape)), "hash")
    return MovingModel(
        {"surface": SURFACE}, box.origin, box.edges, KNOTS, control, space="LPS", unit="mm", posterior=posterior
    )


def control_points(models):
    return np.stack([model.box.control_points for model in models])


def test_samples_deviate_from_the_estimate_as_stated(still):
    expected = still.box.control_points + still.posterior.deviations
    np.testing.assert_allclose(control_points(still.samples()), expected)
    np.testing.assert_allclose(control_points(still.samples(0.5)), (still.box.control_points + expected) / 2)
    assert all(sample.posterior is None for sample in still.samples())
    assert len(still.posterior) == 5


def test_samples_go_with_the_model_to_other_units_and_frames(still):
    scaled = still.transformed(2.0, np.array([1.0, 2, 3]))
    np.testing.assert_allclose(
        control_points(scaled.samples()), 2 * control_points(still.samples()) + [1, 2, 3], atol=1e-5
    )
    other = still.in_space("RAS")
    np.testing.assert_allclose(
        control_points(other.samples()), control_points(still.samples()) * [-1, -1, 1], atol=1e-5
    )


def test_the_samples_of_a_motion_at_a_time_are_its_sampled_motions_then(moving):
    weights = KNOTS.values(np.array([1.3]))[0]
    expected = np.einsum("k,nk...->n...", weights, moving.control_points + moving.posterior.deviations)
    found = moving.at(1.3)
    np.testing.assert_allclose(control_points(found.samples()), expected, atol=1e-5)
    assert found.posterior.source == "hash"
    other = moving.transformed(2.0, np.zeros(3)).in_space("RAS").at(1.3)
    np.testing.assert_allclose(control_points(other.samples()), 2 * expected * [-1, -1, 1], atol=1e-5)


def test_samples_may_have_more_control_points_than_the_estimate(still, rng):
    deviations = 0.1 * rng.normal(size=(2, 4, 5, 3, 3))
    model = DeformableModel(still.surfaces, still.box, posterior=Posterior(deviations))
    points = rng.uniform(-1, 1, (20, 3))
    for sample, each in zip(model.samples(), deviations):
        shift = sample.box.matrix(points) @ each.reshape(-1, 3)
        np.testing.assert_allclose(sample.deform(points), model.deform(points) + shift, atol=1e-5)


@pytest.mark.parametrize("wrong", [np.zeros((2, 3, 3, 3)), np.zeros((0, 3, 3, 3, 3)), np.full((2, 3, 3, 3, 3), np.nan)])
def test_what_are_no_samples_is_refused(wrong):
    with pytest.raises(OptionError, match="deviations"):
        Posterior(wrong)


def test_samples_of_another_motion_are_refused(moving, rng):
    with pytest.raises(OptionError, match="posterior"):
        MovingModel(
            moving.surfaces, moving.origin, moving.edges, KNOTS, moving.control_points,
            posterior=Posterior(rng.normal(size=(5, 3, 3, 3, 3, 3))),
        )  # fmt: skip
