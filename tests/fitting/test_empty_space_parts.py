"""Each step from what a sensor measured to the rays that are empty, against plain loops."""

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import made, turned

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import empty_space
from quadriform.fitting.superquadric.candidates import Candidates, distances
from quadriform.fitting.superquadric.empty_space import EmptySpace
from quadriform.fitting.superquadric.surroundings import Surroundings

EYE = np.array([1.0, 2, 10])


def test_a_ray_counts_as_a_point_at_its_deepest_position(rng):
    rays, weights = rng.uniform(-1.5, 1.5, (20, 4, 3)), rng.uniform(0.5, 2, 20)
    bodies = Candidates.of([made(exponents=(1, 1), semi_axes=(1.0, 0.8, 1.2)), made(semi_axes=(1.2, 1.0, 0.9))])
    bodies = Candidates(
        bodies.kind, bodies.log_axes, bodies.exponents, bodies.rotations, np.zeros((2, 3)), bodies.log_holes
    )
    mixture = Mixture(np.array([0.9, 0.6]), np.array([0.1, 0.3]))
    found = EmptySpace(rays, weights).penalty(bodies, mixture)
    for i in range(2):
        cost, gradient, matrix = 0.0, np.zeros(11), np.zeros((11, 11))
        one = mixture.take(np.array([i]))
        for ray, weight in zip(rays, weights):
            there, rows = distances(bodies.take(np.array([i])), ray)
            deepest = there[0].argmin()
            depth, row = min(there[0, deepest], 0.0), rows[0, :, deepest]
            inlier, density = one.densities(np.array([[depth]]))
            cost += weight * (one.densities(np.zeros((1, 1)))[1] - density)[0, 0]
            if depth < 0:
                gradient += weight * inlier[0, 0] * depth * row
                matrix += weight * inlier[0, 0] * np.outer(row, row)
        np.testing.assert_allclose(found.cost[i], cost, rtol=1e-9)
        np.testing.assert_allclose(found.gradient[i], gradient, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.matrix[i], matrix, rtol=1e-9, atol=1e-12)
    assert (found.cost > 0).all()


@pytest.mark.parametrize("axis", [(0, 0, 5.0), (1, 0, 0), (0.3, -0.4, 0.2), (-1, -1, -1)])
def test_a_frame_has_its_axis_as_z_and_is_right_handed(axis):
    frame = empty_space._frame_about(np.array(axis, dtype=float))
    np.testing.assert_allclose(frame[:, 2], np.array(axis) / np.linalg.norm(axis), rtol=1e-12)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frame), 1)
    assert abs(frame[:, 0] @ np.eye(3)[np.abs(axis).argmin()]) < 1e-12


def test_a_field_is_half_as_wide_again_as_the_points_along_their_axes():
    rng = np.random.default_rng(3)
    spin = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    plane = rng.uniform(-1, 1, (80, 2)) * [3, 1] @ spin.T + [5, 2]
    centres, occupied = empty_space._grid_around(plane)
    axes = np.linalg.eigh(np.cov(plane.T))[1]
    local, ends = plane @ axes, [(plane @ axes).min(axis=0), (plane @ axes).max(axis=0)]
    side, low = 1.5 * (ends[1] - ends[0]), (ends[0] + ends[1]) / 2 - 0.75 * (ends[1] - ends[0])
    expected = [low + side * [(i + 0.5) / 32, (j + 0.5) / 32] for i in range(32) for j in range(32)]
    np.testing.assert_allclose(centres @ axes, expected, rtol=1e-9)
    cells = {tuple(np.floor((p - low - side / 2) / side * 32).astype(int)) for p in local}
    assert occupied == len(cells) < 80


@pytest.mark.parametrize("n", [3, 8, 60])
def test_rays_are_empty_up_to_the_nearest_thing_that_was_measured_beside_them(n, rng):
    plane, ranges, of_body = rng.normal(size=(n, 2)), rng.uniform(2, 5, n), rng.random(n) < 0.5
    plane[: n // 3] *= 0.05  # dense and sparse directions
    centres = rng.normal(size=(100, 2))
    ends, past = empty_space._empty_range(centres, plane, ranges, of_body)
    count = min(8, n - 1)
    radii = [1.25 * np.sort(np.linalg.norm(plane - p, axis=1))[count] for p in plane]
    for centre, end, passes in zip(centres, ends, past):
        away = np.linalg.norm(plane - centre, axis=1)
        within = away <= radii
        # of directions of like density the eight nearest are asked
        octave = np.floor(np.log2(np.maximum(radii / np.max(radii), 1e-6)))
        asked = np.zeros(n, dtype=bool)
        for number in set(octave):
            of = np.flatnonzero(octave == number)
            asked[of[np.argsort(away[of])[:count]]] = True
        near = within & asked
        assert end == pytest.approx(ranges[near].min() - 0.2 if near.any() else np.inf)
        assert passes == (not (near & of_body).any())


def test_rays_of_a_sensor_pass_the_body_and_end_where_it_may_end(rng):
    ball = random_directions(1500, 1)
    ball = ball[ball @ [0, 0, 1.0] > 0.2]
    wall = rng.uniform([-3, -3, -4], [3, 3, -4], (400, 3))
    behind = rng.uniform([-1, -1, 12], [1, 1, 13], (5, 3))  # not before the sensor
    points = np.concatenate([ball, wall, behind])
    inliers = np.arange(len(points)) < len(ball)
    found = empty_space._seen_from(EYE, points, inliers)
    frame = empty_space._frame_about(ball.mean(axis=0) - EYE)
    local = (points - EYE) @ frame
    ahead = local[:, 2] > 0
    assert (~ahead).sum() == 5
    plane = local[ahead, :2] / local[ahead, 2:]
    ranges, of_body = np.linalg.norm(points - EYE, axis=1)[ahead], inliers[ahead]
    near, far = ranges[of_body].min(), ranges[of_body].max()
    width = far * np.ptp(plane[of_body], axis=0).max()
    reach = max(far - near, width)
    centres, occupied = empty_space._grid_around(plane[of_body])
    ends, past = empty_space._empty_range(centres, plane, ranges, of_body)
    expected = []
    for (x, y), end, passes in zip(centres, ends, past):
        begin, end = max(near - reach, 0), min(end, far + reach)
        if passes and end > begin:
            towards = frame @ [x, y, 1] / np.sqrt(x * x + y * y + 1)
            expected.append([EYE + (begin + (end - begin) * k / 7) * towards for k in range(8)])
    np.testing.assert_allclose(found.rays, expected, rtol=1e-9)
    np.testing.assert_allclose(found.weights, [of_body.sum() / occupied] * len(expected))
    assert len(expected) > 50


def test_rays_begin_at_a_sensor_that_is_nearer_than_the_body_is_wide():
    """They go on behind what was seen by its width there, for they meet nothing that was measured."""
    ball = random_directions(900, 3)
    seen, eye = ball[ball[:, 2] > 0.6], np.array([0, 0, 1.7])
    found = empty_space._seen_from(eye, seen, np.ones(len(seen), dtype=bool))
    ranges = np.linalg.norm(seen - eye, axis=1)
    width = np.ptp((seen - eye)[:, :2] / (eye - seen)[:, 2:], axis=0).max()  # the axis of view is z but for a degree
    assert ranges.max() * width > ranges.min() and len(found.rays) > 50
    np.testing.assert_array_equal(found.rays[:, 0], np.broadcast_to(eye, (len(found.rays), 3)))
    ends = np.linalg.norm(found.rays[:, -1] - eye, axis=1)
    np.testing.assert_allclose(ends, ranges.max() * (1 + width), rtol=0.05)


def test_positions_with_few_inliers_show_no_outline():
    ball = random_directions(1200, 2)
    eyes = np.repeat([[0.0, 0, 10], [0.0, 10, 0], [10.0, 0, 0]], 400, axis=0)
    inliers = np.ones(1200, dtype=bool)
    inliers[:301] = False  # 99 of the first position, 400 and then 100 of the others are left
    inliers[900:] = False
    found = list(empty_space._of_views(Surroundings(eyes), ball, inliers))
    assert len(found) == 2
    expected = [empty_space._seen_from(eyes[k], ball[k : k + 400], inliers[k : k + 400]) for k in (400, 800)]
    for one, other in zip(found, expected):
        np.testing.assert_array_equal(one.rays, other.rays)
    assert list(empty_space._of_views(Surroundings(), ball, inliers)) == []


def test_of_many_positions_those_with_the_most_inliers_are_used():
    ball = random_directions(2000, 2)
    sizes = [110, 150, 200, 120, 300, 130, 140, 160, 170, 180, 340]
    eyes = np.repeat(np.eye(11)[:, :3] * 9 + np.arange(11)[:, None], sizes, axis=0)
    found = list(empty_space._of_views(Surroundings(eyes), ball, np.ones(2000, dtype=bool)))
    starts, order = np.cumsum([0, *sizes]), [10, 4, 2, 9, 8, 7, 1, 6]
    assert len(found) == 8
    for one, k in zip(found, order):
        of = slice(starts[k], starts[k + 1])
        expected = empty_space._seen_from(eyes[starts[k]], ball[of], np.ones(sizes[k], dtype=bool))
        np.testing.assert_array_equal(one.rays, expected.rays)


def test_the_plane_below_a_body_is_empty_around_its_points(rng):
    at, normal = np.array([5.0, 5, -1]), turned(1)[:, 2]
    points, inliers = rng.normal(size=(60, 3)), np.arange(60) < 50
    (found,) = empty_space._of_support(Surroundings(None, (at, normal)), points, inliers)
    frame = empty_space._frame_about(normal)
    local = [frame.T @ (p - at) for p in points[:50]]
    centres, occupied = empty_space._grid_around(np.array(local)[:, :2])
    expected = [at + frame @ [x, y, 0] for x, y in centres]
    np.testing.assert_allclose(found.rays.reshape(-1, 3), expected, rtol=1e-9, atol=1e-12)
    assert found.rays.shape == (128, 8, 3)
    np.testing.assert_allclose(found.weights, 8 * 50 / occupied)
    for count, some in ((8, False), (9, True)):
        assert (
            bool(list(empty_space._of_support(Surroundings(None, (at, normal)), points, np.arange(60) < count))) == some
        )
    both = empty_space.empty_space(Surroundings(None, (at, normal)), points, inliers)
    np.testing.assert_array_equal(both.rays, found.rays)
    np.testing.assert_array_equal(both.of_sample(0.5).weights, 0.5 * found.weights)
