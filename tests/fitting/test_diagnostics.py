"""Each warning at its limit: on one side it is there, with its numbers in words, on the other it is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import SKEW, made, single

from quadriform.errors import WarningKind
from quadriform.fitting import diagnostics
from quadriform.fitting.elements import Elements
from quadriform.fitting.result import Result
from quadriform.fitting.superquadric import diagnostics as of_superquadric
from quadriform.fitting.support import Arrangement, Reach, Support
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

BALL = Superquadric()
GOOD = Support(0.96, 0.96, 0.96, 0.96, 0.2, 0.1, Reach(0.1, 1.0))


def test_texts_of_several_surfaces_bear_their_names():
    one, other = {"POOR_FIT": "a"}, {"POOR_FIT": "b", "FOLDING": "c"}
    assert diagnostics.named_texts({"epi": one}) == one
    assert diagnostics.named_texts({"epi": one, "endo": other}) == {"POOR_FIT": "epi: a; endo: b", "FOLDING": "endo: c"}
    assert diagnostics.named_texts({}) == {}


def test_points_of_two_bodies_two_layers_or_a_volume_are_not_of_one_surface():
    def kinds(bodies, layered, filled, closed=True):
        return list(diagnostics.not_one_surface(Arrangement(bodies, layered, filled), closed))

    assert kinds(1, 0.5, 0.1) == [] == kinds(0, 0.0, 0.0)
    assert kinds(2, 0.0, 0.0) == ["SEVERAL_BODIES"]
    assert kinds(1, 0.51, 0.9) == ["DOUBLE_WALL"]
    assert kinds(1, 0.5, 0.11) == ["FILLED_VOLUME"] and kinds(1, 0.5, 0.11, closed=False) == []
    assert kinds(3, 0.6, 0.0, closed=False) == ["SEVERAL_BODIES", "DOUBLE_WALL"]
    text = diagnostics.not_one_surface(Arrangement(3, 0.0, 0.234), True)
    assert "of 3 closed bodies" in text["SEVERAL_BODIES"] and text["FILLED_VOLUME"].startswith("23 % of the points")


def test_the_area_without_data_is_stated_in_per_cent():
    part = replace(GOOD, within=0.4, limit=0.25, reach=Reach(1.25, 0.5))
    found = diagnostics.unsupported(part, 0.123)
    assert found["PARTIAL_COVERAGE"].startswith("60 % of the surface is farther than 0.25 from all data")
    assert "reaches 1.25 beyond it" in found["PARTIAL_COVERAGE"]
    assert (
        found["UNSUPPORTED"]
        == "data supports 40 % of the area only, and the rest is known to 12 % of the cloud's RMS radius"
    )
    assert diagnostics.unsupported(part)["UNSUPPORTED"] == "data supports 40 % of the area only"
    assert found["RUNAWAY"] == "the surface reaches 1.25 beyond data that is 0.5 wide there"


def test_the_volume_without_data_is_not_called_an_area():
    """Old fault: where the share of the volume was the smaller one, it was stated as a share of the surface."""
    found = diagnostics.unsupported(replace(GOOD, within=0.4, area=0.9, limit=0.25, by_volume=True))
    assert found["PARTIAL_COVERAGE"].startswith(
        "60 % of the volume below the base is under surface that is farther than"
    )
    assert found["UNSUPPORTED"] == "data supports 40 % of the volume only"


def test_limits_of_support():
    assert diagnostics.unsupported(GOOD) == {}
    assert diagnostics.unsupported(replace(GOOD, within=diagnostics.OBSERVED)) == {}
    assert list(diagnostics.unsupported(replace(GOOD, within=diagnostics.OBSERVED - 1e-9))) == ["PARTIAL_COVERAGE"]
    assert diagnostics.unsupported(replace(GOOD, reach=Reach(0.2, 1.0))) == {}
    assert list(diagnostics.unsupported(replace(GOOD, reach=Reach(0.21, 1.0)))) == ["PARTIAL_COVERAGE"]
    half = replace(GOOD, within=0.5)
    assert list(diagnostics.unsupported(half)) == ["PARTIAL_COVERAGE"]
    less = replace(GOOD, within=0.49)
    assert "UNSUPPORTED" not in diagnostics.unsupported(less, 0.05) and "UNSUPPORTED" in diagnostics.unsupported(
        less, 0.051
    )
    for width, is_longer in ((0.2, False), (0.199, True)):  # one and a half widths of the data
        assert ("RUNAWAY" in diagnostics.unsupported(replace(GOOD, reach=Reach(0.3, width)))) == is_longer
    narrow = replace(GOOD, reach=Reach(0.2, 0.01))
    assert "RUNAWAY" not in diagnostics.unsupported(narrow)  # within the limit of support


def test_outliers_are_counted_and_the_first_five_named():
    inliers = np.ones(40)
    inliers[[3, 5]] = [0.49, 0.5]
    assert diagnostics.outliers(inliers) == {"OUTLIERS": "1 of 40 points are outliers: 3"}
    inliers[10:14] = 0.0
    assert diagnostics.outliers(inliers) == {"OUTLIERS": "5 of 40 points are outliers: 3, 10, 11, 12, 13"}
    inliers[14] = 0.0
    assert diagnostics.outliers(inliers)["OUTLIERS"] == "6 of 40 points are outliers: 3, 10, 11, 12, 13, ..."
    inliers[15:19] = 0.0
    assert list(diagnostics.outliers(inliers)) == ["OUTLIERS"]  # a quarter
    inliers[19] = 0.0
    assert list(diagnostics.outliers(inliers)) == ["MANY_OUTLIERS"]
    counted = np.arange(40) < 10
    assert diagnostics.outliers(inliers, counted) == {"OUTLIERS": "1 of 40 points are outliers: 3"}
    assert diagnostics.outliers(np.ones(3)) == {}


def test_copies_of_points_are_counted():
    assert diagnostics.duplicates(0, 9) == {}
    assert diagnostics.duplicates(2, 9)["DUPLICATES"].startswith("2 of 9 points")


def test_a_poor_fit_is_one_beyond_the_limit_and_the_known_noise():
    def is_poor(*arguments, **more):
        return bool(diagnostics.poor_fit(*arguments, **more))

    spread = np.array([1.0, -1.0, 1.0])
    assert not is_poor(0.0499 * spread) and is_poor(0.0501 * spread) and not is_poor(0.0501 * spread, 0.1)
    assert is_poor(np.empty(0)) and "100.0 %" in diagnostics.poor_fit(np.empty(0))["POOR_FIT"]
    known = np.full(3, 0.04)
    exact = np.sqrt(0.05**2 + 0.04)
    assert not is_poor(0.999 * exact * spread, known=known) and is_poor(1.001 * exact * spread, known=known)
    few = np.sqrt(0.05**2 + 0.04 * (1 + 2 * np.sqrt(2 / 8)))
    assert not is_poor(0.999 * few * spread, known=known, independent=8)
    assert is_poor(1.001 * few * spread, known=known, independent=8)
    one = np.sqrt(0.05**2 + 0.04 * (1 + 2 * np.sqrt(2)))
    assert is_poor(1.001 * one * spread, known=known, independent=0.1)
    assert not is_poor(0.999 * one * spread, known=known, independent=0.1)
    text = diagnostics.poor_fit(0.4 * spread, known=known)["POOR_FIT"]
    assert "cloud's RMS radius, their known noise 20.0 %" in text and "is 40.0 % of" in text
    assert "known noise" not in diagnostics.poor_fit(0.4 * spread)["POOR_FIT"]


def test_what_a_superquadric_did_not_reach_is_stated():
    assert of_superquadric.not_converged(True, 40) == {}
    assert of_superquadric.not_converged(False, 40) == {
        "MAX_ITERATIONS": "the superquadric fit did not converge in 40 steps"
    }
    assert of_superquadric.undetermined(11, 1e4, 11, "rotation") == {}
    assert of_superquadric.undetermined(10, 1.01e4, 11, "rotation") == {
        "ILL_CONDITIONED": "the points determine 10 of 11 superquadric parameters, least of all the rotation, "
        "condition 1.0e+04"
    }
    hardly = of_superquadric.undetermined(11, 1.01e4, 11, "exponents")["ILL_CONDITIONED"]
    assert hardly.startswith("the points hardly determine all 11 superquadric parameters, least of all the exponents")
    assert of_superquadric.near_symmetric(False) == {} and list(of_superquadric.near_symmetric(True)) == [
        "NEAR_SYMMETRIC"
    ]
    assert of_superquadric.multiple_minima(0) == {}
    assert of_superquadric.multiple_minima(2)["MULTIPLE_MINIMA"].startswith("2 other surface")
    assert "up to 9 control points" in diagnostics.max_error_missed(9, 1.234, 0.5)["POOR_FIT"]


@pytest.mark.parametrize(
    ("exponents", "semi_axes", "expected"),
    [
        ((0.0111, 1.9989), (1, 2, 2.99), ""),
        ((0.0109, 1.0), (1, 2, 2.0), "exponents"),
        ((1.0, 0.01), (1, 2, 2.0), "exponents"),
        ((1.0, 1.9991), (1, 2, 2.0), "exponents"),
        ((1.0, 1.0), (1, 2, 2.998), "semi-axis"),
        ((2.0, 1.0), (1, 3, 2.0), "exponents and semi-axis"),
    ],
)
def test_parameters_within_a_thousandth_of_their_bounds_are_at_them(exponents, semi_axes, expected):
    found = of_superquadric.at_bound(Superquadric("ellipsoid", semi_axes, exponents), 3.0)
    assert bool(found) == bool(expected)
    for word in ("exponents", "semi-axis"):
        assert (word in found.get("AT_BOUND", "")) == (word in expected)


def test_a_semi_axis_at_its_limit_is_named_with_the_limit():
    text = of_superquadric.at_bound(Superquadric("ellipsoid", (1, 2, 3.45), (1.0, 1.0)), 3.45)["AT_BOUND"]
    assert text.startswith("a semi-axis of 3.45 RMS radii of the data, at or above 3.45")


def test_directions_without_inliers_are_not_covered():
    assert of_superquadric.partial_coverage(0.85, np.array([0.5])) == {}
    assert of_superquadric.partial_coverage(0.84, np.ones(3))["PARTIAL_COVERAGE"].startswith("points cover 84 %")
    assert of_superquadric.partial_coverage(1.0, np.array([0.49]))["PARTIAL_COVERAGE"] == "no point is near the surface"


def test_surface_beyond_the_box_is_stated_in_per_cent():
    box = ControlBox.around(BALL)
    assert diagnostics._outside_lattice(single(BALL, box), BALL) == {}
    larger = Superquadric(semi_axes=(1.0, 1.0, 1.2))
    local = larger.grid(12)[0]
    share = (np.abs(local[:, 2]) > 1 + 1e-8).mean()
    found = diagnostics._outside_lattice(single(larger, box), larger)
    assert found["OUTSIDE_LATTICE"].startswith(f"{100 * share:.0f} % of the surface")
    for shift, outside in ((1.9e-9, False), (2.5e-9, True), (-1.9e-9, False), (-2.5e-9, True)):
        moved = Superquadric(translation=(shift, 0, 0))
        assert bool(diagnostics._outside_lattice(single(moved, box), moved)) == outside


def refined(sigma, size, half_space=None):
    """A ball whose control points have independent standard deviations of a size."""
    box = ControlBox.around(BALL, (3, 3, 3))
    count = box.control_points.size
    return Result(single(BALL, box), (), 1.0, sigma=sigma, covariance=size**2 * np.eye(count), half_space=half_space)


def plain_deviation(model, covariance, half_space=None):
    """The root of the mean of b' C b over the area."""
    elements, squares, total = Elements.of(model, "surface", None), 0.0, 0.0
    for origin, point, normal, area in zip(elements.origins, elements.points, elements.normals, elements.areas):
        if half_space is not None and (point - half_space[0]) @ half_space[1] > 0:
            continue
        row = np.outer(model.box.matrix(origin[None])[0], normal).ravel()
        squares, total = squares + area * (row @ covariance @ row), total + area
    return np.sqrt(squares / total) if total else 0.0


@pytest.mark.parametrize("at", [None, 0.2, -9.0])
def test_the_deviation_of_a_surface_is_a_mean_over_its_area(at, rng):
    root = rng.normal(size=(81, 81))
    half_space = None if at is None else (np.array([0, 0, at]), np.array([0, 0, 1.0]))
    model = refined(1.0, 0.1).model
    expected = plain_deviation(model, root @ root.T, half_space)
    assert diagnostics.rms_deviation(model, root @ root.T, half_space) == pytest.approx(expected, rel=1e-9)
    assert (expected == 0) == (at == -9.0)


def test_elements_share_the_area_and_face_outwards():
    elements = Elements.of(refined(1.0, 0.1).model, "surface", None)
    mesh = BALL.mesh(8)
    corner_share = np.zeros(len(mesh.vertices))
    for face in mesh.faces:
        a, b, c = mesh.vertices[face]
        corner_share[face] += np.linalg.norm(np.cross(b - a, c - a)) / 6
    assert elements.areas.sum() == pytest.approx(mesh.area(), rel=0.01)
    np.testing.assert_allclose(elements.areas, corner_share, rtol=0.02)
    assert (np.einsum("ij,ij->i", elements.normals, elements.points) > 0.99).all()


def test_a_surface_is_uncertain_beyond_the_noise_and_half_a_per_cent():
    result = refined(1.0, 0.1)
    deviation = plain_deviation(result.model, result.covariance)
    for noise, is_uncertain in ((deviation - 0.0049, False), (deviation - 0.0051, True)):
        assert bool(diagnostics.uncertain(refined(noise, 0.1), 2.0)) == is_uncertain
    text = diagnostics.uncertain(refined(deviation / 2, 0.1), 2.0)["UNCERTAIN"]
    assert text.startswith(f"the surface is known to {2 * deviation:.2g} only")
    assert f"single point to {deviation:.2g}" in text
    assert diagnostics.uncertain(replace(result, covariance=None), 1.0) == {}
    assert diagnostics.uncertain(replace(result, sigma=None), 1.0) == {}


def test_beyond_a_base_the_share_without_data_is_stated_of_each_surface():
    result = refined(1.0, 0.1, (np.zeros(3), np.array([0, 0, 1.0])))
    quality = {"epi": SimpleNamespace(support=replace(GOOD, area=0.6)), "endo": SimpleNamespace(support=GOOD)}
    assert diagnostics.base_not_observed(result, quality)["BASE_NOT_OBSERVED"].endswith("epi 40 %, endo 4 %")
    assert diagnostics.base_not_observed(refined(1.0, 0.1), quality) == {}


def solution(condition=1.0):
    return SimpleNamespace(condition=condition, strength=1e-4)


def test_a_body_thinner_than_four_times_the_noise_has_no_two_sides():
    """The mean thickness is twice the volume over the area."""
    plate = Superquadric(semi_axes=(1.0, 1.0, 0.1))
    model = single(plate, ControlBox.around(plate))
    mesh = model.mesh(resolution=16)
    thickness = 2 * mesh.volume() / mesh.area()
    assert diagnostics.ill_conditioned(model, solution(), thickness / 4.01) == {}
    text = diagnostics.ill_conditioned(model, solution(), thickness / 3.99)["ILL_CONDITIONED"]
    assert text.startswith("the body is 3.99 times as thick as the noise")
    tube = made("hyperboloid1")
    assert diagnostics._thin(single(tube, ControlBox.around(tube)), 1e9) == []


def test_a_condition_of_which_rounding_moves_the_surface_is_stated():
    model = refined(1.0, 0.1).model
    assert diagnostics.ill_conditioned(model, solution(4.9e9), 1e-9) == {}
    assert "condition 5.1e+09" in diagnostics.ill_conditioned(model, solution(5.1e9), 1e-9)["ILL_CONDITIONED"]


def test_control_points_a_million_radii_away_are_too_far():
    box = ControlBox.around(BALL)
    for far, is_far in ((0.99e6, False), (-0.99e6, False), (1.01e6, True), (-1.01e6, True)):
        points = box.control_points.copy()
        points[0, 1, 2, 1] = box.rest[0, 1, 2, 1] + far
        found = diagnostics.far_control_points(single(BALL, box.with_control_points(points)))
        assert bool(found) == is_far
    assert "up to 1e+06 RMS radii" in found["ILL_CONDITIONED"]
    away = ControlBox.around(replace(BALL, translation=(2e6, 0, 0)))  # the distance is that from the lattice
    assert diagnostics.far_control_points(single(BALL, away)) == {}


def test_superquadrics_that_differ_by_rounding_are_the_same():
    body = Superquadric("ellipsoid", (1.0, 2.0, 3.0), (0.5, 0.6), SKEW, (5.0, -4.0, 1.0))
    for change, same in ((7.9e-9, True), (8.1e-9, False)):  # a billionth of three and five
        assert diagnostics._same(body, replace(body, translation=body.translation + change * np.eye(3)[2])) == same
        assert diagnostics._same(body, replace(body, semi_axes=body.semi_axes - [change, 0, 0])) == same
    for change, same in ((0.9e-9, True), (1.1e-9, False)):
        assert diagnostics._same(body, replace(body, exponents=body.exponents + change * np.eye(2)[1])) == same


def test_a_start_that_did_not_converge_is_noted_while_the_model_keeps_it():
    found = SimpleNamespace(
        superquadric=BALL,
        warnings={WarningKind.MAX_ITERATIONS: "slow", WarningKind.AT_BOUND: "long", WarningKind.OUTLIERS: "some"},
    )
    model = refined(1.0, 0.1).model
    lead = "the superquadric that the fit starts from: "
    notes = diagnostics.start_notes({"surface": found}, model)
    assert notes == (f"{lead}MAX_ITERATIONS: slow", f"{lead}AT_BOUND: long")
    moved = SimpleNamespace(superquadric=Superquadric(translation=(0.1, 0, 0)), warnings=found.warnings)
    assert diagnostics.start_notes({"surface": moved}, model) == ()
    both = SimpleNamespace(surfaces={"a": BALL, "b": BALL})
    assert diagnostics.start_notes({"a": found, "b": moved}, both)[0] == f"a: {lead}MAX_ITERATIONS: slow"


def test_warnings_of_a_model_are_those_of_its_surfaces_and_of_the_whole():
    result = replace(refined(0.0, 0.1), counted={"surface": np.arange(40) < 20})
    inliers = np.ones(40)
    inliers[[2, 30]] = 0.0
    support, arrangement = replace(GOOD, within=0.9), Arrangement(1, 0.0, 0.2)
    quality = diagnostics.SurfaceQuality(
        np.where(inliers > 0, 0.06, 9.0), inliers, support, arrangement, np.zeros(40), 40.0
    )
    found = diagnostics.model_warnings(result, {"surface": quality}, 10.0)
    assert set(found) == {"OUTLIERS", "POOR_FIT", "FILLED_VOLUME", "PARTIAL_COVERAGE", "UNCERTAIN"}
    assert found["OUTLIERS"] == "1 of 40 points are outliers: 2"
    assert "farther than 2 from all data" in found["PARTIAL_COVERAGE"]
    known = replace(quality, known=np.full(40, 0.06**2))
    assert "POOR_FIT" not in diagnostics.model_warnings(result, {"surface": known}, 10.0)
