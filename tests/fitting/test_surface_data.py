"""A surface with its data: thinning that knows no order, inliers by their distance, foot points that face the data."""

from dataclasses import replace

import numpy as np
import pytest
from shapes_made import even_directions, lumpy, made, turned

from quadriform.fitting.refinement.correspondence import MODEL_RESOLUTION, Correspondence
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.surface_data import OrientedCloud, SurfaceData, inlier_probabilities, with_excess
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

BALL = Superquadric("ellipsoid", (1.0, 1.0, 1.0), (1.0, 1.0), np.eye(3), (0.0, 0.0, 0.0))
CLOUD = Frame.of(lumpy(900)).to_local(lumpy(900))


def data_of(points=CLOUD, weights=None, half_space=None):
    return SurfaceData.of(BALL, points, np.ones(len(points)) if weights is None else weights, half_space)


@pytest.mark.parametrize("robust", [False, True])
def test_the_same_few_points_whatever_the_order_and_the_pose(robust, rng):
    order, turn = rng.permutation(len(CLOUD)), turned(4)
    plain = data_of().subsample(250, robust).points
    assert plain.shape == (250, 3)
    np.testing.assert_array_equal(data_of(CLOUD[order]).subsample(250, robust).points, plain)
    np.testing.assert_allclose(data_of(CLOUD[order] @ turn.T).subsample(250, robust).points, plain @ turn.T, atol=1e-12)


def test_points_keep_their_weights(rng):
    weights = rng.uniform(1, 2, len(CLOUD))
    few = data_of(weights=weights).subsample(100, False)
    for point, weight in zip(few.points, few.weights):
        assert weight == weights[np.flatnonzero((point == CLOUD).all(axis=1))[0]]
    assert len(data_of().subsample(5000, False).points) == len(CLOUD)


def test_isolated_points_are_left_out_only_where_requested(rng):
    outliers = rng.uniform(-6, 6, (60, 3))
    outliers = outliers[np.linalg.norm(outliers, axis=1) > 2.5]
    both = data_of(np.concatenate([CLOUD, outliers]))
    assert (np.linalg.norm(both.subsample(500, True).points, axis=1) < 2.5).all()
    assert (np.linalg.norm(both.subsample(500, False).points, axis=1) > 2.5).any()


@pytest.mark.parametrize("outlier_ratio", [0.0, 0.1, 0.3])
def test_the_ratio_of_outliers_is_found(outlier_ratio, rng):
    n, sigma = 4000, 0.02
    distances = np.abs(rng.normal(0, sigma, n))
    outlier = np.arange(n) < outlier_ratio * n
    distances[outlier] = rng.uniform(0, 2, outlier.sum())
    one = data_of(rng.normal(size=(n, 3)))
    one = one.with_inliers_at_distances(distances, sigma)
    assert one.inliers.mean() == pytest.approx(1 - outlier_ratio, abs=0.015)
    assert (one.inliers[distances > 6 * sigma] < 0.05).all()
    assert (one.inliers[distances < sigma] > 0.9).all()


def test_weights_count_in_the_inlier_ratio(rng):
    """Outliers that count ten times as much make it likelier that an uncertain point is one."""
    distances = np.concatenate([np.abs(rng.normal(0, 0.02, 900)), rng.uniform(0.2, 2, 100)])
    plain, heavy = data_of(rng.normal(size=(1000, 3))), data_of(rng.normal(size=(1000, 3)))
    heavy = replace(heavy, weights=np.where(distances > 0.15, 10.0, 1.0))
    plain, heavy = (one.with_inliers_at_distances(distances, 0.02) for one in (plain, heavy))
    between = (distances > 0.05) & (distances < 0.15)
    assert between.any() and (heavy.inliers[between] < plain.inliers[between]).all()


def test_half_of_a_sphere_is_covered_only_with_its_base():
    half = even_directions(1500)
    half = half[half[:, 2] < 0]
    assert data_of(even_directions(800)).is_covered()
    assert not data_of(half).is_covered()
    based = data_of(half, half_space=(np.zeros(3), np.array([0.0, 0.0, 1.0])))
    assert based.is_covered()
    np.testing.assert_array_equal(based.in_half_space(np.array([[0, 0, 0.1], [5, 0, -0.1]])), [True, False])
    assert not data_of(half).in_half_space(half).any()


PLATE = Superquadric("ellipsoid", (1.0, 1.0, 0.05), (1.0, 1.0), np.eye(3), (0.0, 0.0, 0.0))


def facing(superquadric, cloud):
    pairs = Correspondence.between(superquadric, cloud)
    return pairs.matched(pairs.costs(ControlBox.around(superquadric)))


def crossed_over(flatness):
    """Points just below the middle of a thin plate that face up."""
    points = np.column_stack([0.5 * even_directions(200)[:, :2], np.full(200, -0.02)])
    return OrientedCloud(points, np.tile([0.0, 0, 1], (200, 1)), np.full(200, flatness))


def test_a_point_belongs_to_the_side_that_faces_as_it_does():
    assert (facing(PLATE, crossed_over(1.0))[:, 2] > 0).all()


def test_a_normal_without_trust_does_not_count():
    assert (facing(PLATE, crossed_over(0.0))[:, 2] < 0).all()


def test_model_points_without_a_data_point_are_attracted_to_data():
    """Upper half matched: the lower half's model points choose data points below, near and facing alike."""
    cloud = OrientedCloud(even_directions(600), even_directions(600), np.ones(600))
    grid, _ = BALL.grid(MODEL_RESOLUTION)
    pairs = Correspondence.between(BALL, cloud)
    costs = pairs.costs(ControlBox.around(BALL))
    origins, targets = pairs.unmatched(costs, grid[grid[:, 2] > 0])
    assert len(origins) == (grid[:, 2] <= 0).sum()
    assert np.linalg.norm(origins - targets, axis=1).max() < 0.2
    remaining, targets = pairs.unmatched(costs, grid)
    assert len(remaining) == len(targets) == 0


def test_data_attracts_along_the_normal_and_hardly_along_the_surface(rng):
    """The metric of each point, by its weight and inlier probability, on a sphere where the normal is the radius."""
    points = even_directions(600)
    one = data_of(points, weights=rng.uniform(1, 3, 600))
    one = replace(one, origins=points, inliers=rng.uniform(0.5, 1, 600))
    metric = data_rows(one, ControlBox.around(BALL)).metric
    count = one.weights * one.inliers
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", points, metric, points), count, rtol=1e-9)
    values = np.linalg.eigvalsh(metric)
    assert (values[:, :2].max(axis=1) < 0.01 * count).all() and (values[:, 0] > 0).all()


@pytest.mark.parametrize("count", [30, 3000])
def test_a_contour_holds_the_surface_along_its_normal_alone(count):
    """Old bug: many points on a contour held the surface across it too, few did not. On the equator of a sphere."""
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    one = data_of(points)
    one = replace(one, origins=points)
    metric = data_rows(one, ControlBox.around(BALL)).metric
    along = np.column_stack([-np.sin(t), np.cos(t), 0 * t])
    assert (metric[:, 2, 2] < 0.01).all()
    assert (np.einsum("ni,nij,nj->n", along, metric, along) < 0.01).all()


def test_toroids_are_matched_too():
    ring = made("toroid", (1, 1))
    grid, _ = ring.grid(12)
    normals = ring.gradient(grid) / np.linalg.norm(ring.gradient(grid), axis=1, keepdims=True)
    found = facing(ring, OrientedCloud(grid, normals, np.ones(len(grid))))
    assert np.linalg.norm(found - grid, axis=1).max() < 0.15 * np.linalg.norm(np.ptp(grid, axis=0))


def test_the_inlier_ratio_stays_below_one(rng):
    """Where all points are inliers a later outlier is still distinguished from them."""
    found = data_of()
    found = found.with_inliers_at_distances(np.abs(rng.normal(size=len(CLOUD))) * 1e-3, sigma=1e-3)
    assert 0.9 < found.inlier_ratio < 1
    assert inlier_probabilities(np.array([1.0]), 1e-3, found.inlier_ratio)[0] < 1e-3
    assert inlier_probabilities(np.array([1e-4]), 1e-3, found.inlier_ratio)[0] > 0.9


def test_the_excess_is_the_variance_that_known_errors_leave_open(rng):
    """Residuals whose squares are known variances and a constant: the constant, in units of the mean known one."""
    variances, least = rng.uniform(0.2, 3.0, len(CLOUD)), 0.1
    # isotropic covariances count 1 + 3 / 100 times, for their lower bound
    covariances = variances[:, None, None] * np.eye(3) / 1.03
    directions = CLOUD / np.linalg.norm(CLOUD, axis=1)[:, None]
    box = ControlBox.around(BALL, (3, 3, 3))
    for excess in (0.7, 0.0):
        residuals = least * np.sqrt(variances + excess) * rng.choice([-1, 1], len(CLOUD))
        points, weights = (1 + residuals)[:, None] * directions, rng.uniform(1, 2, len(CLOUD))
        data = SurfaceData.of(BALL, points, weights, covariances=covariances, least_sigma=least)
        data = replace(data, origins=directions)
        (found,) = with_excess([data], [box])
        assert found.excess == pytest.approx(excess, abs=1e-9)
        np.testing.assert_allclose(found.variances(directions), (variances + excess) / (1 + excess), rtol=1e-6)
    (smaller,) = with_excess([replace(data, least_sigma=0.2)], [box])
    assert smaller.excess == 0


def test_points_of_no_known_noise_are_alike():
    data = data_of()
    (found,) = with_excess([data], [ControlBox.around(BALL, (3, 3, 3))])
    assert found is data and (found.variances(CLOUD) == 1).all()
