"""Each part of initial superquadrics against plain formulas: moments, quadrics, tori, parts of a cloud, axes."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes_made import SKEW, even_directions, made, turned

from quadriform.fitting.superquadric import initial
from quadriform.fitting.superquadric.initial import START
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.superquadric import Superquadric


def lopsided(n=60, seed=4):
    """Points with unequal extents and long tails, moved and turned."""
    return np.random.default_rng(seed).gamma(1.5, size=(n, 3)) * [1, 2, 3] @ SKEW.T + [4, -2, 7]


def ring(fold, n=6, seed=0):
    """Points with a symmetry about the z axis by one turn over `fold`, and no other, their second moments round."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    turns = Rotation.from_rotvec(np.outer(np.arange(fold) * 2 * np.pi / fold, [0, 0, 1])).as_matrix()
    return np.concatenate([points @ turn.T for turn in turns])


def test_the_long_axes_point_to_the_side_of_the_longer_tail():
    points = lopsided()
    centre, axes, _ = initial.principal_frame(points)
    third = ((points - centre) @ axes) ** 3
    assert (third.sum(axis=0)[1:] > 0).all()
    np.testing.assert_allclose(np.linalg.det(axes), 1)
    mirrored = initial.principal_frame(-points)[1]
    np.testing.assert_allclose(mirrored[:, 1:], -axes[:, 1:], atol=1e-9)


def test_points_in_a_plane_start_as_a_very_thin_ellipsoid(rng):
    points = rng.normal(size=(50, 3)) * [1, 2, 0]
    sizes = initial.ellipsoid_by_moments(points).semi_axes
    np.testing.assert_allclose(sizes.min() / sizes.max(), 1e-6, rtol=1e-9)
    assert np.sort(sizes)[1] > 0.1 * sizes.max()


@pytest.mark.parametrize("end", [1.0, 0.2, -0.4])
def test_the_quadric_of_a_part_of_an_ellipsoid_has_its_centre_and_axes(end):
    surface = made(exponents=(1, 1))
    u = even_directions(400)
    points = surface.surface(u[u[:, 1] < end])
    centre, axes = initial.quadric_frame(points)
    np.testing.assert_allclose(centre, surface.translation, atol=1e-7)
    np.testing.assert_allclose(np.sort(np.abs(axes.T @ SKEW), axis=0)[2], 1, rtol=1e-9)


def test_a_quadric_with_a_far_centre_or_none_has_the_centre_of_the_points(rng):
    x, y = rng.uniform(-1, 1, (2, 200))
    paraboloid = np.stack([x, y, x * x + 3 * y * y], axis=1)
    expected = [0, 0, paraboloid[:, 2].mean()]  # along its axis nothing is a centre
    np.testing.assert_allclose(initial.quadric_frame(paraboloid)[0], expected, atol=1e-12)
    cap = even_directions(4000) * 5
    for height, inside in ((4.9, False), (3.0, True)):
        points = cap[cap[:, 2] > height]
        off = points[:, 2].mean() / np.ptp(points, axis=0).max()
        assert (off < 1) == inside
        expected = np.zeros(3) if inside else points.mean(axis=0)
        np.testing.assert_allclose(initial.quadric_frame(points)[0], expected, atol=1e-9)


def test_the_ellipsoid_of_a_sphere_is_the_sphere():
    found = initial.ellipsoid_by_moments(3 * even_directions(2000) + np.array([1, 2, 3]))
    np.testing.assert_allclose(found.semi_axes, 3, rtol=1e-3)
    np.testing.assert_allclose(found.translation, [1, 2, 3], atol=1e-3)
    np.testing.assert_array_equal(found.exponents, 1)


@pytest.mark.parametrize(("reach", "height"), [(4.0, 9.09), (9.05, 9.09), (9.2, 9.2)])
def test_two_sheets_are_cut_where_points_end_and_behind_their_tips(reach, height):
    centre, sizes = np.array([1.0, 2, 3]), np.array([9.0, 1.0, 2.0])
    points = centre + np.array([[reach, 1, 2], [-3.9, 0, 5], [0, -11, 0]])
    found = initial._hyperboloid(points, "hyperboloid2", centre, np.eye(3), sizes)
    assert found.height == pytest.approx(height)


def test_a_torus_has_the_means_and_deviations_of_its_points():
    points = lopsided()
    centre, axes = points.mean(axis=0), turned(2)
    found = initial._torus_about(points, centre, axes)
    local = [axes.T @ (p - centre) for p in points]
    rms = [np.sqrt(np.mean([p[k] ** 2 for p in local])) for k in range(3)]
    around = [np.hypot(p[0] / rms[0], p[1] / rms[1]) for p in local]
    mean = sum(around) / len(around)
    tube = np.sqrt(2 * sum((a - mean) ** 2 for a in around) / len(around))
    np.testing.assert_allclose(found.semi_axes, [tube * rms[0], tube * rms[1], np.sqrt(2) * rms[2]], rtol=1e-12)
    np.testing.assert_allclose(found.hole_radius, max(1.2, mean / tube), rtol=1e-12)
    np.testing.assert_array_equal(found.rotation, axes)
    np.testing.assert_array_equal(found.translation, centre)
    np.testing.assert_array_equal(found.exponents, 1)


def test_a_torus_without_a_hole_is_given_a_small_one(rng):
    ball = rng.normal(size=(500, 3))
    assert initial._torus_about(ball, np.zeros(3), np.eye(3)).hole_radius > 1.2
    ball[::2] *= 0.1
    assert initial._torus_about(ball, np.zeros(3), np.eye(3)).hole_radius == 1.2


def test_tori_lie_about_each_axis_of_both_frames():
    points = made("toroid", (1, 1)).grid(6)[0]
    found = initial.tori(points)
    frames = [initial.principal_frame(points)[1], initial.quadric_frame(points)[1]]
    expected = [axes[:, k] for axes in frames for k in (2, 1, 0)]
    np.testing.assert_allclose([np.abs(t.rotation[:, 2] @ e) for t, e in zip(found, expected)], 1, rtol=1e-12)
    np.testing.assert_allclose([np.linalg.det(t.rotation) for t in found], 1, rtol=1e-12)
    best = min(found, key=lambda torus: sum((f - 1) ** 2 for f in torus.implicit(points)))
    np.testing.assert_array_equal(initial.toroid_by_moments(points).parameters, best.parameters)


@pytest.mark.parametrize(("kind", "signs"), [("hyperboloid1", (1, 1, -1)), ("hyperboloid2", (1, -1, -1))])
def test_hyperboloids_are_the_nearest_quadrics_about_candidate_axes_the_best_first(kind, signs, rng):
    surface = made(kind, (1, 1))
    points = surface.grid(6)[0]
    points = points + 0.1 * rng.normal(size=points.shape)
    found = initial.hyperboloids(points, kind)
    assert len(found) > 1
    costs = []
    for each in found:
        local = (points - each.translation) @ each.rotation
        squares = np.array(signs) * local**2
        normal = squares.T @ squares
        coefficients = np.linalg.solve(normal, squares.sum(axis=0))
        np.testing.assert_allclose(each.semi_axes, 1 / np.sqrt(coefficients), rtol=1e-6)
        costs.append(((squares @ coefficients - 1) ** 2).sum())
        axis = 2 if kind == "hyperboloid1" else 0
        cut = np.abs(local[:, axis]).max()
        expected = cut if kind == "hyperboloid1" else max(cut, 1.01 * each.semi_axes[0])
        np.testing.assert_allclose(each.height, expected, rtol=1e-12)
        np.testing.assert_array_equal(each.exponents, 1)
    assert (np.diff(costs) >= -1e-9 * min(costs)).all()


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid", "hyperboloid1", "hyperboloid2"])
def test_a_surface_is_cut_where_the_points_end(kind):
    surface = made(kind)
    axis = {"hyperboloid1": 2, "hyperboloid2": 0}.get(kind)
    assert initial.cut_to(surface, np.zeros((0, 3))) is surface
    for far in (1.0, 20.0):
        points = (np.eye(3) * far * [1, 2, -3]) @ SKEW.T + surface.translation
        found = initial.cut_to(surface, points)
        if axis is None:
            assert found is surface
            continue
        least = 1.001 * surface.semi_axes[0] if axis == 0 else 0.0
        np.testing.assert_allclose(found.height, max(far * [1, 2, 3][axis], least), rtol=1e-12)


@pytest.mark.parametrize("n", [2, 5, 9, 10, 11, 40])
def test_reach_is_the_distance_to_the_ninth_neighbour_or_to_the_last(n, rng):
    cloud = rng.normal(size=(n, 3))
    expected = [np.sort([np.linalg.norm(p - q) for q in cloud])[min(9, n - 1)] for p in cloud]
    np.testing.assert_allclose(initial.neighbour_distance(cloud, cloud), expected, rtol=1e-12)


def test_isolated_points_and_the_sparser_half_are_left_out(rng):
    points = np.concatenate([rng.normal(size=(80, 3)), 3 * rng.normal(size=(20, 3)), [[30, 0, 0]]])
    far = initial.neighbour_distance(points, points)
    without, dense = initial.dense_parts(points)
    np.testing.assert_array_equal(without, far <= 2 * np.median(far))
    np.testing.assert_array_equal(dense, far <= np.quantile(far, 0.4))
    assert 0 < dense.sum() < without.sum() < len(points)


def test_sides_hold_two_fifths_of_the_core_beyond_26_planes():
    points = lopsided(101)
    core = np.arange(101) % 5 > 0
    found = initial.sides(points, core)
    offset = points - points[core].mean(axis=0)
    axes = np.linalg.eigh(offset[core].T @ offset[core])[1]
    directions = [d for d in product((-1, 0, 1), repeat=3) if d != (0, 0, 0)]
    assert found.shape == (26, 101)
    for row, direction in zip(found, directions):
        height = offset @ axes @ direction
        np.testing.assert_array_equal(row, core & (height <= np.quantile(height[core], 0.4)))


def plain_moments(points, weights):
    """Weighted centre and second moments, term by term."""
    if not weights.any():
        weights = np.ones(len(points))
    centre = sum(w * p for w, p in zip(weights, points)) / weights.sum()
    second = sum(w * np.outer(p - centre, p - centre) for w, p in zip(weights, points)) / weights.sum()
    return centre, second


def test_moments_axes_and_ellipsoids_of_weighted_parts(rng):
    points = rng.normal(size=(30, 3)) * [1, 2, 3] @ SKEW.T + 1
    weights = np.stack([rng.uniform(0, 2, 30), np.zeros(30), (np.arange(30) < 12).astype(float)])
    rotations = np.stack([[turned(3 * h + k) for k in range(2)] for h in range(3)])
    found = initial.ellipsoids(points, weights, rotations)
    axes = initial.principal_axes(points, weights)
    for part, row in enumerate(weights):
        centre, second = plain_moments(points, row)
        values = np.diag(axes[part].T @ second @ axes[part])
        np.testing.assert_allclose(axes[part].T @ second @ axes[part], np.diag(values), atol=1e-12)
        assert (np.diff(values) > 0).all()
        np.testing.assert_allclose(np.linalg.det(axes[part]), 1)
        for k, rotation in enumerate(rotations[part]):
            at = 2 * part + k
            variances = [rotation[:, a] @ second @ rotation[:, a] for a in range(3)]
            np.testing.assert_allclose(np.exp(found.log_axes[at]) ** 2, 3 * np.array(variances), rtol=1e-9)
            np.testing.assert_allclose(found.translations[at], centre, rtol=1e-12)
            np.testing.assert_array_equal(found.rotations[at], rotation)
    np.testing.assert_array_equal(found.exponents, np.ones((6, 2)))
    np.testing.assert_array_equal(found.log_holes, np.zeros((6, 1)))


def test_no_ellipsoid_is_thinner_than_a_hundredth(rng):
    flat = rng.normal(size=(30, 3)) * [1, 2, 0]
    sizes = np.exp(initial.ellipsoids(flat, np.ones((1, 30)), np.eye(3)[None, None]).log_axes[0])
    np.testing.assert_allclose(sizes[2] / sizes.max(), START.thinnest, rtol=1e-9)


def test_axes_of_weighted_parts_follow_the_weights_where_eigenvalues_are_equal(rng):
    """A square prism of weighted points among unweighted ones: its sides are found, whatever the rest is."""
    prism = np.array(list(product((-1.0, 1.0), (-1.0, 1.0), (-3.0, 0.0, 3.0)))) @ SKEW.T
    points = np.concatenate([prism, rng.normal(size=(20, 3))])
    weights = np.concatenate([np.full(len(prism), 4.0), np.zeros(20)])
    axes = initial.principal_axes(points, weights[None])[0]
    np.testing.assert_allclose(np.sort(np.abs(axes.T @ SKEW), axis=0)[2], 1, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_longest_semi_axis_is_twice_the_longest_side_over_the_root_of_three(seed):
    corners = np.array(list(product((-1.0, 1.0), (-2.0, 2.0), (-4.0, 4.0)))) @ turned(seed).T
    np.testing.assert_allclose(initial.bound_of_axes(corners), 2 * 8 / np.sqrt(3), rtol=1e-9)
    single = np.array([[0, 0, 5.0], [0, 0, -1], [0, 3, 0], [0, -3, 0], [1, 0, 0], [-1, 0, 0]]) @ turned(seed).T
    np.testing.assert_allclose(initial.bound_of_axes(single), 2 * 6 / np.sqrt(3), rtol=1e-9)


@pytest.mark.parametrize("index", [0, 2])
@pytest.mark.parametrize("fold", [1, 2, 3, 4, 5, 6, 7])
def test_axes_about_one_are_those_of_the_first_moment_that_is_not_zero(fold, index):
    """In the plane across the axis the k-fold moment is real, positive, or negative for squares: their sides."""
    points, turn = ring(fold), turned(fold)
    found = initial._around(-turn[:, 2], index, points @ turn.T)
    axis = found[:, index]
    np.testing.assert_allclose(found.T @ found, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1)
    largest = np.abs(axis).argmax()
    np.testing.assert_allclose(axis, turn[:, 2] * np.sign(turn[largest, 2]), atol=1e-12)
    x, y = (points @ turn.T @ np.delete(found, index, axis=1)).T
    far = np.linalg.norm(points, axis=1)
    beside = np.eye(3)[np.abs(axis).argmin()]
    first = np.delete(found, index, axis=1)[:, 0]
    reference = beside - (beside @ axis) * axis
    angle = np.arctan2(axis @ np.cross(reference, first), reference @ first)
    if fold > 6:
        np.testing.assert_allclose(angle, 0, atol=1e-12)
        return
    moment = ((far**4 if fold < 3 else 1) * (x + 1j * y) ** fold).sum()
    np.testing.assert_allclose(moment.imag / np.abs(moment), 0, atol=1e-9)
    assert (moment.real < 0) == (fold == 4)
    assert np.abs(angle) <= np.pi / fold + 1e-5


def test_of_axes_and_sides_equally_near_to_the_coordinates_the_first_counts():
    """Rounding does not choose: neither the sign of a diagonal axis nor the coordinate that is most across it."""
    rng = np.random.default_rng(3)
    even = np.ones(3) / np.sqrt(3)
    points = ring(7) @ Rotation.align_vectors([even], [[0, 0, 1]])[0].as_matrix().T
    for sign in (1, -1):
        found = initial._around(sign * (even + 1e-9 * rng.normal(size=3)), 2, points)
        np.testing.assert_allclose(found[:, 2], even, atol=1e-8)
        np.testing.assert_allclose(found[:, 0], np.array([2, -1, -1]) / np.sqrt(6), atol=1e-8)


@pytest.mark.parametrize("fold", [1, 2, 3, 4, 6])
def test_of_equivalent_angles_the_one_nearest_to_zero_is_taken(fold):
    step = 2 * np.pi / fold
    for angle in (0.0, 0.3 * step, -0.3 * step, 0.49 * step, -0.5 * step):
        np.testing.assert_allclose(initial._nearest_to_zero(angle, fold), angle)
    for angle in (0.5 * step, 0.5 * step - 1e-9, 0.5 * step + 1e-9):
        np.testing.assert_allclose(initial._nearest_to_zero(angle, fold), angle - step)


@pytest.mark.parametrize(("i", "j"), [(0, 1), (0, 2), (1, 2)])
def test_a_rotation_in_a_plane_leaves_the_third_axis(i, j):
    frame, k = turned(1), 3 - i - j
    found = initial._rotated(frame, i, j, 0.3)
    np.testing.assert_array_equal(found[:, k], frame[:, k])
    np.testing.assert_allclose(found[:, i], np.cos(0.3) * frame[:, i] + np.sin(0.3) * frame[:, j], rtol=1e-12)
    np.testing.assert_allclose(found[:, j], np.cos(0.3) * frame[:, j] - np.sin(0.3) * frame[:, i], rtol=1e-12)


def isotropic(seed, n=12):
    """A cloud whose second moments, and fourth ones contracted to a matrix, are those of a round one."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    symmetric = [sign * np.roll(p, k) for p in points for k in range(3) for sign in product((-1, 1), repeat=3)]
    return np.array(symmetric)


@pytest.mark.parametrize("seed", range(4))
def test_no_frame_has_fourth_moments_farther_from_those_of_a_round_cloud(seed):
    points = isotropic(seed) @ turned(seed).T
    most = float(((points**2).sum(axis=1) ** 2).sum())

    def strength(frame):
        return abs(((points @ frame) ** 4).sum() - 0.6 * most)

    found = initial.canonical_axes(np.ones(3), np.eye(3), points)
    np.testing.assert_allclose(found, initial._of_fourth_moments(points, most), atol=1e-12)
    small = initial._of_fourth_moments(1e-3 * points, 1e-12 * most)
    np.testing.assert_allclose(small, found, atol=1e-9)
    others = Rotation.random(300, random_state=seed).as_matrix()
    near = [found @ Rotation.from_rotvec(0.05 * v).as_matrix() for v in sphere_grid(2)[0]]
    assert strength(found) > 0.01 * most
    assert max(strength(frame) for frame in [*others, *near]) <= strength(found) * (1 + 1e-9)
    for sign in (1.0, -1.0):
        extreme = sign * ((points @ initial._extreme(points, turned(9), sign, most)) ** 4).sum()
        assert extreme >= sign * ((points @ turned(9)) ** 4).sum()


def test_a_cloud_that_is_round_up_to_its_fourth_moments_has_the_axes_of_the_coordinates():
    golden = (1 + 5**0.5) / 2
    corners = np.array([np.roll([0, a, b * golden], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)])
    np.testing.assert_array_equal(initial.canonical_axes(np.ones(3), turned(5), corners @ SKEW.T), np.eye(3))


def test_fourth_moments_decide_where_two_of_them_differ_or_one_does(rng):
    """Second moments made round: the contracted fourth moments leave their axes, or one axis and those around it."""
    points = rng.normal(size=(40, 3)) * [1, 2, 3]
    points -= points.mean(axis=0)
    points = points @ np.linalg.inv(np.linalg.cholesky(points.T @ points)).T
    fourth = sum((p @ p) * np.outer(p, p) for p in points)
    found = initial.canonical_axes(np.ones(3), turned(1), points)
    np.testing.assert_allclose(np.abs(found), np.abs(np.linalg.eigh(fourth)[1]), atol=1e-9)
    for unit in (1e-3, 1e3):
        np.testing.assert_allclose(initial.canonical_axes(np.ones(3), turned(1), unit * points), found, atol=1e-9)
    for stretched in (0.4, 2.0):  # z beyond or within a square, so that its fourth moment is largest or least
        square = np.array(list(product((-1.0, 1.0), (-1.0, 1.0), (0.0,))))
        tips = np.array([[0, 0, 1.0], [0, 0, -1.0]]) * stretched
        copies = round(4 / (2 * stretched**2) * 8)
        cloud = np.concatenate([np.repeat(square, 8, axis=0), np.repeat(tips, copies, axis=0)])
        for unit in (1e-3, 1.0, 1e3):
            axes = initial.canonical_axes(np.ones(3), turned(1), unit * cloud @ SKEW.T)
            np.testing.assert_allclose(np.sort(np.abs(axes.T @ SKEW), axis=0)[2], 1, rtol=1e-9)


def test_one_of_two_equal_eigenvalues_alone_keeps_its_axis():
    """Square prisms along z and flat ones: the axis that is determined stays at its place, the others are the sides."""
    for height, index in ((3.0, 2), (0.3, 0)):
        points = np.array(list(product((-1.0, 1.0), (-1.0, 1.0), (-height, height)))) @ SKEW.T
        values, axes = np.linalg.eigh(points.T @ points)
        found = initial.canonical_axes(values, axes, points)
        np.testing.assert_allclose(np.abs(found[:, index] @ SKEW[:, 2]), 1, rtol=1e-9)
        np.testing.assert_allclose(np.sort(np.abs(found.T @ SKEW), axis=0)[2], 1, rtol=1e-9)


def test_turned_by_45_degrees_a_torus_keeps_its_hole_and_a_hyperboloid_its_height():
    torus = Superquadric("toroid", (1, 2, 3), hole_radius=3)
    assert initial._eighth_rotated(torus).hole_radius == 3
    assert initial._eighth_rotated(made("hyperboloid1")).height == made("hyperboloid1").height
