"""What a superquadric is fitted to; candidates, steps, restarts and connections, against plain computations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes_made import KINDS, even_directions, made, turned

from quadriform.errors import OptionError
from quadriform.fitting import connected
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.result import SuperquadricFit
from quadriform.fitting.superquadric import multistart, paper, restarts, surroundings
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.empty_space import EmptySpace
from quadriform.fitting.superquadric.fit import fit_to_local, fit_to_world
from quadriform.fitting.superquadric.initial import START_ROTATIONS
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.surroundings import Surroundings
from quadriform.points import Frame
from quadriform.shapes.superquadric import Superquadric

POINTS = np.random.default_rng(1).normal(size=(50, 3)) * [1, 2, 3]


def problem(**more):
    n = np.arange(50.0)
    return SearchProblem(POINTS, n + 1, more.pop("kind", "ellipsoid"), more.pop("fixed", {}), n / 10, n + 5, **more)


@pytest.mark.parametrize("most", [1, 7, 50, 90])
def test_a_sample_takes_every_so_many_of_the_points_by_their_distance(most):
    of = problem(empty=EmptySpace(np.zeros((2, 3, 3)), np.array([10.0, 20.0])))
    order = np.argsort(np.linalg.norm(POINTS, axis=1))
    count = min(most, 50)
    at = [round(49 * k / (count - 1)) if count > 1 else 0 for k in range(count)]
    np.testing.assert_array_equal(of.thinned(most), order[at])
    found = of.sample(most)
    for name in ("points", "weights", "log_odds", "relative_noise"):
        np.testing.assert_array_equal(getattr(found, name), getattr(of, name)[order[at]])
    np.testing.assert_allclose(found.empty.weights, np.array([10, 20]) * count / 50)
    assert problem().sample(most).empty is None
    seen = problem(surroundings=Surroundings(POINTS + 10)).sample(most)
    np.testing.assert_array_equal(seen.surroundings.viewpoints, seen.points + 10)
    assert problem().sample(most).surroundings is None


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_fixed_values_stay(kind):
    rotation = turned(2)
    fixed = {"semi_axes": np.array([1.0, 2, 3]), "rotation": rotation}
    of = problem(kind=kind, fixed=fixed)
    assert np.flatnonzero(of.fixed_mask).tolist() == [0, 1, 2, 5, 6, 7]
    assert len(of.fixed_mask) == (12 if kind == "toroid" else 11)
    found = of.with_fixed(Candidates.of([made(kind), made(kind, (1, 1))]))
    np.testing.assert_allclose(np.exp(found.log_axes), [[1, 2, 3]] * 2)
    np.testing.assert_array_equal(found.rotations, [rotation] * 2)
    np.testing.assert_allclose(found.exponents, [[0.6, 1.4], [1, 1]])
    assert np.flatnonzero(problem(kind="toroid", fixed={"hole_radius": 1}).fixed_mask).tolist() == [11]


def test_empty_space_is_that_around_the_inliers(monkeypatch):
    ball = Candidates.of([Superquadric(semi_axes=(2, 2, 2))])
    mixture, given = Mixture(np.array([0.9]), np.array([0.3])), []
    monkeypatch.setattr(multistart, "empty_space", lambda known, points, inliers: given.append(inliers) or "empty")
    of = problem(surroundings=Surroundings())
    assert multistart._with_empty_space(of, (ball, mixture)).empty == "empty"
    np.testing.assert_array_equal(given[0], Descent(of, ball, mixture).inliers[0] >= 0.5)
    assert multistart._with_empty_space(problem(), (ball, mixture)).empty is None


@pytest.mark.parametrize("kind", KINDS)
def test_candidates_hold_superquadrics_and_give_them_back(kind):
    bodies = [made(kind), made(kind, (1.0, 0.3), (1.0, 2.0, 0.5))]
    of = Candidates.of(bodies)
    assert len(of) == 2 and of.n_parameters == (12 if kind == "toroid" else 11)
    for k, body in enumerate(bodies):
        found = of.superquadric(k)
        np.testing.assert_allclose(found.semi_axes, body.semi_axes)
        np.testing.assert_allclose(found.rotation, body.rotation, atol=1e-12)
        np.testing.assert_array_equal(found.translation, body.translation)
        np.testing.assert_array_equal(found.exponents, body.exponents)
        assert found.hole_radius == (pytest.approx(2.5) if kind == "toroid" else None)
        assert kind == "toroid" or of.log_holes[k] == 0
        assert found.height == (2 * body.semi_axes.max() if kind.startswith("hyper") else None)
    both = of.take(np.array([1])).joined(of)
    np.testing.assert_array_equal(both.log_axes, of.log_axes[[1, 0, 1]])
    swapped = of.where(np.array([True, False]), of.take(np.array([1, 0])))
    np.testing.assert_array_equal(swapped.rotations, of.rotations[[0, 0]])


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_steps_are_in_the_own_frame_and_within_bounds(kind, rng):
    of = Candidates.of([made(kind), made(kind, (1.0, 0.3), (1.0, 2.0, 0.5))])
    step = 0.3 * rng.normal(size=(2, of.n_parameters))
    found = of.moved(step, 2.5)
    for k in range(2):
        np.testing.assert_allclose(np.exp(found.log_axes[k]), np.minimum(np.exp(of.log_axes[k] + step[k, :3]), 2.5))
        np.testing.assert_allclose(found.exponents[k], np.clip(of.exponents[k] + step[k, 3:5], 0.01, 2))
        turn = Rotation.from_rotvec(step[k, 5:8]).as_matrix()
        np.testing.assert_allclose(found.rotations[k], of.rotations[k] @ turn)
        np.testing.assert_allclose(found.translations[k], of.translations[k] + of.rotations[k] @ step[k, 8:11])
        np.testing.assert_allclose(found.log_holes[k], of.log_holes[k] + (step[k, 11:] if kind == "toroid" else 0))
    far = of.moved(np.full((2, of.n_parameters), -99.0), 2.5)
    np.testing.assert_allclose(far.log_axes, np.log(2.5) - 25)
    assert (far.log_holes == -10).all() == (kind == "toroid")
    assert (of.moved(np.full((2, of.n_parameters), 99.0), 2.5).log_holes == 10).all() == (kind == "toroid")


def test_boxes_lie_between_the_tenth_and_the_ninetieth_hundredth_of_the_inliers():
    inliers, rotation = np.where(np.arange(50) % 4 == 0, 0.4, 0.6), turned(3)
    found = restarts.restarts(POINTS, inliers, rotation)
    for k, frame in enumerate(START_ROTATIONS):
        local = POINTS[inliers > 0.5] @ rotation @ frame
        low, high = np.quantile(local, 0.1, axis=0), np.quantile(local, 0.9, axis=0)
        np.testing.assert_allclose(np.exp(found.log_axes[k]), (high - low) / 2)
        np.testing.assert_allclose(found.translations[k], rotation @ frame @ (low + high) / 2)
        np.testing.assert_allclose(found.rotations[k], rotation @ frame)
    everywhere = restarts.restarts(POINTS, np.zeros(50), rotation)
    whole = restarts.restarts(POINTS, np.ones(50), rotation)
    np.testing.assert_array_equal(everywhere.log_axes, whole.log_axes)
    flat = restarts.restarts(POINTS * [1, 1, 0], np.ones(50), np.eye(3))
    sizes = np.exp(flat.log_axes[:4])  # in the others the flat axis is none of the frame's
    np.testing.assert_allclose(sizes.min(axis=1) / sizes.max(axis=1), 1e-2)


def plain_step(body):
    """Kruskal's tree over eight neighbours, its 99th hundredth, and parts added until nine tenths are joined."""
    n, distance = len(body), np.linalg.norm(body[:, None] - body, axis=2)
    edges = sorted({(distance[i, j], min(i, j), max(i, j)) for i in range(n) for j in np.argsort(distance[i])[1:9]})

    def joined(kept):
        part = list(range(n))
        for _, i, j in kept:
            if part[i] != part[j]:
                part = [part[i] if p == part[j] else p for p in part]
        return np.array(part)

    tree, part = [], list(range(n))
    for edge in edges:
        if part[edge[1]] != part[edge[2]]:
            tree.append(edge)
            part = [part[edge[1]] if p == part[edge[2]] else p for p in part]
    step = np.quantile([edge[0] for edge in tree], 0.99)
    part = joined([edge for edge in tree if edge[0] <= 3 * step])
    inside = part == np.bincount(part).argmax()
    while inside.mean() < 0.9:
        away = distance[~inside][:, inside].min(axis=1)
        step = max(step, away.min())
        inside |= np.isin(part, part[~inside][away <= step])
    return step


@pytest.mark.parametrize("parts", [(70,), (40, 30), (30, 25, 20)])
def test_the_distance_of_connected_points_is_that_of_the_tree_or_between_parts(parts):
    rng = np.random.default_rng(4)
    clusters = [rng.normal((40.0 * k * (k + 1), 0, 0), size=(n, 3)) for k, n in enumerate(parts)]
    body = np.concatenate(clusters)
    assert connected._step(body) == pytest.approx(plain_step(body))
    assert connected.connection_distance(body) == pytest.approx(3 * plain_step(body))


def test_what_is_around_points_moves_with_their_unit_and_frame():
    eyes, plane = np.arange(9.0).reshape(3, 3), (np.array([1.0, 2, 3]), np.array([0, 0, 1.0]))
    for viewpoints in (eyes, None):
        for support in (plane, None):
            found = Surroundings(viewpoints, support).in_unit(10)
            assert (found.viewpoints is None) == (viewpoints is None) and (found.plane is None) == (support is None)
            if viewpoints is not None:
                np.testing.assert_array_equal(found.viewpoints, 10 * eyes)
            if support is not None:
                np.testing.assert_array_equal(found.plane[0], [10, 20, 30])
                np.testing.assert_array_equal(found.plane[1], [0, 0, 1])
    some = Surroundings(eyes, plane).take(np.array([2, 0]))
    np.testing.assert_array_equal(some.viewpoints, eyes[[2, 0]])
    without = Surroundings(None, plane)
    assert without.take(np.array([2])) is without


@pytest.mark.parametrize(("above", "refused"), [(0.76, False), (0.74, True), (0.26, True), (0.24, False)])
def test_a_support_has_most_points_on_one_side(above, refused):
    points = np.column_stack([np.zeros((100, 2)), np.where(np.arange(100) < 100 * above, 1.0, -1.0)])
    given = ((0, 0, 0), (0, 0, 4.0))
    if refused:
        with pytest.raises(OptionError, match=f"{100 * min(above, 1 - above):.0f}% of the points lie beyond"):
            surroundings._support(points, given)
    else:
        at, normal = surroundings._support(points, given)
        np.testing.assert_array_equal(normal, [0, 0, 1.0 if above > 0.5 else -1.0])
        np.testing.assert_array_equal(at, 0)


@pytest.mark.parametrize(("degrees", "refused"), [(79, False), (81, True)])
def test_a_sensor_sees_at_most_80_degrees_aside(degrees, refused):
    """Of four directions around the mean one."""
    angle = np.radians(degrees)
    aside = np.array([[np.sin(angle), 0], [-np.sin(angle), 0], [0, np.sin(angle)], [0, -np.sin(angle)]])
    points = np.column_stack([aside, np.full(4, np.cos(angle))]) * 5 + [1, 2, 3]
    other = np.concatenate([points, [[0, 0, 9.0]]])
    eyes = np.concatenate([np.tile([1.0, 2, 3], (4, 1)), [[0, 0, 0.0]]])
    if refused:
        with pytest.raises(OptionError, match=r"\[1.0, 2.0, 3.0\] lies among the points"):
            surroundings._viewpoints(other, eyes)
    else:
        np.testing.assert_array_equal(surroundings._viewpoints(other, eyes), eyes)
    one = surroundings._viewpoints(even_directions(9), (0, 0, 50.0))
    np.testing.assert_array_equal(one, np.tile([0, 0, 50.0], (9, 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_unbounded_parameters_lead_back_and_have_their_derivatives(kind):
    body = made(kind, (0.7, 1.3))
    of = paper._UnboundedParameters(body)
    start = of.start()
    found = of.superquadric(start)
    np.testing.assert_allclose(found.parameters, replace(body, height=found.height).parameters, rtol=1e-9, atol=1e-9)
    values, derivative = of.in_start_axes(start)
    for k in range(len(start)):
        step = 1e-6 * np.eye(len(start))[k]
        slope = (
            of.in_start_axes(start + step)[0].parameters[k] - of.in_start_axes(start - step)[0].parameters[k]
        ) / 2e-6
        assert derivative[k] == pytest.approx(slope, rel=1e-6)
    for far in (-1e3, 1e3):  # old bug: a semi-axis beyond the height at which two sheets were cut was refused
        moved, slope = of.in_start_axes(np.where(np.isin(np.arange(len(start)), (5, 6, 7)), 0.0, far))
        assert np.isfinite(slope).all() and np.isfinite(moved.parameters).all()
    assert values.exponents == pytest.approx([0.7, 1.3])


def test_a_fit_changes_its_unit_in_lengths_alone():
    body, frame = made("toroid"), Frame(np.array([1.0, 2, 3]), 10.0)
    root = np.random.default_rng(2).normal(size=(12, 12))
    fit = SuperquadricFit(body, {}, 12, 1.0, root @ root.T, np.ones(3), 0.5, (), 1)
    found = fit_to_world(fit, frame)
    unit = np.array([10, 10, 10, 1, 1, 1, 1, 1, 10, 10, 10, 1.0])
    np.testing.assert_allclose(found.covariance, root @ root.T * np.outer(unit, unit))
    assert found.noise == 5 and found.superquadric.hole_radius == body.hole_radius
    np.testing.assert_allclose(found.superquadric.semi_axes, 10 * body.semi_axes)
    np.testing.assert_allclose(fit_to_local(found, frame).covariance, root @ root.T)


@pytest.mark.parametrize("flat", [False, True])
def test_rank_and_condition_are_those_of_the_derivatives_in_the_own_axes(flat):
    """Points on a plane through the middle leave parameters open, in whatever pose and unit."""
    body = made(exponents=(1, 1))
    points = body.surface(even_directions(60))
    if flat:
        points = body.surface(np.column_stack([even_directions(60)[:, :2], np.zeros(60)]) @ body.rotation.T)
    upright = Superquadric("ellipsoid", body.semi_axes, body.exponents)
    local = (points - body.translation) @ body.rotation
    singular = np.linalg.svd(upright.parameter_derivatives(local)[1], compute_uv=False)
    rank, condition = paper.rank_and_condition(body, points)
    expected = sum(value > 1e-10 * singular.max() for value in singular)
    assert rank == expected and (rank < 11) == flat
    assert condition == pytest.approx(singular.max() / singular.min(), rel=1e-6) or (flat and condition > 1e12)
