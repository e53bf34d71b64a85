"""The two steps together: what is recovered exactly, several surfaces, the record of each iteration."""

import numpy as np
import pytest
from shapes_made import even_directions, made, two_walls, ventricle

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.options import PaperOptions
from quadriform.fitting.paper.displacement import data_to_model
from quadriform.fitting.paper.solvers import svd_step
from quadriform.fitting.paper.two_step import MODEL_RESOLUTION, two_step
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox, outer_box
from quadriform.shapes.superquadric import Superquadric


@pytest.mark.parametrize("exponents", [(1, 1), (0.6, 1.4)])
@pytest.mark.parametrize("shape", [(5, 5, 5), (3, 4, 5)])
def test_affinely_moved_points_give_the_surface_back(exponents, shape, rng):
    """Row B37, the pairing known. Held as the surface, everywhere on it: the control points are not unique."""
    s = made(exponents=exponents)
    box = ControlBox.around(s, shape)
    matrix, shift = np.eye(3) + 0.3 * rng.normal(size=(3, 3)), rng.normal(size=3)
    points = s.surface(even_directions(2000))
    rest = box.control_points.reshape(-1, 3)
    step, _ = svd_step(box.matrix(points), None)
    moved = box.with_control_points(rest + step(points @ matrix.T + shift - points, rest, rest))
    others = s.grid(9)[0]
    size = np.linalg.norm(box.edges)
    np.testing.assert_allclose(moved.deform(others), others @ matrix.T + shift, atol=1e-9 * size)


def test_data_on_the_superellipsoid_moves_nothing():
    """Row B36: the model's own sample as data."""
    s = Superquadric(semi_axes=(1.0, 0.8, 1.2), exponents=(0.7, 1.2))
    for regularity in ("svd", "springs"):
        options = PaperOptions(regularity=regularity, iterations=3)
        box, history, _ = two_step({"surface": s}, {"surface": s.grid(MODEL_RESOLUTION)[0]}, options)
        np.testing.assert_allclose(box.control_points, box.rest, atol=1e-8)
        assert history[0].error < 1e-8


def first_step(surfaces, clouds, shape):
    """One iteration of the union, computed apart with NumPy's least squares."""
    box = outer_box(surfaces, shape)
    samples = {name: s.grid(MODEL_RESOLUTION)[0] for name, s in surfaces.items()}
    pulls = [data_to_model(samples[name], clouds[name]) for name in surfaces]
    stacked = np.concatenate([box.matrix(sample) for sample in samples.values()])
    step = np.linalg.lstsq(stacked, np.concatenate(pulls), rcond=1e-10)[0]
    return stacked @ step, samples


@pytest.mark.parametrize("shape", [(5, 5, 5), (3, 3, 3)])
def test_one_box_for_two_surfaces_is_the_union_least_squares(shape):
    clouds = two_walls(800)
    frame = Frame.of(np.concatenate(list(clouds.values())))
    clouds = {name: frame.to_local(cloud) for name, cloud in clouds.items()}
    surfaces = {name: qf.fit_superquadric(cloud, method="paper").superquadric for name, cloud in clouds.items()}
    box, _, _ = two_step(surfaces, clouds, PaperOptions(shape, "svd", iterations=1))
    moved, samples = first_step(surfaces, clouds, shape)
    found = np.concatenate([box.deform(sample) - sample for sample in samples.values()])
    np.testing.assert_allclose(found, moved, atol=1e-8)


def test_the_box_is_that_of_the_outer_surface_whatever_the_order():
    outer, inner = made(), Superquadric(semi_axes=(1, 1, 1))
    for surfaces in ({"a": outer, "b": inner}, {"b": inner, "a": outer}):
        np.testing.assert_array_equal(outer_box(surfaces, (5, 5, 5)).edges, ControlBox.around(outer).edges)


def test_the_record_is_what_it_says():
    """One iteration, its four lengths computed apart; in the unit of the data, ten times larger for ten times it."""
    cloud = ventricle(600)
    s = qf.fit_superquadric(cloud, method="paper").superquadric
    fit = qf.refine(s, cloud, method="paper", iterations=1)
    sample, box = s.grid(MODEL_RESOLUTION)[0], fit.model.box
    wanted, moved = data_to_model(sample, cloud), box.deform(sample) - sample
    control = box.control_points - box.rest

    def rms(vectors):
        return np.sqrt((vectors.reshape(-1, 3) ** 2).sum(axis=1).mean())

    (record,) = fit.history
    assert record.error == pytest.approx(rms(moved - wanted), rel=1e-6)
    assert record.surface_motion == pytest.approx(rms(moved), rel=1e-6)
    assert record.box_motion == pytest.approx(rms(control), rel=1e-6)
    assert record.box_displacement == pytest.approx(rms(control), rel=1e-6)
    ten = qf.refine(s.transformed(10, np.zeros(3)), 10 * cloud, method="paper", iterations=1).history[0]
    assert ten.error == pytest.approx(10 * record.error, rel=1e-6)


def test_the_stop_test_ends_early_and_progress_is_reported():
    cloud, told = ventricle(600), []
    s = qf.fit_superquadric(cloud, method="paper").superquadric
    fit = qf.refine(
        s, cloud, method="paper", tolerance=1e-2, iterations=30, progress=lambda done, of: told.append((done, of))
    )
    radius = Frame.of(cloud).scale
    assert 1 < fit.iterations < 30
    assert fit.history[-1].surface_motion < 1e-2 * radius <= fit.history[-2].surface_motion
    assert told == [(k + 1, 30) for k in range(fit.iterations)]
    assert qf.refine(s, cloud, method="paper", iterations=4).iterations == 4


def test_control_points_at_the_mercy_of_rounding_are_named():
    """Of points of an ellipsoid, where 27 of the 125 deformations do not move the surface."""
    cloud = made(exponents=(1, 1)).surface(even_directions(400))
    fit = qf.fit(cloud, method="paper", iterations=2)
    assert fit.history[-1].box_displacement > 1e6 * Frame.of(cloud).scale
    assert "strength=1e-6" in fit.warnings["ILL_CONDITIONED"]
    fewer = qf.fit(cloud, method="paper", iterations=2, strength=1e-6)
    assert fewer.strength == 98
    assert "ILL_CONDITIONED" not in fewer.warnings


PAPER = [
    ({"matching": "nearest"}, "matching='nearest'.*data-to-model"),
    ({"regularity": "spring"}, "regularity='spring'.*springs-paper"),
    ({"regularity": "bending"}, "regularity='bending'.*springs-paper"),
    ({"strength": "much"}, "strength='much'"),
    ({"strength": -1.0}, "strength=-1"),
    ({"strength": float("nan")}, "strength=nan"),
    ({"strength": True}, "strength=True"),
    ({"regularity": "svd", "strength": 200}, "strength=200.*125"),
    ({"iterations": 0}, "iterations=0"),
    ({"iterations": 2.5}, "iterations=2.5"),
    ({"tolerance": 0.0}, "tolerance=0"),
    ({"tolerance": float("nan")}, "tolerance=nan"),
    ({"box": (5, 5)}, "box=.*2 to 20"),
    ({"box": (1, 5, 5)}, "box=.*2 to 20"),
    ({"box": (5, 5, 5.5)}, "box=.*2 to 20"),
    ({"box": 5}, "box=5"),
    ({"box": (5, 5, 21)}, "box="),
    ({"robust": False}, "robust is not one of method='paper'.*matching"),
    ({"weights": np.ones(98)}, "weights is not one of method='paper'.*tangent"),
]
TANGENT = [
    ({"iterations": 3}, "iterations is not one of method='tangent'.*regularity"),
    ({"regularity": "svd"}, "regularity='svd'.*bending"),
    ({"strength": "much"}, "strength='much'"),
    ({"strength": -1.0}, "strength=-1"),
    ({"strength": float("nan")}, "strength=nan"),
    ({"box": (5, 5)}, "box=.*2 to 20, or 'auto'"),
    ({"box": "large"}, "box='large'.*'auto'"),
    ({"box": "auto"}, "max_error go together"),
    ({"max_error": 0.1}, "max_error go together"),
    ({"box": "auto", "max_error": -1}, "max_error=-1"),
    ({"box": "auto", "max_error": float("nan")}, "max_error=nan"),
    ({"base": np.zeros((2, 3))}, "base: a loop of 2 points"),
    ({"base": (np.zeros(3), np.zeros(3))}, "direction of the plane is zero"),
]
BAD = [("paper", *row) for row in PAPER] + [("tangent", *row) for row in TANGENT]


@pytest.mark.parametrize(("method", "options", "message"), BAD)
def test_options_out_of_range_are_refused_by_name(method, options, message):
    """Row D79."""
    s = made()
    with pytest.raises(OptionError, match=message):
        qf.refine(s, s.grid(4)[0], method=method, **options)


def test_an_unknown_method_is_refused():
    with pytest.raises(OptionError, match=r"method='best'.*'tangent', 'paper'"):
        qf.refine(made(), made().grid(4)[0], method="best")
