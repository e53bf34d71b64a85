"""Point sets of the paper's figures: their sizes, their geometry, and the same bytes every time."""

import numpy as np
import pytest

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.examples import ARMS, ROUNDED_BOX

SETS = {
    "rounded_box": lambda: qf.examples.rounded_box("natural", 6),
    "crossing_superquadrics": lambda: qf.examples.crossing_superquadrics(8),
    "ventricle": lambda: qf.examples.ventricle(8),
    "noisy": lambda: qf.examples.noisy(qf.examples.ventricle(8)),
    "with_outliers": lambda: qf.examples.with_outliers(qf.examples.ventricle(8), 0.25),
    "three_planes": lambda: qf.examples.three_planes(qf.examples.ventricle(8), 100),
    "regular_grid": lambda: qf.examples.regular_grid(qf.examples.ventricle(16), 100),
}


@pytest.mark.parametrize("make", SETS.values(), ids=SETS)
def test_sets_are_finite_points_and_the_same_every_time(make):
    points = make()
    assert points.shape == (len(points), 3) and points.dtype == np.float64
    assert np.isfinite(points).all()
    assert np.array_equal(points, make())


def test_both_parametrisations_lie_on_the_rounded_box_and_its_grid_is_closed():
    for name in ("natural", "regular"):
        points = qf.examples.rounded_box(name, 6)
        assert len(points) == 7 * 13
        assert ROUNDED_BOX.implicit(points) == pytest.approx(1, abs=1e-9)
        grid = points.reshape(7, 13, 3)
        assert grid[0] == pytest.approx(np.tile([0, 0, -30.0], (13, 1)), abs=1e-2)  # a pole
        assert grid[:, 0] == pytest.approx(grid[:, -1], abs=1e-2)  # the seam
    with pytest.raises(OptionError, match="'natural', 'regular'"):
        qf.examples.rounded_box("even")


def test_crossing_superquadrics_keep_their_outer_points():
    points = qf.examples.crossing_superquadrics(8)
    straight = points[:, :2] / (1 - 0.35 * points[:, 2:] / 50)  # the taper undone
    local = np.column_stack([straight, points[:, 2]])
    half, width = ARMS
    arms = [qf.Superquadric(semi_axes=np.where(np.arange(3) == k, half, width), exponents=(0.6, 0.6)) for k in range(3)]
    values = np.stack([arm.implicit(local) for arm in arms])
    assert values.min(axis=0) == pytest.approx(1, abs=1e-9)


def test_sizes_are_the_papers():
    points = qf.examples.ventricle()
    assert len(points) == pytest.approx(6000, rel=0.03)
    assert np.ptp(points[:, 2]) == pytest.approx(100, abs=8)
    assert len(qf.examples.three_planes(points)) == 600
    assert len(qf.examples.regular_grid(points)) == pytest.approx(900, rel=0.1)


def test_three_planes_are_orthogonal_cuts():
    grid = np.stack(np.meshgrid(*(np.arange(-n, n + 1.0) for n in (6, 5, 4)), indexing="ij"), axis=-1).reshape(-1, 3)
    count = int((grid == 0).any(axis=1).sum())
    found = qf.examples.three_planes(grid, count)
    assert len(found) == count
    assert (np.abs(found).min(axis=1) < 1e-9).all()


def test_a_regular_grid_is_where_lattice_lines_meet_the_surface():
    """Of a sphere; twice as many points as lines that meet it, all near a line of one and the same lattice."""
    ball = qf.Superquadric(semi_axes=(50, 50, 50)).mesh(60).vertices
    found = qf.examples.regular_grid(ball, 300)
    assert len(np.unique(found, axis=0)) == len(found) == pytest.approx(300, rel=0.1)
    assert {tuple(point) for point in found} <= {tuple(point) for point in ball}
    spacings = np.ptp(ball, axis=0).max() / np.geomspace(1, 40, 60)
    off = [np.sort(np.abs((found / h + 0.5) % 1 - 0.5), axis=1)[:, :2] for h in spacings]
    assert min(np.linalg.norm(two, axis=1).max() for two in off) < 0.25


def test_outliers_are_a_ratio_of_the_points_and_the_others_are_untouched():
    points = qf.examples.ventricle(8)
    dirty = qf.examples.with_outliers(points, 0.25)
    moved = (dirty != points).any(axis=1)
    assert moved.sum() == round(0.25 * len(points))
    assert np.array_equal(qf.examples.with_outliers(points, 0.0), points)


def test_what_is_no_cloud_is_refused():
    for reduce in (qf.examples.three_planes, qf.examples.regular_grid, qf.examples.noisy):
        with pytest.raises(PointsError):
            reduce(np.zeros((4, 2)))
