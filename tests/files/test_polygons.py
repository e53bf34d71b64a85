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
