"""Where the search for nearest points starts and which of its results count, against plain loops."""

import numpy as np
import pytest
from shapes_made import SKEW, made, turned

from quadriform.shapes import closest
from quadriform.shapes.closest import CandidateIndex, FootPoints
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric


@pytest.fixture
def coarse(monkeypatch):
    """A grid of few vertices, over which loops are quick."""
    monkeypatch.setattr(closest, "RESOLUTION", 4)
    closest._neighbours.cache_clear()
    yield
    closest._neighbours.cache_clear()


def deformed(exponents=(0.6, 1.2), size=0.2):
    surface = made(exponents=exponents)
    box = ControlBox.around(surface)
    moves = np.random.default_rng(3).normal(0, size, box.control_points.shape)
    return surface, box.with_control_points(box.control_points + moves)


def vertex_normals(points, quads):
    """Sums of the area vectors of the adjoining cells, of length 1."""
    total = np.zeros_like(points)
    for a, b, c, d in quads:
        for corner in (a, b, c, d):
            total[corner] += np.cross(points[c] - points[a], points[d] - points[b])
    return total / np.linalg.norm(total, axis=1, keepdims=True)


@pytest.mark.parametrize("exponents", [(0.6, 1.2), (0.1, 0.1)])
def test_cells_reach_half_way_to_their_neighbours_and_bend_as_circles_through_them(coarse, exponents):
    surface, box = deformed(exponents)
    origins, quads = surface.grid(4)
    points = box.deform(origins)
    found, normals = CandidateIndex.of(surface, box), vertex_normals(points, quads)
    np.testing.assert_array_equal(found.origins, origins)
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_allclose(closest._vertex_normals(points, quads), normals, atol=1e-12)
    for vertex in range(len(points)):
        cells = set(quads[(quads == vertex).any(axis=1)].ravel()) - {vertex}
        chords = {other: points[other] - points[vertex] for other in cells}
        longest = max(np.linalg.norm(chord) for chord in chords.values())
        np.testing.assert_allclose(found.cell[vertex], 1.1 * longest / 2, rtol=1e-12)
        bends = [2 * abs(chord @ normals[vertex]) / (chord @ chord) for chord in chords.values()]
        np.testing.assert_allclose(found.curvature[vertex], 1.5 * max(bends), rtol=1e-9)
        alike = {other for other in cells if normals[other] @ normals[vertex] > 0.9}
        assert set(found.around[:, vertex]) - {vertex} == alike
    assert (found.around == np.arange(len(points))).any()


def slack(index):
    return np.array([min(c**2 * k, 2 * c) for c, k in zip(index.cell, index.curvature)])


def test_starts_are_the_lowest_of_the_vertices_whose_cell_may_be_nearest(coarse, rng):
    surface, box = deformed()
    index = CandidateIndex.of(surface, box)
    targets = np.concatenate([rng.normal(size=(20, 3)) * 3, 0.3 * rng.normal(size=(20, 3)) + surface.translation])
    expected = set()
    for target, point in enumerate(targets):
        distance = np.linalg.norm(index.points - point, axis=1)
        room = index.cell**2 + distance.min() * slack(index)
        chosen = np.flatnonzero(distance**2 - distance.min() ** 2 <= room)
        if len(chosen) > 1:
            chosen = [v for v in chosen if distance[v] <= distance[index.around[:, v]].min() * (1 + 1e-12)]
        expected |= {(target, int(vertex)) for vertex in chosen}
    found = [tuple(map(int, pair)) for pair in zip(*index.starts(targets))]
    assert set(found) == expected and len(found) == len(expected)
    assert found == sorted(found)


def test_of_many_equally_near_vertices_an_even_selection_is_searched(coarse):
    """All vertices of a ball are as near to its centre: every fifth of 98 makes no more than 24."""
    ball = Superquadric()
    index = CandidateIndex.of(ball, ControlBox.around(ball))
    owner, vertex = index.starts(np.zeros((1, 3)))
    assert not owner.any() and len(index.points) == 98
    np.testing.assert_array_equal(vertex, np.arange(0, 98, 5))


def test_the_extreme_of_each_owner():
    owner, values = np.array([2, 0, 2, 0, 2]), np.array([5.0, 1.0, 4.0, 3.0, 9.0])
    assert closest._extreme(np.minimum, owner, values).tolist() == [4, 1, 4, 1, 4]
    assert closest._extreme(np.maximum, owner, values).tolist() == [9, 3, 9, 3, 9]
    assert closest._extreme(np.maximum, owner[:0], values[:0]).tolist() == []


def test_of_points_equally_near_the_farthest_along_an_odd_direction_is_taken():
    """In the frame of the superquadric; of points within a millionth of each other the nearest counts."""
    surface = Superquadric(semi_axes=(3.0, 2.0, 4.0), rotation=SKEW)
    box = ControlBox.around(surface)
    diagonal = np.linalg.norm([6.0, 4.0, 8.0])
    unit = SKEW @ np.array([1.0, 0.618, 0.271]) / np.linalg.norm([1.0, 0.618, 0.271])
    aside = np.cross(unit, [0, 0, 1.0])
    aside /= np.linalg.norm(aside)

    def nearest(points):
        owner = np.zeros(len(points), dtype=np.int64)
        return int(closest._nearest(surface, box, owner, np.zeros((len(points), 3)), np.array(points))[0])

    assert nearest([-unit, unit, aside]) == 1  # all as near: the one farthest along
    assert nearest([-unit, (1 + 0.9e-10 * diagonal) * unit]) == 1  # as near but for rounding
    assert nearest([-unit, (1 + 1.2e-10 * diagonal) * unit]) == 0
    length = np.linalg.norm([1.0, 0.618, 0.271])
    for apart, same in ((0.9e-6, True), (1.1e-6, False)):  # along the direction, whose length counts
        angle = np.arccos(1 - apart * diagonal / length)
        other = (1 - 1e-12) * (np.cos(angle) * unit + np.sin(angle) * aside)
        assert nearest([unit, other]) == (1 if same else 0)
    owner = np.array([3, 1, 3, 1])
    points = np.array([[0, 0, 5.0], [0, 0, 2.0], [0, 0, 1.0], [0, 0, 3.0]])
    assert closest._nearest(surface, box, owner, np.zeros((4, 3)), points).tolist() == [1, 2]


def test_feet_beside_planes_are_the_near_ones_of_each_small_cell():
    surface = Superquadric(semi_axes=(3.0, 2.0, 4.0), rotation=turned(2), translation=(1.0, 2.0, 3.0))
    box = ControlBox.around(surface)
    rng, size = np.random.default_rng(5), np.linalg.norm(box.edges)
    local = rng.normal(size=(60, 3)) * rng.choice([1.0, 0.05], (60, 3))
    origins = surface.project(local @ surface.rotation.T + surface.translation)
    origins[30:40] = origins[20:30] + 1e-7
    owner = rng.integers(0, 8, 60)
    owner[30:40] = owner[20:30]
    targets = origins[[np.flatnonzero(owner == k)[0] for k in range(8)]] + 0.3
    distance = np.linalg.norm(targets[owner] - origins, axis=1)
    scaled = np.abs((origins - surface.translation) @ surface.rotation / surface.semi_axes)
    expected = {}
    for i in range(60):
        small = scaled[i] < 0.12 * scaled[i].max()
        near = distance[i] <= distance[owner == owner[i]].min() + 0.2 * size
        if near and small.any():
            cell = (owner[i], *np.round(origins[i] / (1e-3 * size)).astype(int))
            expected.setdefault(cell, (i, small.tolist()))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closest, "LEFT_OUT", 0.2)
        kept, beside = closest._feet_beside_planes(surface, box, targets, owner, origins)
    assert sorted((i, row) for i, row in zip(kept.tolist(), beside.tolist())) == sorted(expected.values())
    assert 5 < len(kept) < 50


def test_signed_distances_are_negative_inside_and_zero_on_the_surface():
    surface, box = deformed(size=0.0)
    origins = surface.grid(4)[0][:3]
    points, normals = closest.surface_points(surface, box, origins)
    targets = points + np.array([0.5, 0.0, -0.25])[:, None] * normals
    found = closest._foot_points(surface, box, targets, origins, points)
    assert isinstance(found, FootPoints)
    np.testing.assert_allclose(found.signed, [0.5, 0, -0.25], atol=1e-12)
    assert np.signbit(found.signed).tolist() == [False, False, True]
    np.testing.assert_array_equal(closest.surface_normals(surface, box, origins), normals)


def test_near_a_focal_point_the_search_starts_again_on_both_sides(monkeypatch):
    """One and two cells to each side along the direction in which the distance is flat."""
    surface = Superquadric(semi_axes=(1.0, 1.0, 3.0), exponents=(1.0, 1.0))
    box, calls, converge = ControlBox.around(surface), [], closest._converge

    def recorded(surface, box, targets, origins):
        calls.append((targets, origins, converge(surface, box, targets, origins)))
        return calls[-1][2]

    monkeypatch.setattr(closest, "_converge", recorded)
    target = np.array([[0.05, 0.0, 2.5]])
    closest.closest_on(surface, box, target)
    (_, first, found), (targets, again, _) = calls
    index = CandidateIndex.of(surface, box)
    distance = np.linalg.norm(target - found.points, axis=1)
    best = int(distance.argmin())
    assert found.curvature[best] < closest.SHALLOW
    vertex = int(np.linalg.norm(index.origins - first[best], axis=1).argmin())
    shift = found.direction[best] * index.cell[vertex]
    expected = surface.project(np.array([found.origins[best] + k * shift for k in (-2, -1, 1, 2)]))
    np.testing.assert_allclose(again, expected, rtol=1e-9)
    np.testing.assert_array_equal(targets, np.repeat(target, 4, axis=0))
    calls.clear()
    closest.closest_on(surface, box, np.array([[1.4, 0.2, 0.3]]))
    assert len(calls) == 1
