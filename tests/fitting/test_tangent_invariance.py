"""The refinement moves with its points; weights are numbers of points. Surfaces are compared, in RMS radii."""

import numpy as np
import pytest
from clouds_made import noisy_egg, with_outliers
from notes import note_of
from shapes_made import gap, turned

import quadriform as qf
from quadriform.points import Frame
from quadriform.shapes.superquadric import Superquadric

CLOUD = noisy_egg(300)
BOX = {"box": (4, 4, 4)}
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
LOCAL = "slides leave foot points on their way, by different amounts in different frames: 4e-6"


def carried(superquadric, matrix, scale, offset):
    turned_round = Superquadric(
        superquadric.kind,
        scale * superquadric.semi_axes,
        superquadric.exponents,
        matrix @ superquadric.rotation,
        scale * matrix @ superquadric.translation + offset,
    )
    return turned_round


@pytest.fixture(scope="module")
def start():
    return qf.fit_superquadric(CLOUD).superquadric


@pytest.fixture(scope="module")
def refined(start):
    return qf.refine(start, CLOUD, **BOX)


@pytest.fixture(scope="module")
def left_out(start):
    """Its last fifty points are anywhere, and have no weight; and the cloud with them."""
    cloud, weights = with_outliers(CLOUD, 50), np.ones(len(CLOUD))
    weights[-50:] = 0
    return qf.refine(start, cloud, weights=weights, **BOX), cloud


def moved(model, found, matrix, scale, offset):
    """Largest distance of the carried vertices to the surface found, in RMS radii."""
    vertices = scale * model.mesh(resolution=8).vertices @ matrix.T + offset
    return np.abs(found.distance(vertices)).max() / Frame.of(vertices).scale


EXACT = {
    "shift": (np.eye(3), 1.0, np.array([5.0, -30, 12])),
    "scale 1e6": (np.eye(3), 1e6, np.zeros(3)),
    "offset 1e6": (np.eye(3), 1.0, np.array([1e6, -1e6, 1e6])),
}
TURNS = {"quarter": (QUARTER, 1.0, np.zeros(3)), "turn": (turned(1), 1.0, np.array([5.0, -30, 12]))}


@pytest.mark.parametrize("change", [*EXACT, "quarter", pytest.param("turn", marks=pytest.mark.skip(reason=LOCAL))])
def test_a_refinement_moves_with_its_points(change, start, refined):
    """M1, M2, M9, from a start that is carried along."""
    matrix, scale, offset = (EXACT | TURNS)[change]
    found = qf.refine(carried(start, matrix, scale, offset), scale * CLOUD @ matrix.T + offset, **BOX)
    assert moved(refined.model, found.model, matrix, scale, offset) < 1e-7
    assert found.noise == pytest.approx(scale * refined.noise, rel=1e-6)
    assert found.strength == pytest.approx(refined.strength, rel=1e-6)


def test_a_whole_fit_moves_with_its_points():
    """In a box of five a side; the other motions, of a smaller one, are among the properties."""
    matrix, scale, offset = TURNS["turn"]
    plain, found = qf.fit(CLOUD), qf.fit(scale * CLOUD @ matrix.T + offset)
    assert moved(plain.model, found.model, matrix, scale, offset) < 1e-7


def test_weights_of_one_are_no_weights(start, refined):
    assert gap(qf.refine(start, CLOUD, weights=np.ones(len(CLOUD)), **BOX).model, refined.model) < 1e-12


def test_points_of_weight_zero_are_no_inliers_and_give_no_warning(left_out):
    """M4: what the caller has left out is no outlier."""
    found, _ = left_out
    np.testing.assert_array_equal(found.inliers[-50:], 0)
    assert found.inliers[:-50].mean() > 0.98
    assert not note_of(found, "OUTLIERS")


def test_a_weight_of_zero_is_an_absent_point(start, left_out):
    """M4."""
    zero, cloud = left_out
    absent = qf.refine(start, cloud[:-50], **BOX)
    assert gap(absent.model, zero.model) < 1e-7
    assert zero.noise == pytest.approx(absent.noise, rel=1e-7)


def test_a_whole_fit_does_not_see_points_of_weight_zero():
    """M4."""
    cloud, weights = with_outliers(CLOUD, 50), np.ones(len(CLOUD))
    weights[-50:] = 0
    zero, absent = qf.fit(cloud, weights=weights, **BOX), qf.fit(cloud[:-50], **BOX)
    assert gap(absent.model, zero.model) < 1e-7
    assert zero.noise == pytest.approx(absent.noise, rel=1e-7)


def test_all_weights_doubled_are_the_same_surface(start, refined):
    """M4."""
    assert gap(refined.model, qf.refine(start, CLOUD, weights=np.full(len(CLOUD), 2.0), **BOX).model) < 1e-7


def test_a_weight_of_two_is_two_copies(start):
    """M4."""
    weights = 1.0 + (CLOUD[:, 2] > 0)
    double = qf.refine(start, CLOUD, weights=weights, **BOX)
    copies = qf.refine(start, np.concatenate([CLOUD, CLOUD[CLOUD[:, 2] > 0]]), **BOX)
    assert gap(double.model, copies.model) < 1e-7


def test_what_weighs_more_is_met_more_closely(start):
    """At a given strength; half of the points count a hundred times the others."""
    heavy = np.arange(len(CLOUD)) % 2 == 0
    plain = qf.refine(start, CLOUD, strength=1e-5, box=(4, 4, 4))
    found = qf.refine(start, CLOUD, strength=1e-5, box=(4, 4, 4), weights=np.where(heavy, 100.0, 1.0))
    before, after = (np.sqrt((fit.residuals[heavy] ** 2).mean()) for fit in (plain, found))
    assert after < 0.95 * before
