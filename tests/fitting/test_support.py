"""Support is measured from the surface to the data; on spheres its share is known."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import random_directions
from shapes_made import even_directions, lumpy, turned

import quadriform as qf
from quadriform.fitting.diagnostics import unsupported
from quadriform.fitting.support import LIMITS, Reach, Support, interpolated, support_of
from quadriform.shapes.landmarks import BasePlane

BALL = qf.Superquadric().mesh(32)


def support(points, noise=0.0, base=None, mesh=BALL):
    return support_of(mesh, points, points, noise, base)


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
    # of a sphere's volume, seen from its centre, a cap has its share of the area
    centred = support_of(BALL, np.vstack([points, -points]), points, 0.0, None)
    assert centred.volume == pytest.approx(centred.area, abs=0.01)


@pytest.mark.parametrize("count", [60, 200, 1000])
def test_the_gap_between_slices_counts_not_that_within_them(count):
    heights = np.arange(-0.7, 0.71, 0.2)
    found = support(rings(heights, count))
    assert 0.14 < found.limit < 0.2  # three quarters of 0.2, along the surface somewhat more
    assert 1 - found.area == pytest.approx(2 * unsupported_cap(0.7, found.limit), abs=0.01)


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


def test_a_surface_on_points_alone_is_within_any_limit():
    assert interpolated(np.array([9.0]), np.ones(1), np.zeros((1, 3))) == 0


@pytest.fixture(scope="module")
def whole():
    return qf.fit(lumpy(400), box=(3, 3, 3))


@pytest.mark.slow
def test_a_fit_and_its_model_state_their_support(whole, tmp_path):
    assert whole.status == "ok" and whole.supported > 0.99
    cut = qf.fit(lumpy(400)[lumpy(400)[:, 2] < 10], box=(3, 3, 3))
    assert cut.status == "warned" and "PARTIAL_COVERAGE" in cut.warnings
    assert cut.supported < 0.95 and cut.extends_beyond > 5
    qf.save(cut.model, tmp_path / "m.json")
    record = qf.load(tmp_path / "m.json").record
    assert record.supported == {"surface": cut.supported}
    assert record.extends_beyond == {"surface": cut.extends_beyond}


@pytest.mark.slow
def test_several_surfaces_by_name(whole):
    cloud = lumpy(300)
    found = qf.fit({"endo": 0.7 * cloud[cloud[:, 2] < 0], "epi": cloud}, box=(3, 3, 3))
    assert found.supported["epi"] > 0.99 and found.supported["endo"] < 0.9
    assert found.extends_beyond.keys() == {"endo", "epi"}
    assert found.warnings["PARTIAL_COVERAGE"].startswith("endo: ") and "epi: " not in found.warnings["PARTIAL_COVERAGE"]


@pytest.mark.slow
def test_slices_far_apart_leave_their_lids_unsupported():
    """An egg in slices that end far below its ends: in directions from the centre it is covered."""
    cloud = lumpy(20_000)
    position = cloud[:, 2] / np.abs(cloud[:, 2]).max()
    near = np.abs((position * 5 + 0.5) % 1 - 0.5) < 0.02
    found = qf.fit(cloud[near & (np.abs(position) < 0.7)])
    assert found.status != "ok"


@pytest.mark.slow
def test_too_few_points_for_the_box_are_uncertain():
    rng = np.random.default_rng(0)
    cloud = lumpy(60) + 2 * rng.normal(size=(60, 3))
    found = qf.fit(cloud, strength=1e-9, box=(4, 4, 4))
    assert "UNCERTAIN" in found.warnings and found.uncertainty(cloud).mean() > found.noise
