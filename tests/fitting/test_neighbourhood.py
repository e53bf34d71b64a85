"""What neighbours tell, on clouds where it is known: spheres, holes, curves, filled balls, thin walls."""

import numpy as np
import pytest
from clouds_made import cup, random_directions
from shapes_made import even_directions, turned

from quadriform.fitting.cloud import (
    Neighbourhood,
    dense_points,
    has_edge,
    is_surface,
    oriented,
    widest_empty_angle,
)

SPHERE = even_directions(1500)
T = np.linspace(0, 2 * np.pi, 400, endpoint=False)
CURVES = {
    "circle": (np.column_stack([np.cos(T), np.sin(T), 0 * T]), np.column_stack([-np.sin(T), np.cos(T), 0 * T])),
    "line": (np.outer(T, [1.0, 2.0, 2.0]), np.tile([1, 2, 2.0], (len(T), 1)) / 3),
}


def filled_ball(n=1500, seed=0):
    return random_directions(n, seed) * np.cbrt(np.random.default_rng(seed + 1).uniform(size=(n, 1)))


def plane(n=1500, hole=0.0, seed=0):
    flat = np.random.default_rng(seed).uniform(-1, 1, (n, 2))
    flat = flat[np.linalg.norm(flat, axis=1) >= hole]
    return np.column_stack([flat, np.zeros(len(flat))]) @ turned(3).T, turned(3)[:, 2]


def test_on_a_sphere_the_flattest_way_is_the_radius():
    around = Neighbourhood.of(SPHERE)
    assert (np.abs(np.einsum("ni,ni->n", around.normals, SPHERE)) > np.cos(np.radians(3))).all()
    assert np.abs(np.einsum("ni,ni->n", around.along, around.normals)).max() < 1e-12
    assert around.flatness.min() > 0.25


def test_on_a_plane_the_normal_is_exact():
    points, normal = plane()
    around = Neighbourhood.of(points)
    np.testing.assert_allclose(np.abs(around.normals @ normal), 1, atol=1e-12)


@pytest.mark.parametrize("curve", CURVES)
def test_on_a_curve_there_is_no_normal_but_a_way_along(curve):
    points, tangents = CURVES[curve]
    around = Neighbourhood.of(points)
    assert (np.abs(np.einsum("ni,ni->n", around.along, tangents)) > 0.999).all()
    assert around.flatness.max() < 0.01
    assert not is_surface(around)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_sampled_surface_is_one(seed):
    assert is_surface(Neighbourhood.of(random_directions(1000, seed)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_volume_is_no_surface(seed):
    assert not is_surface(Neighbourhood.of(filled_ball(1500, seed)))


@pytest.mark.parametrize("n", [700, 1500])
def test_closed_surfaces_have_no_edge_and_open_ones_have(n):
    for seed in range(3):
        closed = random_directions(n, seed)
        assert not has_edge(closed, Neighbourhood.of(closed))
        opened = closed[closed[:, 2] < 0.5]
        assert has_edge(opened, Neighbourhood.of(opened))


@pytest.mark.parametrize("n", [900, 1500])
def test_a_hole_of_a_sixth_is_an_edge(n):
    """Sixteen hundredths of the sphere are missing; without the hole there is no edge."""
    whole = even_directions(n)
    holed = whole[np.linalg.norm(whole - [0, 0, 1], axis=1) > 0.8]
    assert not has_edge(whole, Neighbourhood.of(whole))
    assert has_edge(holed, Neighbourhood.of(holed))


def cone(n, height, base=True):
    """Even points on a cone of radius one, on its mantle and its base."""
    slope = np.hypot(1, height)
    mantle = int(n * slope / (slope + 1))
    counts = (mantle, n - mantle)
    turn = np.pi * (1 + 5**0.5) * np.arange(max(counts))
    one, other = (np.sqrt((np.arange(count) + 0.5) / count) for count in counts)
    sides = np.column_stack([one * np.cos(turn[:mantle]), one * np.sin(turn[:mantle]), height * (1 - one)])
    bottom = other[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])[: n - mantle]
    return np.vstack([sides, np.column_stack([bottom, np.zeros(n - mantle)])]) if base else sides


@pytest.mark.parametrize("height", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("n", [1000, 1500])
def test_the_sharp_rim_of_a_closed_cone_is_no_edge_of_the_cloud(n, height):
    """At the rim both faces lie on one side of every point; without the base the surface does end there."""
    closed, opened = cone(n, height) @ turned(1).T, cone(n, height, base=False) @ turned(1).T
    assert not has_edge(closed, Neighbourhood.of(closed))
    assert has_edge(opened, Neighbourhood.of(opened))


def test_an_edge_is_seen_through_noise_and_outliers(rng):
    """Neither noise, nor a few outliers beside the rim, nor a bend makes the end of a cloud a sharp edge."""
    half = even_directions(2000)
    half = half[half[:, 2] < 0]
    noisy = half + rng.normal(0, 0.05, half.shape)
    stray = np.vstack([half, 0.3 * rng.normal(size=(60, 3)) + half[:60]])
    bent = even_directions(1500)
    bent = bent[bent[:, 2] < 0.5] * [3, 3, 1]
    for cloud in (noisy, stray, bent):
        assert has_edge(cloud, Neighbourhood.of(cloud))


def test_outliers_are_alone():
    """A hundred scattered through twenty-seven times the room of a sphere of 900."""
    outliers = np.random.default_rng(2).uniform(-3, 3, (100, 3))
    outliers = outliers[np.abs(np.linalg.norm(outliers, axis=1) - 1) > 0.5]
    near = dense_points(np.concatenate([even_directions(900), outliers]))
    assert near[:900].all()
    assert near[900:].mean() < 0.1


@pytest.mark.parametrize(("n", "wall"), [(1000, 8.0), (1500, 7.0), (3000, 5.0), (1500, 12.0)])
def test_normals_of_a_thin_wall_face_out_of_it_on_both_sides(n, wall):
    """Two spacings thick. Paths straight through the wall once turned a third of them round."""
    points, outward = cup(n, wall)
    found = oriented(points, Neighbourhood.of(points).normals)
    assert (np.einsum("ni,ni->n", found, outward) > 0).mean() > 0.97


def test_every_part_of_a_cloud_faces_out_of_its_own(rng):
    """Two spheres far apart; the signs that come in do not matter, and the input stays as it is.

    The outermost point of a part faces away from the middle of all: on a sphere that is out of the part too.
    """
    points = np.concatenate([SPHERE, SPHERE[::2] + np.array([10, 0, 0])])
    outward = np.concatenate([SPHERE, SPHERE[::2]])
    normals = Neighbourhood.of(points).normals * rng.choice([-1, 1], (len(points), 1))
    before = normals.copy()
    found = oriented(points, normals)
    np.testing.assert_array_equal(normals, before)
    assert (np.einsum("ni,ni->n", found, outward) > 0.9).all()


def test_an_empty_angle_is_found_in_any_direction():
    """Also where it lies across the end of the range of angles, -pi and pi."""
    half = np.linspace(-np.pi / 2, np.pi / 2, 7)
    rotated = half + np.linspace(0, 2 * np.pi, 16)[:, None]
    angles = np.arctan2(np.sin(rotated), np.cos(rotated))
    np.testing.assert_allclose(widest_empty_angle(angles), np.pi)
