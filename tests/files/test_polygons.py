"""Polygons become triangles that cover them, once each, with every corner used."""

import numpy as np
import pytest
from shapes_made import SKEW

from quadriform.errors import FileFormatError, FileLimitError
from quadriform.files import polygons
from quadriform.files.polygons import Polygons, strip_triangles
from quadriform.shapes.mesh import Mesh


def area_inside(outline):
    x, y = np.transpose(outline)
    return abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def covered(outline, move=lambda points: points):
    """The triangles of one polygon, and the polygon's own area."""
    outline = np.asarray(outline, dtype=float)
    vertices = move(np.column_stack([outline, np.zeros(len(outline))]))
    faces = Polygons(vertices, np.arange(len(outline)), np.array([len(outline)])).triangles("m")
    return Mesh(vertices, faces), area_inside(outline)


OUTLINES = {
    "arrow": [(0, 0), (1, 1), (0, 0.5), (-1, 1)],
    "arrow from its tip": [(0, 0.5), (-1, 1), (0, 0), (1, 1)],
    "L": [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
    "U": [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)],
    "U with corners on its edges": [(0, 0), (1.5, 0), (3, 0), (3, 2), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)],
    "a hole, joined by a cut": [
        *[(0, 0), (4, 0), (4, 4), (0, 4), (0, 0)],
        *[(1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
    ],
}


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("first", [0, 1, 2, 3])
def test_a_concave_polygon_keeps_its_area(name, backwards, first):
    outline = np.roll(np.array(OUTLINES[name]), first, axis=0)[:: -1 if backwards else 1]
    mesh, area = covered(outline, lambda points: points @ SKEW.T * 7 + 1e3)
    assert mesh.area() == pytest.approx(49 * area, rel=1e-9)
    assert len(mesh.faces) == len(outline) - 2
    assert set(mesh.faces.ravel()) == set(range(len(outline)))


@pytest.mark.parametrize("seed", range(5))
def test_stars_and_combs(seed):
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 60))
    radius = rng.uniform(0.2, 1, 60)
    star = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    teeth = [(k / 2, 0 if k % 2 else 1 + rng.uniform()) for k in range(40)]
    for outline in (star, [(0, -1), *teeth, (20, -1)]):
        mesh, area = covered(outline)
        assert mesh.area() == pytest.approx(area, rel=1e-9)


def test_a_quadrilateral_of_area_a_quarter():
    """A fan from its first corner would cover more than the polygon."""
    mesh, area = covered([(0, 0), (1, 0), (0.25, 0.25), (0, 1)])
    assert mesh.area() == pytest.approx(area) == pytest.approx(0.25)


def test_the_winding_stays():
    mesh, _ = covered(OUTLINES["U"])
    assert (mesh.area_vectors()[:, 2] >= 0).all()
    assert (covered(OUTLINES["U"][::-1])[0].area_vectors()[:, 2] <= 0).all()


def test_convex_polygons_are_fans_in_their_order():
    corners = np.array([0, 1, 2, 3, 4, 5, 6, 0, 2, 4])
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 1], [2, 1, 1], [2, 2, 0.0]])
    faces = Polygons(square, corners, np.array([4, 3, 3])).triangles("m")
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [0, 2, 4]]


def test_a_polygon_without_area_is_a_fan():
    line = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    assert Polygons(line, np.arange(5), np.array([5])).triangles("m").tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_a_polygon_that_crosses_itself_has_all_its_corners():
    mesh, _ = covered([(0, 0), (1, 1), (1, 0), (0, 1)])
    assert set(mesh.faces.ravel()) == {0, 1, 2, 3}


def test_strips_turn_every_second_triangle():
    strips = strip_triangles(np.array([0, 1, 2, 3, 7, 8, 9, 4]), np.array([4, 3, 1]))
    assert strips.tolist() == [[0, 1, 2], [2, 1, 3], [7, 8, 9]]


def test_every_second_triangle_of_a_long_strip_is_turned():
    strips = strip_triangles(np.arange(6), np.array([6]))
    assert strips.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]
    assert strip_triangles(np.arange(0), np.array([], dtype=np.int64)).shape == (0, 3)
    both = Polygons.with_strips(np.arange(18.0), (np.array([0, 1, 2, 3]), np.array([4])), (np.arange(4), np.array([4])))
    assert both.corners.tolist() == [0, 1, 2, 3, 0, 1, 2, 2, 1, 3] and both.lengths.tolist() == [4, 3, 3]
    assert both.vertices.shape == (6, 3)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("axis", range(3))
def test_corners_in_a_plane_are_counter_clockwise_along_their_normal(axis, backwards):
    outline = np.array(OUTLINES["L"], dtype=float)[:: -1 if backwards else 1] * 3 + 5
    points = np.roll(np.column_stack([outline, np.full(len(outline), 2.0)]), axis, axis=1)
    normal = np.roll([0.0, 0.0, -1.0 if backwards else 1.0], axis)
    x, y = polygons._in_plane(points, normal).T
    assert np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)) > 0
    assert max(np.abs(x).max(), np.abs(y).max()) == 1 and abs(x.mean()) < 1e-12


def plain_ear(points):
    """The first convex corner whose triangle no other corner is in; else the flattest corner."""

    def doubled(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    n = len(points)
    corners = [(points[k - 1], points[k], points[(k + 1) % n]) for k in range(n)]
    for k, (a, b, c) in enumerate(corners):
        others = [p for j, p in enumerate(points) if j not in ((k - 1) % n, k, (k + 1) % n)]
        others = [p for p in others if not any((p == q).all() for q in (a, b, c))]
        inside = [doubled(a, b, p) >= 0 and doubled(b, c, p) >= 0 and doubled(c, a, p) >= 0 for p in others]
        if doubled(a, b, c) > 1e-12 and not any(inside):
            return k
    return int(np.argmin([abs(doubled(*each)) for each in corners]))


@pytest.mark.parametrize("seed", range(6))
def test_the_ear_that_is_cut_has_no_corner_inside(seed):
    rng = np.random.default_rng(seed)
    angle, radius = np.sort(rng.uniform(0, 2 * np.pi, 12)), rng.uniform(0.2, 1, (12, 1))
    star = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    hole = np.array(OUTLINES["a hole, joined by a cut"], dtype=float)
    for outline in (star, star[::-1], np.roll(hole, seed, axis=0), rng.normal(size=(7, 2))):
        assert polygons._ear(outline) == plain_ear(outline)


@pytest.mark.parametrize(
    "outline",
    [
        [(2, 0), (2, 2), (0, 2), (0, 1.5), (2, 1), (0, 0.5), (0, 0)],
        [(2, 0), (2, 2), (1.5, 2), (1, 0), (0.5, 2), (0, 2), (0, 0)],
        [(2, 0), (2, 2), (1, 1), (0, 3), (0, 0)],
    ],
    ids=["side after it", "side before it", "cut"],
)
def test_a_corner_on_a_side_of_an_ear_blocks_it(outline):
    """The first corner is convex, and another one touches a side of its triangle, which would cover what is outside."""
    points = np.array(outline, dtype=float)
    a, b, c = points[polygons._ears(points)].swapaxes(0, 1)
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert polygons._ear(points) != 0 and areas.min() >= 0 and areas.sum() == area_inside(points)


def test_what_is_no_polygon():
    vertices = np.eye(3)
    with pytest.raises(FileFormatError, match="polygon 1 with 2"):
        Polygons(vertices, np.array([0, 1, 2, 0, 1]), np.array([3, 2])).triangles("m")
    for wrong in (3, -1):
        with pytest.raises(FileFormatError, match=f"names vertex {wrong}, but there are 3"):
            Polygons(vertices, np.array([0, 1, wrong]), np.array([3])).triangles("m")


def test_concave_polygons_of_very_many_corners_are_refused(monkeypatch):
    monkeypatch.setattr(polygons, "MOST_CORNERS", 7)
    with pytest.raises(FileLimitError, match="not convex has 8 corners"):
        covered(OUTLINES["U"])
