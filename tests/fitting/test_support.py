"""Support is measured from the surface to the data; on spheres its share is known."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import even_directions, lumpy, turned

import quadriform as qf
from quadriform.errors import status_of
from quadriform.fitting.diagnostics import unsupported
from quadriform.fitting.noise import sampling_step
from quadriform.fitting.support import Reach, Support, support_of
from quadriform.fitting.support_settings import LIMITS
from quadriform.shapes.landmarks import BasePlane

BALL = qf.Superquadric().mesh(32)


def support(points, noise=0.0, base=None, mesh=BALL, step=0.0):
    return support_of(mesh, points, points, noise, base, step)


def rings(heights, count=200):
    """Points on circles of latitude of the unit sphere."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    z = np.repeat(heights, count)
    radius, around = np.sqrt(1 - z**2), np.tile(angle, len(heights))
    return np.stack([radius * np.cos(around), radius * np.sin(around), z], axis=1)


def unsupported_cap(low, limit):
    """Share of the sphere's area above a height that is farther than a limit from the circle there."""
    angle = np.arccos(low) - 2 * np.arcsin(limit / 2)
    return (1 - np.cos(max(angle, 0.0))) / 2


@pytest.mark.parametrize("points", [even_directions(300), random_directions(300, 1), random_directions(3000, 2)])
def test_a_surface_with_points_everywhere_is_supported(points):
    found = support(points)
    assert found.area > 0.99 and found.volume > 0.99 and found.extends_beyond < found.limit


@pytest.mark.parametrize("low", [-0.5, 0.0, 0.4])
def test_a_cap_without_points_is_not(low):
    points = random_directions(4000, 3)
    points = points[points[:, 2] < low]
    found = support(points)
    assert found.area == pytest.approx(1 - unsupported_cap(low, found.limit), abs=0.02)
    assert found.extends_beyond == pytest.approx(1 - low, abs=0.05)


def test_of_a_spheres_volume_a_cap_has_its_fraction_of_the_area():
    points = random_directions(4000, 3)
    found = support(points[np.abs(points[:, 2]) < 0.5])
    assert 0.5 < found.area < 0.6 and found.volume == pytest.approx(found.area, abs=0.01)


@pytest.mark.parametrize("ends", [0.5, 0.7, 0.85])
@pytest.mark.parametrize("count", [200, 2000])
def test_a_surface_is_supported_up_to_one_distance_beyond_the_last_slice(count, ends):
    """However many points there are along the contours, and however much of the surface lies beyond the last one."""
    angles = np.linspace(-np.arcsin(ends), np.arcsin(ends), 11)
    distance = angles[1] - angles[0]
    found = support(rings(np.sin(angles), count))
    assert found.limit == pytest.approx(distance, rel=0.12)
    assert 1 - found.area == pytest.approx(2 * unsupported_cap(ends, found.limit), abs=0.01)


def test_ten_times_more_points_along_the_same_contours_have_the_same_limit():
    heights = np.arange(-0.7, 0.71, 0.2)
    few, many = (support(rings(heights, count)).limit for count in (120, 1200))
    assert many == pytest.approx(few, rel=0.02)


def test_a_hole_does_not_widen_the_gaps_around_it():
    """Of the same points, those with a hole of a third of the sphere have the limit of all."""
    points = random_directions(600, 8)
    whole, cut = support(points).limit, support(points[points[:, 2] < 0.33]).limit
    assert cut == pytest.approx(whole, rel=0.08)
    assert whole == pytest.approx(2 * np.sqrt(4 * np.pi / 600), rel=0.1)  # two mean spacings


def test_a_single_point_far_from_all_others_is_no_data():
    """Old fault: a fit with a bulge of a third of its size to an outlier was "ok"."""
    points = random_directions(2000, 9)
    cap = points[points[:, 2] < 0.4]
    tip = np.array([[0.0, 0.0, 1.0]])
    found, more = support(cap), support(np.vstack([cap, tip]))
    assert more.area == pytest.approx(found.area, abs=1e-3) and more.reach.distance == found.reach.distance
    patch = points[points[:, 2] > 0.98]  # many points are data
    assert support(np.vstack([cap, patch])).reach.distance < found.limit


def test_thick_slices_are_known_by_their_voxels():
    """A mask of voxels of 1 x 1 x 8: where its points lie does not matter, the next slice is 8 away."""
    edges = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 8]])[np.arange(300) % 3]
    assert sampling_step(edges[:, :, None] * edges[:, None, :] / 12) == pytest.approx(8)
    assert sampling_step(None) == sampling_step(np.empty((0, 3, 3))) == 0
    heights = np.arange(-0.7, 0.71, 0.1)
    assert support(rings(heights)).limit < 0.15 < support(rings(heights), step=0.2).limit == 0.2


def hemisphere(sag):
    """The lower half of the unit sphere with points, closed by a flat lid a little below its base."""
    mesh = qf.Mesh(np.minimum(BALL.vertices, [9, 9, -sag]), BALL.faces)
    points = random_directions(4000, 10)
    return mesh, points[points[:, 2] < -sag]


def test_a_lid_at_its_base_is_the_base():
    """Old fault: hearts whose surfaces close a millimetre below the last slice were warned of."""
    base = BasePlane(np.zeros(3), np.array([0.0, 0, 1]))
    mesh, points = hemisphere(0.03)
    assert support(points, noise=0.02, base=base, mesh=mesh).within > 0.95
    assert support(points, noise=0.01, base=base, mesh=mesh).within < 0.8


@pytest.mark.parametrize("sag", [0.03, 0.1])
def test_what_is_missing_up_to_the_base_is_not_observed(sag):
    """Whatever the noise: the space between lid and base counts as extrapolated, where no data is near."""
    base = BasePlane(np.zeros(3), np.array([0.0, 0, 1]))
    mesh, points = hemisphere(sag)
    found = support(points, noise=0.06, base=base, mesh=mesh)
    missing = np.pi * sag * (np.sqrt(1 - sag**2) - found.limit) ** 2
    assert 1 - found.below == pytest.approx(missing / (2 * np.pi / 3), rel=0.15)
    assert found.within <= found.below


def test_two_slices_support_no_surface_between_them():
    found = support(rings([-0.4, 0.4]))
    assert found.limit == pytest.approx(LIMITS.widest, rel=0.01) and found.area < 0.85
    assert support(rings([0.0])).area < 0.5


def test_noise_widens_the_limit():
    points = random_directions(2000, 4)
    points = points[points[:, 2] < 0.9]
    assert support(points).area < 0.98 < support(points, noise=0.15).area == 1.0


def test_beyond_a_base_nothing_is_expected():
    points = random_directions(2000, 5)
    found = support(points[points[:, 2] < 0], base=BasePlane(np.zeros(3), np.array([0.0, 0, 1])))
    assert found.area < 0.6 and found.extends_beyond == pytest.approx(1, abs=0.05)
    assert found.within > 0.99 and found.below > 0.99 and found.reach.distance < found.limit


def test_pose_unit_and_copies_do_not_matter():
    points = random_directions(500, 6)
    points = points[points[:, 0] < 0.3]
    found, rotation = support(points), turned(4)
    moved = qf.Mesh(10 * BALL.vertices @ rotation.T + 5, BALL.faces)
    other = support(np.vstack([10 * points @ rotation.T + 5] * 2), mesh=moved)
    assert other.area == pytest.approx(found.area, abs=1e-9) and other.limit == pytest.approx(10 * found.limit)
    assert other.extends_beyond == pytest.approx(10 * found.extends_beyond, rel=0.02)
    assert found.scaled(10).limit == pytest.approx(other.limit) and found.scaled(10).area == found.area


def test_a_protrusion_reaches_beyond_the_data():
    found = Reach.of(np.array([[0.0, 0, 3]]), random_directions(500, 7))
    assert found.distance == pytest.approx(2, abs=0.02) == found.width
    for inside in (np.zeros((1, 3)), np.empty((0, 3))):
        assert Reach.of(inside, BALL.vertices).distance == 0


def test_more_than_half_as_long_again_as_the_data_is_unreliable():
    half = Support(0.6, 0.6, 0.6, 0.6, 0.2, 1.0, Reach(1.0, 1.0))
    assert unsupported(half).keys() == {"PARTIAL_COVERAGE"}
    assert unsupported(replace(half, reach=Reach(1.6, 1.0))).keys() == {"PARTIAL_COVERAGE", "RUNAWAY"}
    less = replace(half, within=0.4)
    assert unsupported(less).keys() == unsupported(less, 0.06).keys() == {"PARTIAL_COVERAGE", "UNSUPPORTED"}
    assert unsupported(less, 0.04).keys() == {"PARTIAL_COVERAGE"}
    good = replace(half, within=0.96, reach=Reach(0.1, 1.0))
    assert not unsupported(good) and unsupported(replace(good, reach=Reach(0.3, 1.0))).keys() == {"PARTIAL_COVERAGE"}


def test_no_data_supports_nothing():
    found = support(np.empty((0, 3)))
    assert found.area == found.volume == 0 and found.extends_beyond > 0


def test_two_points_are_no_data():
    found = support(np.eye(3)[[0, 1, 1]])
    assert found.area == 0 and found.extends_beyond > 0


@pytest.fixture(scope="module")
def whole():
    return qf.fit(lumpy(400), box=(3, 3, 3))


def test_a_fit_and_its_model_state_their_support(whole, tmp_path):
    assert whole.status == "ok" and whole.supported > 0.99
    cut = qf.fit(lumpy(400)[lumpy(400)[:, 2] < 10], box=(3, 3, 3))
    assert cut.status == "warned" and "PARTIAL_COVERAGE" in cut.warnings
    assert cut.supported < 0.95 and cut.extends_beyond > 5
    qf.save(cut.model, tmp_path / "m.json")
    record = qf.load(tmp_path / "m.json").record
    assert record.supported == {"surface": cut.supported}
    assert record.extends_beyond == {"surface": cut.extends_beyond}


def test_several_surfaces_by_name(whole):
    cloud = lumpy(300)
    found = qf.fit({"endo": 0.7 * cloud[cloud[:, 2] < 0], "epi": cloud}, box=(3, 3, 3))
    assert found.supported["epi"] > 0.99 and found.supported["endo"] < 0.9
    assert found.extends_beyond.keys() == {"endo", "epi"}
    assert found.warnings["PARTIAL_COVERAGE"].startswith("endo: ") and "epi: " not in found.warnings["PARTIAL_COVERAGE"]


def test_slices_far_apart_leave_their_lids_unsupported():
    """An egg in slices that end far below its ends: in directions from the centre it is covered."""
    cloud = lumpy(20_000)
    position = cloud[:, 2] / np.abs(cloud[:, 2]).max()
    near = np.abs((position * 5 + 0.5) % 1 - 0.5) < 0.02
    found = qf.fit(cloud[near & (np.abs(position) < 0.7)])
    assert found.status != "ok"


def test_too_few_points_for_the_box_are_uncertain():
    rng = np.random.default_rng(0)
    cloud = lumpy(60) + 2 * rng.normal(size=(60, 3))
    found = qf.fit(cloud, strength=1e-9, box=(4, 4, 4))
    assert "UNCERTAIN" in found.warnings and found.uncertainty(cloud).mean() > found.noise


def test_isolated_points_are_data_of_no_surface_and_no_width_of_theirs_is_stated():
    """As in a frame of `track` with few points; it was said that the surface "reaches beyond data that is 0 wide"."""
    points = even_directions(12)
    found = unsupported(support(points))
    assert found.keys() == {"PARTIAL_COVERAGE", "UNSUPPORTED"} and status_of(found) == "unreliable"
    assert found["UNSUPPORTED"].startswith("all points are isolated")
