"""The free-form deformation: linear precision, B, Jacobian, inverse, elevation, index order."""

from itertools import product

import numpy as np
import pytest
from shapes_made import KINDS, SKEW, even_directions, made

from quadriform.errors import OptionError, PointsError
from quadriform.shapes import bernstein, control_box
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.superquadric import Superquadric

SHAPES = [(5, 5, 5), (2, 2, 2), (3, 4, 6)]


def bulged(shape=(5, 5, 5), size=0.2, seed=2):
    """The box around a superellipsoid with every control point moved, and points inside it."""
    rng = np.random.default_rng(seed)
    box = ControlBox.around(made(), shape)
    box = box.with_control_points(box.control_points + size * rng.normal(size=box.control_points.shape))
    return box, box.origin + rng.uniform(0, 1, (300, 3)) @ box.edges


@pytest.mark.parametrize("shape", SHAPES)
def test_undeformed_box_moves_nothing(shape, rng):
    box = ControlBox.around(made(), shape)
    points = rng.normal(size=(100, 3)) * 4  # outside as well
    np.testing.assert_allclose(box.deform(points), points, atol=1e-11)
    np.testing.assert_array_equal(box.control_points, box.rest)


@pytest.mark.parametrize("shape", SHAPES)
def test_affine_image_of_the_box_gives_the_affine_image_of_the_surface(shape, rng):
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    surface = made()
    box = ControlBox.around(surface, shape)
    points = surface.surface(even_directions(300))
    moved = box.with_control_points(box.control_points @ matrix.T + shift)
    wanted = points @ matrix.T + shift
    size = np.abs(wanted).max()
    np.testing.assert_allclose(moved.deform(points), wanted, atol=1e-12 * size)
    np.testing.assert_allclose(box.matrix(points) @ moved.control_points.reshape(-1, 3), wanted, atol=1e-12 * size)
    np.testing.assert_allclose(moved.jacobian(points), np.broadcast_to(matrix, (300, 3, 3)), atol=1e-11)


@pytest.mark.parametrize("shape", SHAPES)
def test_matrix_times_control_points_is_the_deformation(shape):
    box, points = bulged(shape)
    b = box.matrix(points)
    assert b.shape == (300, np.prod(shape))
    np.testing.assert_allclose(b @ box.control_points.reshape(-1, 3), box.deform(points), atol=1e-12)
    np.testing.assert_allclose(b.sum(axis=1), 1, rtol=1e-12)


def test_deformation_is_the_papers_triple_sum():
    """P18 and P19, written out."""
    box, points = bulged((3, 4, 5))
    local = np.linalg.solve(box.edges.T, (points - box.origin).T)
    factors = [bernstein.basis(local[axis], degree) for axis, degree in enumerate((2, 3, 4))]
    wanted = np.einsum("ni,nj,nk,ijkd->nd", *factors, box.control_points)
    np.testing.assert_allclose(box.deform(points), wanted, atol=1e-12)
    np.testing.assert_allclose(box.local(points), local.T, atol=1e-13)  # P15, P16


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.4)])
def test_rank_of_b_on_an_ellipsoid_is_98_of_125(exponents):
    """On the quadric 27 of the 125 polynomials vanish; other exponents have no such polynomial."""
    s = made(exponents=exponents)
    singular = np.linalg.svd(ControlBox.around(s).matrix(s.surface(even_directions(2000))), compute_uv=False)
    rank = int((singular > 1e-10 * singular[0]).sum())
    assert rank == (98 if exponents == (1, 1) else 125)


def test_index_order_runs_upwards_from_the_low_corner():
    s = Superquadric(semi_axes=(3, 2, 4), rotation=SKEW, translation=(1, 2, 3))
    grid = (ControlBox.around(s, (3, 4, 5)).control_points - s.translation) @ SKEW
    np.testing.assert_allclose(grid[0, 0, 0], [-3, -2, -4], atol=1e-13)
    np.testing.assert_allclose(grid[2, 0, 0], [3, -2, -4], atol=1e-13)
    np.testing.assert_allclose(grid[0, 3, 0], [-3, 2, -4], atol=1e-13)
    np.testing.assert_allclose(grid[0, 0, 4], [-3, -2, 4], atol=1e-13)
    steps = [np.linspace(-a, a, n) for a, n in ((3, 3), (2, 4), (4, 5))]  # P17: even steps
    np.testing.assert_allclose(grid, np.stack(np.meshgrid(*steps, indexing="ij"), -1), atol=1e-13)


def test_columns_of_b_run_with_the_last_index_fastest():
    box = ControlBox.around(made(), (3, 4, 5))
    i, j, k = 2, 1, 3
    pushed = box.rest.copy()
    pushed[i, j, k] += [1.0, 0, 0]
    points = made().surface(even_directions(50))
    moved = box.with_control_points(pushed).deform(points) - points
    np.testing.assert_allclose(box.matrix(points)[:, (i * 4 + j) * 5 + k], moved[:, 0], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_box_touches_the_surface(kind):
    s = made(kind, (1, 1))
    local = ControlBox.around(s).local(s.mesh(16).vertices)
    np.testing.assert_allclose([local.min(axis=0), local.max(axis=0)], [[0] * 3, [1] * 3], atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_jacobian(shape):
    box, points = bulged(shape)
    h = 1e-5
    wanted = [(box.deform(points + h * axis) - box.deform(points - h * axis)) / (2 * h) for axis in np.eye(3)]
    np.testing.assert_allclose(box.jacobian(points), np.stack(wanted, axis=2), atol=1e-8)


def test_space_grows_by_the_determinant():
    box, points = bulged(size=2.0)
    wanted = np.linalg.det(box.jacobian(points))
    assert wanted.min() < 0 < wanted.max()
    np.testing.assert_allclose(box.jacobian_determinant(points), wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_undeform_undoes_deform(shape):
    box, points = bulged(shape)
    assert box.jacobian_determinant(points).min() > 0
    size = np.linalg.norm(box.edges)
    np.testing.assert_allclose(box.undeform(box.deform(points)), points, atol=1e-9 * size)
    inner = box.deform(points)[:100]
    np.testing.assert_allclose(box.deform(box.undeform(inner)), inner, atol=1e-9 * size)


def test_undeform_prefers_origins_inside_the_box(rng):
    """A lively box: beyond its faces the polynomials fold and reach the same places, inside they do not."""
    box, _ = bulged((3, 4, 6), size=0.25)
    points = box.origin + rng.uniform(0, 1, (1500, 3)) @ box.edges
    assert box.jacobian_determinant(points).min() > 0.2
    np.testing.assert_allclose(box.undeform(box.deform(points)), points, atol=1e-9 * np.linalg.norm(box.edges))


def test_undeform_gives_some_origin_in_a_folded_box():
    box, points = bulged(size=2.0)
    assert box.jacobian_determinant(points).min() < 0
    image = box.deform(points)
    np.testing.assert_allclose(box.deform(box.undeform(image)), image, atol=1e-9 * np.linalg.norm(box.edges))


def test_undeform_refuses_points_without_origin():
    box = ControlBox.undeformed(np.zeros(3), np.eye(3), (3, 3, 3))
    flat = box.control_points * [1, 1, 0]
    with pytest.raises(PointsError, match=r"1 of 2 points.*index 1"):
        box.with_control_points(flat).undeform([[0.5, 0.5, 0], [0.5, 0.5, 0.4]])
    np.testing.assert_allclose(box.undeform([[1.5, 0.5, 0.5]]), [[1.5, 0.5, 0.5]], atol=1e-12)
    with pytest.raises(PointsError, match="inside the deformed box"):  # the polynomials get there, far from the box
        box.undeform([[2.5, 0.5, 0.5]])


@pytest.mark.parametrize("degrees", [(4, 4, 4), (6, 5, 4), (8, 8, 8)])
def test_elevation_keeps_the_deformation(degrees):
    box, points = bulged()
    raised = box.elevate(degrees)
    assert raised.degrees == degrees
    np.testing.assert_allclose(raised.deform(points), box.deform(points), atol=1e-12)


def test_elevation_does_not_go_down():
    with pytest.raises(OptionError, match=r"degrees=\(4, 4, 3\).*\(4, 4, 4\)"):
        bulged()[0].elevate((4, 4, 3))


def test_chunks_do_not_show(rng):
    """More points than fit into the cache at once give the same rows."""
    box, _ = bulged()
    points = box.origin + rng.uniform(0, 1, (bernstein.CHUNK + 100, 3)) @ box.edges
    np.testing.assert_allclose(box.deform(points)[-200:], box.deform(points[-200:]), atol=1e-13)
    np.testing.assert_allclose(box.jacobian(points)[-200:], box.jacobian(points[-200:]), atol=1e-13)
    np.testing.assert_allclose(box.undeform(box.deform(points)), points, atol=1e-9)


def test_placed_is_the_scaled_shifted_deformation():
    box, points = bulged()
    offset = np.array([3.0, -8, 1])
    np.testing.assert_allclose(
        box.transformed(2.5, offset).deform(2.5 * points + offset), 2.5 * box.deform(points) + offset
    )


BAD = [
    ((np.zeros(2), np.eye(3), np.zeros((2, 2, 2, 3))), "origin"),
    ((np.zeros(3), np.eye(3) * np.nan, np.zeros((2, 2, 2, 3))), "edges.*finite"),
    ((np.zeros(3), np.eye(3), np.zeros((1, 2, 2, 3))), "control_points"),
    ((np.zeros(3), np.eye(3), np.zeros((2, 2, 2, 2))), "control_points"),
    ((np.zeros(3), np.eye(3), np.full((2, 2, 2, 3), np.inf)), "control_points.*finite"),
]


@pytest.mark.parametrize(("fields", "message"), BAD)
def test_impossible_boxes_are_refused(fields, message):
    with pytest.raises(OptionError, match=message):
        ControlBox(*fields)


@pytest.mark.parametrize("call", ["deform", "undeform", "jacobian", "matrix", "local"])
@pytest.mark.parametrize("points", [np.ones((3, 4)), [[np.inf, 0, 0]], np.empty((0, 3)), [["a", "b", "c"]]])
def test_bad_points_are_refused(call, points):
    with pytest.raises(PointsError, match="points"):
        getattr(ControlBox.around(made()), call)(points)


@pytest.mark.parametrize("angle", [89.0, 89.999, 90.0001, 45.0, 179.0])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (2, 0)])
def test_edges_that_are_not_at_right_angles_are_refused(angle, scale, pair):
    """P15 and P16 project onto the edges: those of a sheared box would be silently wrong."""
    edges = scale * np.diag([1.0, 20.0, 3.0])
    one, other = pair
    along, across = edges[one] / np.linalg.norm(edges[one]), edges[other].copy()
    edges[other] = np.cos(np.radians(angle)) * np.linalg.norm(across) * along + np.sin(np.radians(angle)) * across
    with pytest.raises(OptionError, match="edges: expected three edges at right angles, found two at"):
        ControlBox.undeformed(np.zeros(3), edges, (2, 2, 2))


def test_edges_at_right_angles_but_for_rounding_are_taken(rng):
    for scale in (1e-9, 1.0, 1e9):
        for rotation in np.linalg.qr(rng.normal(size=(20, 3, 3)))[0]:
            ControlBox.undeformed(rng.normal(size=3), scale * np.diag([1.0, 20.0, 3e-3]) @ rotation, (2, 2, 2))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("edges", np.diag([1.0, 0.0, 1.0]), "edges: expected three edges that are not zero"),
        (
            "edges",
            np.diag([1.0, 1e300, 1.0]),
            "edges: expected finite numbers of shape .* up to 1e\\+30.* largest 1e\\+300",
        ),
        ("origin", [0, 1e300, 0], "origin: expected finite numbers"),
        ("control_points", np.full((2, 2, 2, 3), 1e300), "control_points: expected finite numbers"),
        ("control_points", np.full((2, 2, 2, 3), np.nan), "control_points: expected finite numbers"),
    ],
)
def test_numbers_out_of_range_are_refused(field, value, message):
    plain = {"origin": np.zeros(3), "edges": np.eye(3), "control_points": np.zeros((2, 2, 2, 3))}
    with pytest.raises(OptionError, match=message):
        ControlBox(**plain | {field: value})


def test_a_common_box_is_that_of_the_largest_surface_enlarged_to_hold_the_others():
    large = made(exponents=(1.0, 1.0))
    inner, across = (
        Superquadric("ellipsoid", axes, (1, 1), SKEW, large.translation) for axes in ((1, 1, 1), (5, 1, 1))
    )
    np.testing.assert_allclose(
        common_box({"a": large, "b": inner}, (2, 2, 2)).rest, ControlBox.around(large, (2, 2, 2)).rest
    )
    box = common_box({"a": across, "b": large}, (2, 2, 2))
    np.testing.assert_allclose(np.linalg.norm(box.edges, axis=1), [10, 4, 8])
    for surface in (large, across):
        local = box.local(surface.grid(12)[0])
        assert local.min() > -1e-9 and local.max() < 1 + 1e-9


@pytest.mark.parametrize("margin", [0.0, 0.2])
def test_starts_of_the_inverse_are_the_nodes_of_a_grid_with_the_nearest_images(margin):
    box, inside = bulged()
    nodes = box.origin + np.array([*product(np.linspace(-margin, 1 + margin, 13), repeat=3)]) @ box.edges
    images, targets = box.deform(nodes), box.deform(inside[:9])
    found = box._starts(targets, margin)
    for target, starts in zip(targets, found.swapaxes(0, 1)):
        nearest = np.linalg.norm(images - target, axis=1).argsort()[:6]
        np.testing.assert_allclose(starts, nodes[nearest], atol=1e-12)


def test_the_grids_of_the_inverse_are_that_of_the_box_and_a_wider_one(monkeypatch):
    box, inside = bulged(size=0.05)
    asked, starts = [], ControlBox._starts
    monkeypatch.setattr(ControlBox, "_starts", lambda *given: asked.append(given[1:]) or starts(*given))
    points = np.vstack([inside[:2], box.origin - 0.02 * box.edges.sum(axis=0)])
    targets = box.deform(points)
    np.testing.assert_allclose(box._invert(targets), points, atol=1e-6)
    assert [margin for _, margin in asked] == [0.0, 0.2]
    assert all(given is targets for given, _ in asked)


@pytest.mark.parametrize("axis", range(3))
def test_a_preimage_is_inside_or_outside_by_less_than_a_side_or_missed(axis):
    box = ControlBox.undeformed(np.array([1.0, 2, 3]), np.diag([2.0, 3, 4]), (3, 3, 3))
    local = np.full((8, 3), 0.5)
    local[:, axis] = [0.0, 1.0, -0.01, 1.01, -0.99, 1.99, -1.01, 2.01]
    points, slight = box.origin + local @ box.edges, 1e-13
    expected = [control_box.INSIDE] * 2 + [control_box.OUTSIDE] * 4 + [control_box.MISSED] * 2
    assert box._grade(points, points + slight).tolist() == expected
    assert (box._grade(points, points + 1e-6) == control_box.MISSED).all()
    points[:2, axis] += [-slight, slight]
    assert box._grade(points, points)[:2].tolist() == expected[:2]
