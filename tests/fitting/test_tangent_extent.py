"""Where data ends, how many control points it needs, two surfaces in one box, and a shape that is not star-shaped."""

import numpy as np
import pytest
from clouds_made import cup, error, noisy_egg
from shapes_made import even_directions, gap, made, two_walls

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.refinement import refine
from quadriform.shapes.landmarks import BasePlane, check_base

BODY = made(exponents=(1, 1), semi_axes=(30, 20, 40))
UP = BODY.rotation[:, 2]
AT = BODY.translation + 8 * UP


@pytest.fixture(scope="module")
def cut():
    """An ellipsoid with noise, cut where a plane crosses it."""
    points = BODY.surface(even_directions(800))
    points = points[(points - AT) @ UP < 0]
    return points + 0.3 * np.random.default_rng(1).normal(size=points.shape)


@pytest.fixture(scope="module")
def based(cut):
    return qf.refine(BODY, cut, base=(AT, UP))


def test_a_cut_shape_is_warned_of_unless_the_cut_is_on_purpose(cut, based):
    without = qf.refine(BODY, cut)
    assert "extrapolated" in without.warnings["PARTIAL_COVERAGE"]
    assert based.status == "ok"


def test_a_base_elsewhere_excuses_nothing(cut):
    assert "PARTIAL_COVERAGE" in qf.refine(BODY, cut, base=(AT + 100 * UP, UP)).warnings


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ((AT, -UP), "of the data lies beyond the plane.*try the reverse direction"),
        ((BODY.translation - 10 * UP, UP), "through the middle of the data"),
        ((BODY.translation - 10 * UP, -UP), "through the middle of the data"),
    ],
)
def test_a_base_is_an_edge_of_the_data(cut, base, message):
    for surfaces, points in ((BODY, cut), ({"endo": BODY, "epi": BODY}, {"endo": cut, "epi": 1.1 * cut})):
        with pytest.raises(OptionError, match=message):
            qf.refine(surfaces, points, base=base)


def test_outliers_beyond_a_base_do_not_matter(cut, rng):
    """A third of all points, evenly in a box around the body."""
    clutter = rng.uniform(cut.min(axis=0), cut.max(axis=0) + 20 * UP, (len(cut) // 2, 3))
    check_base(BasePlane(AT, UP), np.concatenate([cut, clutter]))


def test_a_loop_is_its_plane(cut, based):
    t = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    ring = 20 * np.cos(t)[:, None] * BODY.rotation[:, 0] + 15 * np.sin(t)[:, None] * BODY.rotation[:, 1]
    loop = qf.refine(BODY, cut, base=AT + ring)
    assert loop.status == "ok"
    assert gap(loop.model, based.model) < 1e-9


def test_without_data_the_surface_is_less_certain(cut, based):
    whole = BODY.surface(even_directions(600))
    sigma, measured = based.uncertainty(whole), (whole - AT) @ UP < -5
    assert sigma[~measured].mean() > 2 * sigma[measured].mean()
    assert (np.abs(based.model.distance(whole)) < 4 * sigma).mean() > 0.95


CLEAN = noisy_egg(300, noise=0.0)


@pytest.fixture(scope="module")
def start():
    return qf.fit_superquadric(CLEAN).superquadric


def test_the_smallest_box_that_reaches_the_error_is_taken(start):
    """A little more than what three a side reach, and a little less."""
    errors = {side: qf.refine(start, CLEAN, box=(side,) * 3) for side in (3, 5)}
    assert errors[5].rms < 0.3 * errors[3].rms
    for wanted, side in ((1.01 * errors[3].rms, 3), (0.9 * errors[3].rms, 5)):
        found = qf.refine(start, CLEAN, box="auto", max_error=wanted)
        assert found.model.box.control_points.shape == (side, side, side, 3)
        assert gap(found.model, errors[side].model) < 1e-9
        assert "POOR_FIT" not in found.warnings


def test_an_error_out_of_reach_is_reported(monkeypatch):
    """With the largest box, which is one of seven a side; a smaller one stands for it here."""
    assert refine.AUTO_SIDES[-1] == 7
    monkeypatch.setattr(refine, "AUTO_SIDES", (3, 4))
    points = noisy_egg(200)
    found = qf.refine(qf.fit_superquadric(points).superquadric, points, box="auto", max_error=0.01)
    assert found.model.box.control_points.shape == (4, 4, 4, 3)
    assert found.status == "warned" and "max_error" in found.warnings["POOR_FIT"]


def test_sides_may_differ(start):
    found = qf.refine(start, CLEAN, box=(3, 4, 6))
    assert found.model.box.control_points.shape == (3, 4, 6, 3)
    assert found.model.n_parameters == 11 + 3 * 72
    assert found.rms < 0.2 * found.superquadric_rms


@pytest.fixture(scope="module")
def walls():
    rng = np.random.default_rng(1)
    return {name: cloud + 0.3 * rng.normal(size=cloud.shape) for name, cloud in two_walls(400).items()}


@pytest.fixture(scope="module")
def both(walls):
    return qf.fit(walls)


def test_two_surfaces_share_a_box_that_does_not_fold(both):
    assert both.model.n_parameters == 397
    assert both.model.min_jacobian() > 0 and not len(both.model.folds())
    assert not both.model.crossings()
    assert both.model.nesting() == {("epi", "endo"): "around"}
    assert "FOLDING" not in both.warnings


def test_two_surfaces_have_one_noise_and_each_their_residuals(both, walls):
    assert both.noise == pytest.approx(0.3, rel=0.1)
    for name, cloud in walls.items():
        assert both.inliers[name].shape == both.residuals[name].shape == (400,)
        np.testing.assert_allclose(both.residuals[name], both.model.distance(cloud, name), atol=1e-6)
        assert 0 < both.uncertainty(cloud[:20], name).max() < 0.3


def bent(points):
    return points + np.column_stack([0.004 * points[:, 2] ** 2, 3 * np.sin(points[:, 2] / 20), 0 * points[:, 2]])


def test_a_thick_walled_cup_unfolds():
    """Not star-shaped, bent, noise 1 % of its length: the inside is found and not closed over as noise."""
    points, truth = bent(cup(800, 12.0, seed=2)[0]), bent(cup(2000, 12.0)[0])
    length = np.ptp(points[:, 2])
    fit = qf.fit(points + 0.01 * length * np.random.default_rng(2).normal(size=points.shape), box=(5, 5, 5))
    assert error(fit.model, truth) < 0.015 * length
    assert not fit.model.crossings()
    assert not fit.model.contains(np.array([[0.0, 0, -10]])).any()  # the cavity is outside of the wall
    assert fit.noise == pytest.approx(0.01 * length, rel=0.1)
