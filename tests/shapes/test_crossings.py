"""Surfaces that cross themselves or each other, found where they do."""

from collections import Counter
from itertools import combinations, product

import numpy as np
import pytest
from shapes_made import KINDS, SKEW, made, single

from quadriform.shapes import crossings as module
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.crossings import crossings
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric


def one(*corners):
    return Mesh(np.array(corners, dtype=float), np.array([[0, 1, 2]]))


def test_a_needle_through_a_triangle():
    flat = one((0, 0, 0), (4, 0, 0), (0, 4, 0))
    needle = one((1, 1, -1), (1, 1, 1), (1, 50, 1))
    points = crossings(flat, needle)
    assert {tuple(np.round(p, 12)) for p in points} == {(1, 1, 0), (1, 3, 0)}
    assert len(crossings(flat, one((3, 3, -1), (3, 3, 1), (9, 9, 1)))) == 0


@pytest.mark.parametrize("resolution", [8, 32])
def test_two_spheres_cross_on_their_circle(resolution):
    a, b = Superquadric().mesh(resolution), Superquadric(translation=(1, 0, 0)).mesh(resolution)
    points = crossings(a, b)
    sag = 1 - np.cos(np.pi / 4 / resolution * 2)
    np.testing.assert_allclose(points[:, 0], 0.5, atol=sag)
    np.testing.assert_allclose(np.hypot(points[:, 1], points[:, 2]), 0.75**0.5, atol=2 * sag)
    angle = np.sort(np.arctan2(points[:, 2], points[:, 1]))
    assert np.diff(angle, append=angle[0] + 2 * np.pi).max() < 2.5 * np.pi / 2 / resolution


def test_order_pose_and_scale_do_not_matter():
    a, b = Superquadric().mesh(16), Superquadric(translation=(1, 0.2, 0)).mesh(16)
    here, there = crossings(a, b), crossings(b, a)
    assert len(here) == len(there)
    moved = [Mesh(1e-3 * m.vertices @ SKEW.T + 7, m.faces) for m in (a, b)]
    nearest = np.linalg.norm(crossings(*moved)[:, None] - (1e-3 * here @ SKEW.T + 7), axis=2)
    assert max(nearest.min(axis=0).max(), nearest.min(axis=1).max()) < 1e-11


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("exponents", [(1, 1), (0.1, 0.1), (0.3, 1.7)])
def test_superquadrics_do_not_cross_themselves(kind, exponents):
    assert crossings(made(kind, exponents).mesh(16)).shape == (0, 3)


def test_far_and_nested_spheres_do_not_cross():
    small, large = Superquadric().mesh(12), Superquadric(semi_axes=(2, 2, 2)).mesh(12)
    assert len(crossings(small, large)) == 0
    assert len(crossings(small, Superquadric(translation=(5, 0, 0)).mesh(12))) == 0


def bent_onto_itself():
    """A long ellipsoid whose ends are swung through each other."""
    surface = Superquadric(semi_axes=(1.0, 1.0, 6.0))
    box = ControlBox.around(surface, (3, 3, 5))
    angle = np.linspace(-0.9, 0.9, 5) * 1.5 * np.pi
    points = box.control_points.copy()
    for k, a in enumerate(angle):
        x = points[:, :, k, 0]
        points[:, :, k, 0], points[:, :, k, 2] = (x + 4) * np.cos(a), (x + 4) * np.sin(a)
    return single(surface, box.with_control_points(points))


def test_a_surface_bent_through_itself_is_found():
    model = bent_onto_itself()
    found = model.crossings()
    assert set(found) == {("surface", "surface")}
    points = found["surface", "surface"]
    np.testing.assert_allclose(model.distance(points), 0, atol=0.05)
    # the body is a mirror image of itself in z, so both ends meet around that plane
    assert np.abs(np.median(points[:, 2])) < 0.5


def test_where_rays_meet_a_surface_once_the_long_way_finds_nothing_either(monkeypatch):
    surface = made(exponents=(1.0, 1.0))
    plain, rng, seen = ControlBox.around(surface, (4, 4, 4)), np.random.default_rng(0), []
    for scale in np.linspace(0, 5, 25):
        shifts = rng.normal(scale=scale, size=plain.control_points.shape)
        mesh = single(surface, plain.with_control_points(plain.control_points + shifts)).mesh()
        with monkeypatch.context() as patch:
            once, short = module._is_star_shaped(mesh), crossings(mesh)
            patch.setattr(module, "_is_star_shaped", lambda mesh: False)
            np.testing.assert_array_equal(short, crossings(mesh))
        seen.append((once, len(short) > 0))
    assert set(seen) == {(True, False), (False, False), (False, True)}


def test_a_sphere_around_another_is_not_one_seen_once():
    small, large = Superquadric().mesh(12), Superquadric(semi_axes=(1.2, 0.9, 1.2)).mesh(12)
    both = Mesh(np.concatenate([small.vertices, large.vertices]), np.concatenate([small.faces, large.faces + 866]))
    assert len(crossings(both)) > 50


def test_two_open_halves_that_fill_the_view_are_no_closed_surface():
    """Both are the upper half; vertices of no triangle put the middle on their rim."""
    halves = []
    for semi_axes in ((1, 1, 1), (1.2, 0.9, 1)):
        mesh = Superquadric(semi_axes=semi_axes).mesh(12)
        halves.append(Mesh(mesh.vertices, mesh.faces[(mesh.vertices[mesh.faces, 2] > -1e-9).all(axis=1)]))
    both = Mesh(
        np.concatenate([half.vertices for half in halves]), np.concatenate([halves[0].faces, halves[1].faces + 866])
    )
    assert len(crossings(both)) > 20


def pair(inner_at=(0.0, 0, 0), inner=0.6, outer=1.0):
    a = Superquadric(semi_axes=(outer,) * 3)
    b = Superquadric(semi_axes=(inner,) * 3, translation=inner_at)
    return DeformableModel({"epi": a, "endo": b}, ControlBox.around(Superquadric(semi_axes=(3, 3, 3))))


def test_how_two_surfaces_lie():
    assert pair().crossings() == {}
    assert pair().nesting() == {("epi", "endo"): "around"}
    assert pair(outer=0.5, inner=1.0).nesting() == {("epi", "endo"): "inside"}
    assert pair(inner_at=(2.0, 0, 0)).nesting() == {("epi", "endo"): "apart"}
    crossing = pair(inner_at=(0.8, 0, 0))
    assert set(crossing.crossings()) == {("epi", "endo")}
    assert crossing.nesting() == {("epi", "endo"): "crossing"}


@pytest.mark.parametrize(("away", "largest"), [((0, 0, 0), 1.5), ((-40, 7, 3), 1.5), ((5, 0, -9), 90.0)])
def test_boxes_that_share_a_cell_are_pairs_once_for_each(away, largest):
    """The corner of the cells is the lowest of all boxes; the largest box enters no more cells than it may."""
    rng = np.random.default_rng(5)
    low = rng.uniform(0, 12, (60, 3)) * [1, 2, 0.5]
    low -= low.min(axis=0)
    extents = rng.uniform(0.5, 1.5, (60, 3))
    extents[0, 1] = largest
    size = max(module.CELL * extents.mean(), largest / module.MOST)
    cells = [
        set(product(*(range(int(a // size), int(b // size) + 1) for a, b in zip(first, last))))
        for first, last in zip(low, low + extents)
    ]
    shared = Counter({(a, b): len(cells[a] & cells[b]) for a, b in combinations(range(60), 2)})
    low += away
    assert Counter(zip(*(each.tolist() for each in module._sharing_a_cell(low, low + extents)))) == +shared


def test_inputs_stay_as_they_are():
    a, b = Superquadric().mesh(6), Superquadric(translation=(1, 0, 0)).mesh(6)
    before = a.vertices.copy(), b.vertices.copy()
    crossings(a, b)
    assert (a.vertices == before[0]).all() and (b.vertices == before[1]).all()


@pytest.mark.parametrize(
    ("x", "y", "is_crossed"),
    [
        (0.25, 0.25, True),
        (0.0, 0.5, True),
        (0.5, 0.0, True),
        (0.5, 0.5, True),
        (0.0, 0.0, True),
        (-0.01, 0.5, False),
        (0.5, -0.01, False),
        (0.5, 0.51, False),
    ],
)
def test_a_triangle_is_crossed_within_it_and_at_its_edges(x, y, is_crossed):
    """Else surfaces that cross along edges, as those of the same grid, would not."""
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    other = np.array([[x, y, -1], [x, y, 1], [5, 5, 1]])
    found = module._pierced(other[None], triangle[None])
    expected = [[x, y, 0]] if is_crossed else np.empty((0, 3))
    np.testing.assert_allclose(found, expected, atol=1e-15)
