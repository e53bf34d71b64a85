"""Planes of slices, their motions, and the part of these in the linear problem, against sums over single points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes_made import made, turned

from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.motion.slice_motions import SlicePlanes
from quadriform.shapes.control_box import ControlBox

TURN = turned(3)


def stack(counts=(12, 12, 12), heights=(0.0, 1.0, 2.5), seed=1):
    """Points of slices across the third axis of a turned frame, and their numbers."""
    rng = np.random.default_rng(seed)
    points = [np.column_stack([rng.normal(size=(n, 2)) * [3, 2], np.full(n, z)]) for n, z in zip(counts, heights)]
    numbers = np.repeat(np.arange(len(counts)) * 10, counts)
    return np.concatenate(points) @ TURN.T + 1, numbers


def planes(*of, **how):
    points, numbers = stack(*of, **how)
    return SlicePlanes.of([{"a": points[::2]}, {"a": points[1::2]}], [{"a": numbers[::2]}, {"a": numbers[1::2]}])


def crossed():
    """Three slices, the second of which lies across the others."""
    of = planes()
    axes = of.axes.copy()
    axes[1] = axes[1][[0, 2, 1]] * [[1], [1], [-1]]
    return SlicePlanes(of.numbers, axes, of.centres)


def test_slices_of_six_points_or_more_lie_in_their_principal_planes():
    points, numbers = stack((12, 5, 6, 9), (0.0, 1.0, 2.5, 3.0))
    numbers = np.where(numbers == 30, -1, numbers)
    found = SlicePlanes.of([{"a": points}], [{"a": numbers}])
    assert found.numbers.tolist() == [0, 20]
    for k, number in enumerate((0, 20)):
        inside = points[numbers == number]
        np.testing.assert_allclose(found.centres[k], inside.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(found.axes[k] @ found.axes[k].T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(found.axes[k]), 1, rtol=1e-12)
        np.testing.assert_allclose(found.axes[k][:2] @ TURN[:, 2], 0, atol=1e-9)
    none = SlicePlanes.of([{"a": points}], [{"a": numbers * 0 - 1}])
    assert none.axes.shape == (0, 3, 3) and none.centres.shape == (0, 3) and none.gauge_fields().shape == (0, 0)


@pytest.mark.parametrize(("cosine", "parallel"), [(0.91, True), (0.89, False), (-0.91, True)])
def test_slices_are_parallel_above_a_cosine_of_nine_tenths(cosine, parallel):
    of = planes()
    first, second, normal = of.axes[0]
    axes = of.axes.copy()
    sine = np.sqrt(1 - cosine**2)
    axes[1] = [cosine * first - sine * normal, second, cosine * normal + sine * first]
    assert SlicePlanes(of.numbers, axes, of.centres).are_parallel == parallel


def in_axes(of, shifts, rotations):
    """Motions (S, 6) along the axes of the slices."""
    return np.concatenate([np.einsum("ska,sa->sk", of.axes, each) for each in (shifts, rotations)], axis=1)


def test_of_slices_that_cross_the_gauge_fields_are_the_rigid_motions(rng):
    of = crossed()
    fields = of.gauge_fields()
    assert fields.shape == (18, 6) and np.linalg.matrix_rank(fields) == 6
    shift, rotation = rng.normal(size=(2, 3))
    rigid = in_axes(of, shift + np.cross(rotation, of.centres), np.tile(rotation, (3, 1))).ravel()
    np.testing.assert_allclose(fields @ np.linalg.lstsq(fields, rigid, rcond=None)[0], rigid, atol=1e-9)
    # they move all points of all slices together, to first order
    points, numbers = stack()
    moved = of.moved(1e-6 * rigid.reshape(3, 6), numbers, points) - points
    np.testing.assert_allclose(1e6 * moved, shift + np.cross(rotation, points), atol=1e-4)


@pytest.mark.parametrize(("count", "degrees"), [(1, 1), (3, 3), (6, 4)])
def test_polynomials_along_a_stack_are_gauge_fields(count, degrees):
    """Up to the third degree, as far as there are slices to tell them apart: a single slice cannot move at all."""
    heights = np.array([0.0, 1.0, 2.5, 3.0, 4.6, 5.0])[:count]
    of = planes(tuple([12] * count), tuple(heights))
    fields = of.gauge_fields()
    assert np.linalg.matrix_rank(fields) == 3 * degrees

    def missed(power):
        """How much of a shift by a power of the height is no gauge field."""
        shifts = in_axes(of, (heights / 5)[:, None] ** power * TURN[:, 0], np.zeros((count, 3))).ravel()
        return np.abs(fields @ np.linalg.lstsq(fields, shifts, rcond=None)[0] - shifts).max()

    assert all(missed(power) < 1e-9 for power in range(degrees))
    assert count <= 4 or missed(4) > 1e-3


def test_slices_move_rigidly_about_their_centres(rng):
    of, motions = crossed(), 0.3 * rng.normal(size=(3, 6))
    points, numbers = stack()
    numbers = np.where(numbers == 20, 99, numbers)
    found = of.moved(motions, numbers, points)
    for k, number in enumerate((0, 10)):
        inside, axes = numbers == number, of.axes[k]
        rotation = Rotation.from_rotvec(motions[k, 3:] @ axes).as_matrix()
        expected = (points[inside] - of.centres[k]) @ rotation.T + of.centres[k] + motions[k, :3] @ axes
        np.testing.assert_allclose(found[inside], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[numbers == 99], points[numbers == 99])
    none = SlicePlanes(of.numbers[:0], of.axes[:0], of.centres[:0])
    np.testing.assert_array_equal(none.moved(motions[:0], numbers, points), points)


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.4])
def test_derivatives_are_those_of_the_moved_points(size, rng):
    of, motions = planes(), size * rng.normal(size=(3, 6))
    points, numbers = stack()
    left, step = of.targets(motions, numbers, points), 1e-6
    for k in range(6):
        ahead, behind = (of.moved(motions + sign * step * np.eye(6)[k], numbers, points) for sign in (1, -1))
        for index, number in enumerate(of.numbers):
            inside = numbers == number
            found = of._derivatives(index, motions[index], points[inside])[:, k]
            np.testing.assert_allclose(found, (ahead - behind)[inside] / (2 * step), atol=1e-8)
    for index, number in enumerate(of.numbers):
        inside = numbers == number
        linear = np.einsum("nka,k->na", of._derivatives(index, motions[index], points[inside]), motions[index])
        np.testing.assert_allclose(left[inside] + linear, of.moved(motions, numbers, points)[inside], atol=1e-9)


def test_the_part_of_the_motions_is_that_of_targets_that_move(rng):
    """sum (B p - (o + J q))' M (B p - (o + J q)) over points with offsets o, by products of its terms."""
    surface = made()
    box, of = ControlBox.around(surface, (2, 2, 2)), planes()
    motions, frames = 0.2 * rng.normal(size=(3, 6)), []
    expected_own, expected, expected_right = np.zeros((18, 18)), np.zeros((18, 2, 24)), np.zeros(18)
    for frame in range(2):
        n = 25
        root, offsets = rng.normal(size=(n, 3, 3)), rng.normal(size=(n, 3))
        metric, origins = root @ np.swapaxes(root, 1, 2), surface.grid(4)[0][:n]
        points, numbers = rng.normal(size=(n, 3)), rng.choice([0, 10, 20, 7], n)
        frames.append([(Rows(origins, origins + offsets, metric), numbers, points)])
        for origin, m, number, offset, point in zip(origins, metric, numbers, offsets, points):
            if number not in of.numbers:
                continue
            index = of.numbers.tolist().index(number)
            at = slice(6 * index, 6 * index + 6)
            b = np.kron(box.matrix(origin[None])[0], np.eye(3))
            j = of._derivatives(index, motions[index], point[None])[0]
            expected_own[at, at] += j @ m @ j.T
            expected_right[at] -= j @ m @ offset
            expected[at, frame] -= j @ m @ b
    coupling, own, right = of.bordered_block(frames, [box, box], motions)
    np.testing.assert_allclose(own, expected_own, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, expected_right, rtol=1e-9)
    np.testing.assert_allclose(coupling, expected, rtol=1e-9, atol=1e-9)
