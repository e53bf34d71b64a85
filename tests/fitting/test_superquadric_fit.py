"""Criterion P3 by conjugate gradient: known superquadrics come back from clean points."""

import numpy as np
import pytest
from shapes_made import KINDS, angles, even_directions, gap, lumpy, made, single

from quadriform import fit_superquadric
from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.superquadric import paper
from quadriform.fitting.superquadric.candidates import Candidates, distances
from quadriform.fitting.superquadric.paper import _UnboundedParameters
from quadriform.shapes.control_box import ControlBox


def apart(one, other):
    """Largest distance between two superquadrics' surfaces, both ways, in units of the RMS radius."""
    return gap(*(single(s, ControlBox.around(s)) for s in (one, other)))


KNOWN = [
    ((2, 2, 2), (1, 1)),
    ((3, 2, 4), (1, 1)),
    ((3, 2, 4), (0.6, 1.4)),
    ((3, 2, 5), (0.4, 0.4)),
    ((3, 2, 4), (0.3, 1.0)),
    ((3, 2, 4), (1.5, 1.5)),
    ((3, 2, 4), (0.1, 0.1)),
]


@pytest.mark.parametrize(("semi_axes", "exponents"), KNOWN)
def test_superellipsoids_are_recovered(semi_axes, exponents):
    s = made(exponents=exponents, semi_axes=semi_axes)
    found = fit_superquadric(s.surface(even_directions(600)), method="paper")
    assert apart(found.superquadric, s) < (1e-6 if min(exponents) > 0.2 else 1e-5)
    np.testing.assert_allclose(np.sort(found.superquadric.semi_axes), np.sort(semi_axes), rtol=1e-5)
    assert found.superquadric.volume() == pytest.approx(s.volume(), rel=1e-5)
    if len(set(semi_axes)) == 3:
        assert (found.status, found.rank) == ("ok", 11)


def test_a_sphere_is_warned_of_for_its_axes_are_not_determined():
    found = fit_superquadric(made(exponents=(1, 1), semi_axes=(2, 2, 2)).surface(even_directions(600)))
    assert found.status == "warned"
    assert "ILL_CONDITIONED" in found.warnings


@pytest.mark.parametrize("exponents", [(1, 1), (0.7, 1.2), (0.5, 0.5)])
@pytest.mark.parametrize("kind", ["toroid", "hyperboloid1", "hyperboloid2"])
def test_the_other_kinds_are_recovered(kind, exponents):
    s = made(kind, exponents)
    found = fit_superquadric(s.grid(10)[0], kind, method="paper").superquadric
    assert found.kind == kind
    # hyperboloids: the cut is where the points end, so compare well inside it
    for one, other in ((found, s), (s, found)):
        assert np.abs(one.implicit(other.grid(8)[0]) - 1).max() < 1e-5
    np.testing.assert_allclose(np.sort(found.semi_axes), np.sort(s.semi_axes), rtol=1e-5)
    np.testing.assert_allclose(np.sort(found.exponents), np.sort(exponents), rtol=1e-4)
    if kind == "toroid":
        assert found.hole_radius == pytest.approx(2.5, rel=1e-6)
    else:
        assert found.height == pytest.approx(s.height, rel=1e-5)


def test_the_criterion_falls_and_ends_at_the_answer(rng):
    s = made(exponents=(0.6, 1.2))
    points = s.surface(even_directions(300)) + 0.05 * rng.normal(size=(300, 3))
    found = fit_superquadric(points, method="paper")
    assert len(found.history) == found.iterations > 5
    assert (np.diff(found.history) <= 0).all()
    assert found.history[-1] == pytest.approx(((found.superquadric.implicit(points) - 1) ** 2).mean(), rel=1e-6)
    # a minimum: no step of any parameter makes P3 smaller
    p = found.superquadric.parameters
    for k in range(11):
        for step in (1e-3, -1e-3):
            moved = found.superquadric.with_parameters(p + step * np.eye(11)[k])
            assert ((moved.implicit(points) - 1) ** 2).mean() > found.history[-1]


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_free_numbers_stand_for_the_start(kind):
    """Logarithms and logits give the start back, and their slopes are derivatives."""
    first = made(kind, (0.6, 1.4))
    coordinates = _UnboundedParameters(first)
    free = coordinates.start()
    np.testing.assert_allclose(coordinates.superquadric(free).parameters, first.parameters, rtol=1e-12)
    h, (_, slope) = 1e-6, coordinates.in_start_axes(free)
    for k in range(len(free)):
        ends = [coordinates.in_start_axes(free + sign * h * np.eye(len(free))[k])[0].parameters[k] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(slope[k], rel=1e-6)


def test_exponents_at_their_bound_are_warned_of():
    box = made(exponents=(0.01, 0.01)).grid(10)[0]
    found = fit_superquadric(box)
    assert np.isfinite(found.superquadric.parameters).all()
    assert found.superquadric.exponents.max() < 0.05
    octahedron = fit_superquadric(made(exponents=(2, 2)).surface(even_directions(600)))
    assert octahedron.superquadric.exponents.min() > 1.95
    assert "AT_BOUND" in octahedron.warnings


@pytest.mark.parametrize(("kind", "count"), [("ellipsoid", 11), ("toroid", 12)])
def test_one_point_fewer_than_parameters_is_refused(kind, count):
    """Row A5 of the matrix."""
    points = made(kind, (0.8, 1.2)).grid(8)[0][:: 384 // 40][:count]
    fit_superquadric(points, kind)
    with pytest.raises(DegenerateError, match=f"{count - 1} distinct points.*at least {count}"):
        fit_superquadric(points[:-1], kind)


@pytest.mark.parametrize("options", [{"kind": "cube"}, {"method": "magic"}, {"kind": 3}])
def test_unknown_names_are_refused(options):
    with pytest.raises(OptionError, match="expected one of"):
        fit_superquadric(made().grid(4)[0], **options)


def test_the_steps_are_conjugate_gradients_of_p3(monkeypatch):
    """2.3: explicit derivatives of the mean of (1 - F)^2; steps along Polak and Ribiere's conjugate directions."""
    cloud = 20 * lumpy(300) + 5
    seen = {}
    library = paper.minimize

    def watched(criterion, first, callback, **how):
        seen.update(criterion=criterion, at=[first.copy()])

        def each(intermediate_result):
            seen["at"].append(intermediate_result.x.copy())
            callback(intermediate_result)

        return library(criterion, first, callback=each, **how)

    monkeypatch.setattr(paper, "minimize", watched)
    found = fit_superquadric(cloud, method="paper")
    criterion, at = seen["criterion"], seen["at"]
    assert found.history[-1] == pytest.approx(((1 - found.superquadric.implicit(cloud)) ** 2).mean(), rel=1e-9)
    for x in at[:3]:
        slope = [(criterion(x + h)[0] - criterion(x - h)[0]) / 2e-6 for h in 1e-6 * np.eye(len(x))]
        np.testing.assert_allclose(criterion(x)[1], slope, rtol=1e-5, atol=1e-7 * np.abs(slope).max())
    gradient = [criterion(x)[1] for x in at]
    direction = -gradient[0]
    for k in range(1, 5):
        step = at[k] - at[k - 1]
        assert step @ direction > (1 - 1e-9) * np.linalg.norm(step) * np.linalg.norm(direction)
        change = gradient[k] - gradient[k - 1]
        beta = max(0.0, float(gradient[k] @ change / (gradient[k - 1] @ gradient[k - 1])))
        direction = -gradient[k] + beta * direction


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_of_the_robust_fit_are_p4(kind, rng):
    s = made(kind)
    points = s.natural(angles(kind, 50)) + rng.normal(0, 0.1, (50, 3))
    found = distances(Candidates.of([s]), points)[0][0]
    np.testing.assert_allclose(np.abs(found), s.first_order_distance(points), rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(found > 0, s.implicit(points) > 1)


@pytest.mark.parametrize(("extents", "at_bound"), [(1.99, False), (1.9999, True)])
def test_the_papers_fit_says_where_an_axis_is_twice_the_extent_of_the_points(extents, at_bound):
    points = made(exponents=(1, 1), semi_axes=(3, 2, 1)).grid(8)[0]
    longest = extents * np.ptp(points, axis=0).max()
    found = paper._with_covariance(made(exponents=(1, 1), semi_axes=(3, longest, 1)), points, 7, ())
    assert ("AT_BOUND" in found.warnings, found.iterations) == (at_bound, 7)
