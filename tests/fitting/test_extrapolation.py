"""How well a surface is known without data: on superquadrics whose parameters have known variances."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import seen
from shapes_made import even_directions, lumpy, single

import quadriform as qf
from quadriform.fitting.extrapolation import open_deviations, open_surfaces
from quadriform.fitting.result import Result
from quadriform.fitting.superquadric.candidates import AXES, SHIFT
from quadriform.fitting.superquadric.fit import fit_to_local, fit_to_world
from quadriform.fitting.superquadric.identifiability import surface_at
from quadriform.fitting.support import Reach, Support
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox

BALL, DEVIATION, BOX = qf.Superquadric(), 0.03, (3, 3, 3)
SUPPORT = Support(0.4, 0.4, 0.4, 0.4, 0.2, 1.0, Reach(1.0, 1.0))


def start(parameters, shape=BALL):
    """A fit of which some parameters, alike and independent, are known to `DEVIATION` only, and the others exactly."""
    covariance = np.zeros((11, 11))
    covariance[parameters, parameters] = DEVIATION**2 * np.eye(3)
    return qf.SuperquadricFit(shape, {}, 11, 1.0, covariance, np.ones(20), 0.01, (), 1)


def refined(move=0.0, half_space=None, starts=None):
    """A ball in a box that is moved along z as a whole, whose control points are known exactly."""
    rest = ControlBox.around(BALL, BOX)
    box = rest.with_control_points(rest.rest + np.array([0, 0, move]))
    count = box.rest.size
    return Result(single(BALL, box), (), 1.0, covariance=np.zeros((count, count)), half_space=half_space, starts=starts)


def test_the_surface_varies_as_its_parameters_along_its_normal():
    points = even_directions(200)
    for parameters, expected in ((SHIFT, 1.0), (AXES, (points**4).sum(axis=1))):
        signed, variances = surface_at(BALL, start(parameters).covariance, points)
        np.testing.assert_allclose(signed, 0, atol=1e-12)
        np.testing.assert_allclose(variances, DEVIATION**2 * expected, rtol=1e-6)
    np.testing.assert_allclose(surface_at(BALL, start(SHIFT).covariance, 1.1 * points)[0], 0.1, rtol=1e-9)


def test_without_data_the_superquadric_is_what_is_open():
    points = even_directions(4000)
    points = points[points[:, 2] > 0]
    found = open_deviations(refined(starts={"surface": start(SHIFT)}), {"surface": SUPPORT}, {"surface": points})
    assert found["surface"] == pytest.approx(DEVIATION, rel=1e-6)
    assert not open_deviations(refined(starts={}), {"surface": SUPPORT}, {"surface": points})
    known = replace(SUPPORT, within=0.6)
    assert not open_deviations(refined(starts={"surface": start(SHIFT)}), {"surface": known}, {"surface": points})


def test_what_the_refinement_changed_without_data_is_open():
    points = even_directions(4000)
    points = points[points[:, 2] > -0.2]
    found = open_deviations(refined(-0.1, starts={"surface": start(SHIFT)}), {"surface": SUPPORT}, {"surface": points})
    # the cap below -0.2, but for the limit of support, is moved by 0.1 n_z along its normal
    low = -np.cos(np.arccos(-0.2) + 2 * np.arcsin(SUPPORT.limit / 2))
    mean_square = (1 - low**3) / (3 * (1 - low))
    assert found["surface"] == pytest.approx(np.hypot(DEVIATION, 0.1 * np.sqrt(mean_square)), rel=0.05)


def test_beside_data_nothing_is_added():
    points, frame = even_directions(4000), Frame(np.array([1.0, 2, 3]), 10.0)
    data = points[points[:, 2] > 0]
    found = open_surfaces(refined(starts={"surface": start(SHIFT)}), {"surface": SUPPORT}, {"surface": data}, frame)
    moved = points * [1, 1, 1.1]
    far = points[:, 2] < -SUPPORT.limit
    near = points[:, 2] > 0
    variances = found["surface"].variances(frame.to_world(moved))
    signed, of_ball = surface_at(BALL, start(SHIFT).covariance, moved)
    np.testing.assert_allclose(variances[far], 100 * (of_ball + signed**2)[far], rtol=1e-9)
    assert not variances[near].any() and found["surface"].is_open(frame.to_world(moved))[far].all()
    without = open_surfaces(refined(starts={}), {"surface": SUPPORT}, {"surface": data}, frame)
    assert not without
    no_inliers = open_surfaces(
        refined(starts={"surface": start(SHIFT)}), {"surface": SUPPORT}, {"surface": data[:0]}, frame
    )
    no_covariance = replace(refined(starts={"surface": start(SHIFT)}), covariance=None)
    assert not no_inliers and not open_surfaces(no_covariance, {"surface": SUPPORT}, {"surface": data}, frame)


def test_the_uncertainty_covers_the_error_where_half_a_body_has_no_data():
    """Once it was that of the control points alone, which takes the superquadric as known."""
    truth = lumpy(1000)
    height = truth @ [0.6, 0.7, 0.4]
    found = qf.fit(truth[height > -4])
    alone, error = replace(found, extrapolations={}), np.abs(found.model.distance(truth[height < -8]))
    both, before = (each.uncertainty(truth[height < -8]) for each in (found, alone))
    assert (error < 2 * both).mean() > 0.8 > 0.7 > (error < 2 * before).mean()
    beside = truth[height > 0]
    np.testing.assert_array_equal(found.uncertainty(beside), alone.uncertainty(beside))


def test_beyond_a_base_nothing_is_asked():
    points = even_directions(4000)
    points = points[points[:, 2] > 0]
    half_space = np.array([0.0, 0, -0.1]), np.array([0.0, 0, -1])
    found = open_deviations(
        refined(half_space=half_space, starts={"surface": start(SHIFT)}), {"surface": SUPPORT}, {"surface": points}
    )
    assert found["surface"] == 0


def test_units_do_not_matter():
    frame = Frame(np.array([1.0, 2, 3]), 10.0)
    there = fit_to_world(start(SHIFT), frame)
    assert there.covariance[8, 8] == pytest.approx(100 * DEVIATION**2)
    back = fit_to_local(there, frame)
    np.testing.assert_allclose(back.covariance, start(SHIFT).covariance, rtol=1e-12)
    np.testing.assert_allclose(back.superquadric.semi_axes, 1, rtol=1e-12)


def test_a_superquadric_seen_from_one_side_is_usable_where_it_is_supported(rng):
    points = seen(qf.Superquadric("ellipsoid", (1.2, 1.3, 0.6), (0.1, 1.0)), rng)
    found = qf.fit(points)
    assert found.supported < 0.5 and found.status == "warned" and found.warnings.keys() == {"PARTIAL_COVERAGE"}


def test_half_a_body_that_is_no_superquadric_must_not_be_used():
    cloud = lumpy(3000)
    found = qf.fit(cloud[cloud @ [0.6, 0.7, 0.4] > 8])
    assert (
        found.supported < 0.5 and "UNSUPPORTED" in found.warnings and "% of the cloud" in found.warnings["UNSUPPORTED"]
    )


def test_nothing_is_known_of_a_surface_without_covariance_or_inliers():
    """As by the paper's method, or where all points are outliers."""
    result, points = refined(starts={"surface": start(SHIFT)}), even_directions(50)
    frame, support = Frame(np.zeros(3), 1.0), {"surface": SUPPORT}
    assert list(open_surfaces(result, support, {"surface": points}, frame)) == ["surface"]
    assert open_surfaces(replace(result, covariance=None), support, {"surface": points}, frame) == {}
    assert open_surfaces(result, support, {"surface": points[:0]}, frame) == {}


def test_two_opposite_faces_do_not_say_how_wide_a_box_is(rng):
    """Without noise too: each wider box has the same points on its faces."""
    lattice = np.argwhere(np.ones((12, 12, 2))).astype(float)
    random = np.column_stack([rng.uniform(0, 10, (300, 2)), 3.0 * rng.integers(0, 2, 300)])
    for points in (lattice, random):
        found = qf.fit(points)
        assert found.status == "unreliable" and "UNSUPPORTED" in found.warnings
        assert not found.volume().observed
