"""What a fit says in the unit of its points, against plain computations from the refinement in its own frame."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, made, single

from quadriform.fitting import fit as fits
from quadriform.fitting import quality
from quadriform.fitting.cloud import Distinct, effective_fraction_of_points
from quadriform.fitting.fit import _Clouds
from quadriform.fitting.noise import variances_along
from quadriform.fitting.result import Iteration, Result
from quadriform.fitting.superquadric.surroundings import Surroundings
from quadriform.fitting.support import Arrangement, covered_fraction, support_of
from quadriform.points import Frame
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane

FRAME = Frame(np.array([10.0, -20, 30]), 5.0)
SURFACE = replace(made(exponents=(0.8, 1.1), semi_axes=(1.2, 0.9, 0.8)), translation=np.zeros(3))
LOCAL = SURFACE.surface(even_directions(150)) * np.random.default_rng(1).uniform(0.97, 1.03, (150, 1))
LOCAL = LOCAL[LOCAL[:, 2] < 0.4]
WORLD = FRAME.to_world(LOCAL)
PLANE = (np.array([0, 0, 0.4]), np.array([0, 0, 1.0]))
INLIERS = np.where(np.arange(len(LOCAL)) % 10 == 0, 0.3, 0.9)


def result(**more):
    rest = ControlBox.around(SURFACE, (3, 3, 3))
    moves = np.random.default_rng(4).normal(0, 0.03, rest.control_points.shape)
    model = single(SURFACE, rest.with_control_points(rest.control_points + moves))
    return Result(model, (Iteration(1.0, 2.0, 3.0, 4.0),), 1e-3, **more)


@pytest.mark.parametrize("half_space", [None, PLANE], ids=["whole", "below a base"])
def test_lengths_of_a_fit_are_in_the_unit_of_the_points(half_space):
    root = np.random.default_rng(5).normal(size=(81, 81))
    of = result(sigma=0.02, covariance=root @ root.T, inliers={"surface": INLIERS}, half_space=half_space)
    found = fits._in_world(of, {"surface": WORLD}, FRAME, {})
    after, before = (
        closest_on(SURFACE, box, LOCAL) for box in (of.model.box, of.model.box.with_control_points(of.model.box.rest))
    )
    np.testing.assert_allclose(found.residuals, 5 * after.signed, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.superquadric_residuals, 5 * before.signed, rtol=1e-6, atol=1e-9)
    assert found.noise == pytest.approx(0.1) and found.history == (Iteration(5.0, 10.0, 15.0, 20.0),)
    np.testing.assert_allclose(found.covariance, 25 * root @ root.T)
    np.testing.assert_allclose(found.model.box.control_points, FRAME.to_world(of.model.box.control_points))
    kept, mesh = INLIERS >= 0.5, of.model.mesh("surface", 32)
    base = None if half_space is None else BasePlane(*half_space)
    support = support_of(mesh, LOCAL[kept], after.points[kept], 0.02, base)
    assert found.support["surface"].area == pytest.approx(support.area)
    assert found.support["surface"].limit == pytest.approx(5 * support.limit)
    covered = covered_fraction(SURFACE, LOCAL[kept], half_space)
    assert found.model.record.coverage["surface"] == pytest.approx(covered)
    assert found.strength == 1e-3 and found.enriched is None
    assert ("PARTIAL_COVERAGE" in found.warnings) == (half_space is None)


def test_without_an_estimate_the_noise_is_the_rms_distance_and_all_are_inliers():
    found = fits._in_world(result(), {"surface": WORLD}, FRAME, {})
    assert found.noise == pytest.approx(np.sqrt((found.residuals**2).mean()))
    np.testing.assert_array_equal(found.inliers, 1)
    assert found.covariance is None


def test_known_noise_counts_along_the_normals_with_its_independent_errors():
    feet = closest_on(SURFACE, ControlBox.around(SURFACE), LOCAL)
    root = 0.01 * np.random.default_rng(2).normal(size=(len(LOCAL), 3, 3))
    noise = root @ np.swapaxes(root, 1, 2)
    known, independent = quality._known_variances(noise, feet, INLIERS)
    np.testing.assert_allclose(known, variances_along(noise, feet.normals))
    fraction = effective_fraction_of_points(feet.points, feet.signed / np.sqrt(known), INLIERS)
    assert independent == pytest.approx(INLIERS.sum() * fraction)
    for missing in (None, noise):
        zeros, many = quality._known_variances(missing, feet, np.zeros(len(LOCAL)) if missing is not None else INLIERS)
        assert not zeros.any() and many == np.inf


def test_points_without_weight_are_of_no_surface():
    counted = np.arange(len(LOCAL)) % 2 == 0
    of = result(counted={"surface": counted})
    feet = {"surface": closest_on(SURFACE, of.model.box, LOCAL)}
    inliers = {"surface": INLIERS}
    support = quality.support_of_each(of, {"surface": LOCAL}, feet, inliers, 0.01, {})
    found = quality.qualities(of, feet, inliers, support, {"surface": LOCAL}, {})["surface"].arrangement
    each = (LOCAL[counted], feet["surface"].points[counted], feet["surface"].signed[counted])
    assert found == Arrangement.of(of.model.mesh("surface", 32), *each, support["surface"].limit)


def clouds(others=None):
    n = np.arange(6.0)
    noise = n[:, None, None] * np.eye(3)
    points, normals = np.arange(18.0).reshape(6, 3), np.arange(18.0).reshape(6, 3) + 1
    eyes = Surroundings(np.arange(18.0).reshape(6, 3) + 2, None)
    masks = {} if others is None else {"a": others}
    return _Clouds({"a": points}, {"a": n + 1}, {"a": normals}, {"a": noise}, ("note",), masks, {"a": eyes})


def test_a_sample_of_clouds_has_all_that_is_known_of_its_points():
    others, index = np.arange(6) > 3, np.array([5, 0, 3])
    of = clouds(others)
    found = of.take({"a": index})
    for name in ("points", "weights", "normals", "noise", "others"):
        np.testing.assert_array_equal(getattr(found, name)["a"], getattr(of, name)["a"][index])
    np.testing.assert_array_equal(found.surroundings["a"].viewpoints, of.surroundings["a"].viewpoints[index])
    assert found.notes == ("note",) and of.take(None) is of


def test_points_of_other_bodies_have_no_weight():
    np.testing.assert_array_equal(clouds(np.arange(6) > 3).weights_of_body["a"], [1, 2, 3, 4, 0, 0])
    np.testing.assert_array_equal(clouds().weights_of_body["a"], np.arange(6) + 1)


def test_probabilities_are_those_of_all_copies():
    rows = np.array([[1.0, 2, 3], [4, 5, 6], [1, 2, 3], [7, 8, 9]])
    weights = np.array([1.0, 2, 3, 0])
    distinct = {"surface": Distinct.of(rows, weights)}
    of = replace(result(), inliers={"surface": np.array([0.25, 0.75])})
    given = _Clouds({"surface": rows}, {"surface": weights}, {}, {}, ())
    found = fits._of_all_points(of, distinct, given)
    assert found.inliers["surface"].tolist() == [0.25, 0.75, 0.25, 0]
    assert found.counted["surface"].tolist() == [True, True, True, False]
