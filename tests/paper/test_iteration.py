"""What the paper shows of its iteration on a ventricle-like shape: convergence, and its Fig. 11 and 12."""

import numpy as np
import pytest
from shapes_made import two_walls, ventricle

import quadriform as qf
from quadriform.fitting.options import PaperOptions


@pytest.fixture(scope="module")
def cloud():
    return ventricle(1000)


@pytest.fixture(scope="module")
def superquadric(cloud):
    return qf.fit_superquadric(cloud, method="paper").superquadric


READINGS = [("svd", "auto"), ("svd", 1e-3), ("springs", "auto"), ("springs", 1e-5)]


@pytest.mark.parametrize(("regularity", "strength"), READINGS)
def test_thirty_iterations_converge(superquadric, cloud, regularity, strength):
    """The last step is at most 10 % of the first, and the error never rises by more than 5 %."""
    fit = qf.refine(superquadric, cloud, method="paper", regularity=regularity, strength=strength)
    steps = [record.surface_motion for record in fit.history]
    errors = np.array([record.error for record in fit.history])
    assert fit.iterations == 30
    assert steps[-1] <= 0.1 * steps[0]
    assert (errors <= 1.05 * np.minimum.accumulate(errors)).all()
    assert fit.rms < 0.2 * fit.superquadric_rms


SETTINGS = {"svd": (97, 60, 30, 12), "springs": (1e-8, 1e-6, 1e-4, 1e-2)}


@pytest.mark.parametrize("regularity", SETTINGS)
def test_regularity_trades_error_against_motion_of_the_box(superquadric, cloud, regularity):
    """Fig. 11 and 12: each stronger setting has a larger error and a quieter box, for both ways."""
    fits = [
        qf.refine(superquadric, cloud, method="paper", regularity=regularity, strength=s) for s in SETTINGS[regularity]
    ]
    errors = [fit.history[-1].error for fit in fits]
    motions = [fit.history[-1].box_displacement for fit in fits]
    assert (np.diff(errors) > 0).all() and (np.diff([fit.rms for fit in fits]) > 0).all()
    assert (np.diff(motions) < 0).all()
    assert [fit.strength for fit in fits] == list(SETTINGS[regularity])


def test_the_papers_direction_of_matching_is_the_better(superquadric, cloud):
    fits = {
        way: qf.refine(superquadric, cloud, method="paper", matching=way) for way in ("data-to-model", "model-to-data")
    }
    assert fits["data-to-model"].rms < fits["model-to-data"].rms


def test_springs_to_the_letter_draw_the_box_in(superquadric, cloud):
    """P9 as printed pulls on P itself: stronger springs make the body smaller; on the displacement they do not."""
    volumes = {
        way: qf.refine(superquadric, cloud, method="paper", regularity=way, strength=1e-2).model.volume()
        for way in ("springs", "springs-paper")
    }
    assert volumes["springs-paper"] < 0.5 * superquadric.volume() < 0.9 * volumes["springs"]


def test_two_walls_in_one_box_need_half_the_numbers():
    """3.4.2: 397 numbers in place of twice 386, and both walls are closer than their superellipsoids."""
    clouds = two_walls(600)
    fit = qf.fit(clouds, method="paper")
    apart = [qf.fit(cloud, method="paper").model.n_parameters for cloud in clouds.values()]
    assert fit.model.n_parameters == 397 < 0.52 * sum(apart)
    for name in clouds:
        assert (fit.residuals[name] ** 2).mean() < 0.1 * (fit.superquadric_residuals[name] ** 2).mean()


def test_the_defaults_are_the_papers():
    """P7 by SVD in full, 5 x 5 x 5 control points, 30 iterations, data to model; compression 46.6 for 6,000 points."""
    options = PaperOptions()
    assert (options.box, options.iterations, options.matching) == ((5, 5, 5), 30, "data-to-model")
    assert (options.regularity, options.strength, options.tolerance) == ("svd", "auto", None)
    assert 3 * 6000 / qf.fit(ventricle(300), method="paper", iterations=1).model.n_parameters == pytest.approx(
        46.6, abs=0.05
    )
