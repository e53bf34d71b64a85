"""The Gaussian of a prior: its precision, its scores, and fields that cannot be one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from priors_made import meshes

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.shapes.bending import Bending


@cache
def prior():
    return qf.learn_prior(meshes(), box=(3, 4, 3), unit="mm")


def displacement_of(model):
    return (model.box.control_points - model.box.rest).reshape(-1, 3)


@pytest.mark.parametrize("freedom", [1e-4, 1.0, 1e4])
def test_precision_times_covariance_is_the_identity(freedom):
    one = replace(prior(), freedom=freedom)
    flat = one.modes.reshape(len(one.modes), -1)
    rigidity = Bending.matrix((3, 4, 3)) + one.metric
    covariance = (flat.T * one.variances) @ flat + freedom * np.kron(np.linalg.inv(rigidity), np.eye(3))
    product = one.precision() @ covariance
    np.testing.assert_allclose(product, np.eye(len(product)), atol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_precision_has_the_unit_of_an_inverse_square(scale):
    one = prior()
    other = replace(one, mean=scale * one.mean, variances=scale**2 * one.variances, freedom=scale**2 * one.freedom)
    np.testing.assert_allclose(other.precision() * scale**2, one.precision(), rtol=1e-6, atol=1e-9)


def test_along_a_mode_the_precision_is_that_of_its_variance():
    one = prior()
    dual = np.linalg.inv(one.precision())
    for mode, variance in zip(one.modes, one.variances):
        along = (one.metric @ mode).ravel()  # the functional that is 1 for this mode and 0 for the others
        assert along @ dual @ along == pytest.approx(variance, rel=1e-3)


def test_scores_of_a_shape_are_those_that_it_was_made_of():
    given = np.array([0.5, -1.2, 2.0])
    found = displacement_of(prior().model(given))
    np.testing.assert_allclose(prior().scores(found), given, atol=1e-9)
    assert prior().distance(found) == pytest.approx(np.linalg.norm(given))


def test_the_mean_has_no_score_and_no_distance():
    assert prior().distance(prior().mean) == 0
    np.testing.assert_allclose(displacement_of(prior().mean_model()), prior().mean, atol=1e-12)


def test_modes_are_orthonormal_over_the_surface():
    flat = prior().modes.reshape(3, -1)
    np.testing.assert_allclose(flat @ np.kron(prior().metric, np.eye(3)) @ flat.T, np.eye(3), atol=1e-9)


def test_it_is_shown_in_a_few_lines():
    text = repr(prior())
    assert text.startswith("ShapePrior: 3 modes of 8 models, 3 x 4 x 3 control points") and len(text.splitlines()) < 5


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (lambda p: {"mean": p.mean[:-1]}, "mean: expected"),
        (lambda p: {"modes": p.modes[:2]}, "modes: expected"),
        (lambda p: {"modes": 2 * p.modes}, "orthonormal"),
        (lambda p: {"variances": -p.variances}, "variances"),
        (lambda p: {"variances": p.variances[::-1]}, "descending"),
        (lambda p: {"variances": np.zeros(0), "modes": p.modes[:0]}, "variances"),
        (lambda p: {"metric": -p.metric}, "metric"),
        (lambda p: {"metric": p.metric + np.triu(p.metric)}, "metric"),
        (lambda p: {"freedom": 0.0}, "freedom"),
        (lambda p: {"freedom": np.nan}, "freedom"),
        (lambda p: {"n_models": 2}, "n_models"),
        (lambda p: {"surfaces": {}}, "surfaces"),
        (lambda p: {"box": p.model([2.0]).box}, "undeformed"),
        (lambda p: {"report": replace(p.report, modes_99=1)}, "ascending"),
        (lambda p: {"report": replace(p.report, residual=-1.0)}, "residual"),
    ],
)
def test_fields_that_are_no_prior_are_refused(changes, text):
    with pytest.raises(OptionError, match=text):
        replace(prior(), **changes(prior()))


@pytest.mark.parametrize("scores", [[1, 2, 3, 4], [np.nan], [[1.0]]])
def test_scores_that_no_shape_has_are_refused(scores):
    with pytest.raises(OptionError, match="scores"):
        prior().model(scores)


def test_displacements_of_another_box_are_refused():
    with pytest.raises(OptionError, match="displacement"):
        prior().scores(prior().mean[:-1])
