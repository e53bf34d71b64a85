"""Points of something else are left out of a fit; parts of the body that are no superquadric are not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions, ventricle

from quadriform import fit, fit_superquadric
from quadriform.fitting.connected import connection_distance
from quadriform.fitting.other_bodies import _of_one, extended_to_clouds, points_of_others


def left_out(points):
    """Which points (n,) are found to be of something else."""
    return points_of_others({"": points}, {"": fit_superquadric(points)})[""]


def tube(one, other, radius, count, rng):
    """Random points of a tube between two ends."""
    along = np.subtract(other, one)
    across = np.linalg.svd(along[None])[2][1:]
    angle = rng.uniform(0, 2 * np.pi, (count, 1))
    return (
        one + rng.uniform(0, 1, (count, 1)) * along + radius * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
    )


def test_a_neighbour_of_a_can_is_left_out_and_reported(rng):
    lid = even_directions(900) * [1, 1, 0.02] + [0, 0, 1.4]
    can = np.concatenate([tube((0, 0, -1.4), (0, 0, 1.4), 1.0, 3000, rng), lid])
    bottle = tube((2.4, 0.3, -1.4), (2.4, 0.3, 1.6), 0.6, 700, rng)
    table = np.column_stack([rng.uniform(-4, 4, (400, 2)), np.full(400, -1.4)])
    points = np.concatenate([can, bottle, table]) + 0.01 * rng.normal(size=(5000, 3))
    found = fit(points, box=(3, 3, 3))
    assert (found.inliers[:3900] > 0.5).mean() > 0.95
    assert not (found.inliers[3900:4600] > 0.5).any()
    assert found.model.mesh(resolution=16).vertices[:, 0].max() < 1.2
    assert str(int((found.inliers < 0.5).sum())) in repr(found)


@pytest.mark.parametrize("count", [2000, 5000])
def test_parts_of_a_body_that_is_no_superquadric_stay(count, rng):
    body = even_directions(count) * [2, 1, 1]
    legs = [tube((x, y, -0.7), (x, y, -2.2), 0.15, count // 16, rng) for x in (-1.2, 1.2) for y in (-0.4, 0.4)]
    cow = np.concatenate([body, *legs])
    pear = even_directions(count)
    pear = pear * (1 - 0.35 * pear[:, 2:]) * [1, 1, 1.5]
    for points in (cow, pear, ventricle(count)):
        assert (fit_superquadric(points).inliers < 0.5).mean() > 0.05  # the superquadric does leave some aside
        assert not left_out(points).any()


def test_slices_that_the_superquadric_leaves_aside_stay(rng):
    heights, around = np.linspace(-1, 1, 9), np.linspace(0, 2 * np.pi, 120, endpoint=False)
    slices = [np.column_stack([np.cos(around), np.sin(around), np.full(120, 1.6 * z)]) for z in heights]
    points = np.concatenate(slices)
    start, inliers = fit_superquadric(points), np.r_[np.zeros(120), np.ones(len(points) - 120)]
    assert not points_of_others({"": points}, {"": replace(start, inliers=inliers)})[""].any()


@pytest.mark.parametrize(("count", "other"), [(40, False), (99, False), (101, True), (300, True)])
def test_a_part_is_of_the_body_where_a_hundredth_of_it_is_near(count, other):
    """A line of outliers that leads away from a ball, with one point within the limit; and points far from both."""
    ball = np.concatenate([[[1.0, 0, 0]], even_directions(500)])
    step = 0.6 * connection_distance(ball)
    line = np.column_stack([1 + step * np.arange(1, count + 1), np.zeros((count, 2))])
    cloud = np.concatenate([line, ball, [[0, 90.0, 0], [0, 0, 90.0]]])
    inliers = np.concatenate([np.zeros(count), np.ones(501), np.zeros(2)])
    found = _of_one("a", {"a": cloud}, {"a": SimpleNamespace(inliers=inliers)})
    expected = np.concatenate([np.full(count, other), np.zeros(501, dtype=bool), [True, True]])
    np.testing.assert_array_equal(found, expected)
    assert not _of_one("a", {"a": ball}, {"a": SimpleNamespace(inliers=np.ones(501))}).any()


def test_of_a_sample_each_point_is_as_the_nearest_of_it():
    cloud, index = np.arange(10.0)[:, None] * [1, 0, 0], np.array([1, 8])
    found = extended_to_clouds({"": np.array([False, True])}, {"": cloud}, {"": index})[""]
    assert found.tolist() == [False] * 5 + [True] * 5
