"""Planes of slices and the part of their shifts in the linear problem, against sums over single points."""

import numpy as np
import pytest
from shapes_made import made, turned

from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.motion.slice_shifts import SHIFTING, SlicePlanes
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


def test_slices_of_six_points_or_more_lie_in_their_principal_planes():
    points, numbers = stack((12, 5, 6, 9), (0.0, 1.0, 2.5, 3.0))
    numbers = np.where(numbers == 30, -1, numbers)
    found = SlicePlanes.of([{"a": points}], [{"a": numbers}])
    assert found.numbers.tolist() == [0, 20] and found.counts.tolist() == [12, 6]
    for k, number in enumerate((0, 20)):
        inside = points[numbers == number]
        np.testing.assert_allclose(found.centres[k], inside.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(found.axes[k] @ found.axes[k].T, np.eye(2), atol=1e-12)
        np.testing.assert_allclose(found.axes[k] @ TURN[:, 2], 0, atol=1e-9)
    none = SlicePlanes.of([{"a": points}], [{"a": numbers * 0 - 1}])
    assert none.axes.shape == (0, 2, 3) and none.centres.shape == (0, 3) and none.unobservable().shape == (0, 0)


@pytest.mark.parametrize(("cosine", "parallel"), [(0.91, True), (0.89, False), (-0.91, True)])
def test_slices_are_parallel_above_a_cosine_of_nine_tenths(cosine, parallel):
    of = planes()
    normals = np.cross(of.axes[:, 0], of.axes[:, 1])
    tilted = cosine * normals[0] + np.sqrt(1 - cosine**2) * of.axes[0, 0]
    first = np.cross(tilted, of.axes[0, 0])
    first /= np.linalg.norm(first)
    axes = of.axes.copy()
    axes[1] = [first, np.cross(tilted, first)]
    assert SlicePlanes(of.numbers, axes, of.centres, of.counts).are_parallel == parallel


@pytest.mark.parametrize("counts", [(12, 12, 12, 12, 12), (8, 30, 10, 14, 9)])
def test_smooth_shifts_along_a_stack_are_not_observed(counts, rng):
    """Polynomials of the height of up to the third degree, along each of three axes, weighted by points."""
    heights = (0.0, 1.0, 2.5, 3.0, 4.6)
    of = planes(counts, heights)
    columns = of.unobservable()
    assert columns.shape == (10, 12)
    fractions = np.array(counts) / sum(counts)
    share = np.repeat(fractions, 2)
    for degree in range(4):
        direction = of.axes[0, 0]
        shifts = np.array([height**degree * axes @ direction for height, axes in zip(heights, of.axes)]).ravel()
        # weighted, it is a combination of the columns
        weighted = share * shifts
        left = weighted - columns @ np.linalg.lstsq(columns, weighted, rcond=None)[0]
        assert np.abs(left).max() < 1e-9 * np.abs(weighted).max()
    rough = share * np.repeat([1.0, -4, 6, -4, 1], 2)
    assert np.linalg.norm(rough - columns @ np.linalg.lstsq(columns, rough, rcond=None)[0]) > 1e-2


def test_of_slices_that_cross_only_the_mean_shift_is_not_observed():
    of = planes()
    axes = of.axes.copy()
    axes[1] = [axes[0, 0], np.cross(axes[0, 0], axes[0, 1])]
    columns = SlicePlanes(of.numbers, axes, of.centres, np.array([1.0, 3, 4])).unobservable()
    assert columns.shape == (6, 3)
    fractions = np.array([1, 3, 4]) / 8
    sign = np.sign(columns[0] @ axes[0, 0])
    np.testing.assert_allclose(sign * columns.reshape(3, 2, 3), fractions[:, None, None] * axes, atol=1e-9)


def test_shifts_are_in_the_planes_of_their_slices(rng):
    of, shifts = planes(), rng.normal(size=(3, 2))
    vectors = [s[0] * a[0] + s[1] * a[1] for s, a in zip(shifts, of.axes)]
    named = of.named(shifts)
    assert list(named) == [0, 10, 20]
    np.testing.assert_allclose(list(named.values()), vectors, rtol=1e-12)
    numbers = np.array([20, 5, 0, 10, 25, -1])
    expected = [vectors[2], 0 * vectors[0], vectors[0], vectors[1], 0 * vectors[0], 0 * vectors[0]]
    np.testing.assert_allclose(of.offsets(shifts, numbers), expected, rtol=1e-12)
    none = SlicePlanes(of.numbers[:0], of.axes[:0], of.centres[:0], of.counts[:0])
    np.testing.assert_array_equal(none.offsets(shifts[:0], numbers), np.zeros((6, 3)))


def test_the_part_of_the_shifts_is_that_of_targets_that_move(rng):
    """sum (B p - (o - s))' M (B p - (o - s)) over points with offsets o, by products of its terms."""
    surface = made()
    box, of, noise = ControlBox.around(surface, (2, 2, 2)), planes(), 0.02
    frames, plain = [], []
    for _ in range(2):
        n = 25
        root, offsets = rng.normal(size=(n, 3, 3)), rng.normal(size=(n, 3))
        metric, origins = root @ np.swapaxes(root, 1, 2), surface.grid(4)[0][:n]
        numbers = rng.choice([0, 10, 20, 7], n)
        rows = Rows(origins=origins, targets=origins + offsets, metric=metric)
        frames.append([(rows, numbers, offsets)])
        plain.append((origins, metric, numbers, offsets))
    coupling, own, right = of.bordered_block(frames, [box, box], noise)
    unobservable = of.unobservable()
    expected_own = (noise / SHIFTING.spread) ** 2 * (np.eye(6) + 1e6 * unobservable @ unobservable.T)
    expected, expected_right = np.zeros((6, 2, 24)), np.zeros(6)
    for frame, (origins, metric, numbers, offsets) in enumerate(plain):
        for origin, m, number, offset in zip(origins, metric, numbers, offsets):
            if number not in of.numbers:
                continue
            at = 2 * of.numbers.tolist().index(number)
            b = np.kron(box.matrix(origin[None])[0], np.eye(3))
            axes = of.axes[at // 2]
            expected_own[at : at + 2, at : at + 2] += axes @ m @ axes.T
            expected_right[at : at + 2] -= axes @ m @ offset
            expected[at : at + 2, frame] -= axes @ m @ b
    np.testing.assert_allclose(own, expected_own, rtol=1e-9)
    np.testing.assert_allclose(right, expected_right, rtol=1e-9)
    np.testing.assert_allclose(coupling, expected, rtol=1e-9, atol=1e-9)
