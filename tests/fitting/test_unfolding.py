"""Folds are removed from the space inside, and the surface stays where the data is."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import noisy_egg
from shapes_made import even_directions, made, turned

import quadriform as qf
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem
from quadriform.fitting.least_squares.normal_equations import NormalEquations, normal_equations
from quadriform.fitting.least_squares.regularisers import regulariser_matrix
from quadriform.fitting.refinement import refine as refinement
from quadriform.fitting.refinement.unfolding import certified, without_folds
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.fold_bound import determinant_rows, grid_inside

FEW = noisy_egg(150)


def dented(directions):
    """An ellipsoid with a dent of half its radius on one side."""
    pole = np.array([0.94, 0.28, 0.19])
    angle = np.arccos(np.clip(directions @ pole / np.linalg.norm(pole), -1, 1))
    return directions * (1 - 0.5 * np.exp(-((angle / 0.5) ** 2)))[:, None] * [30, 30, 39]


TRUTH = dented(even_directions(1500))
DENTED = dented(even_directions(500)) + np.random.default_rng(0).normal(0, 0.1, (500, 3))


@pytest.fixture(scope="module")
def start():
    """The one superquadric that all fits of the dented ellipsoid begin with."""
    return qf.fit_superquadric(DENTED).superquadric


@pytest.fixture(scope="module")
def folded(start):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refinement, "without_folds", lambda problem, refined, surfaces, most: iter([refined]))
        return qf.refine(start, DENTED)


def off(model):
    return np.sqrt((model.distance(TRUTH) ** 2).mean())


@pytest.fixture
def box(rng):
    plain = ControlBox.around(made(), (3, 4, 3))
    return plain.with_control_points(plain.control_points + rng.normal(scale=1.0, size=plain.control_points.shape))


def test_the_determinants_rows_are_its_derivatives(box, rng):
    places = box.origin + rng.random((20, 3)) @ box.edges
    direction = rng.normal(size=box.control_points.shape)
    there, back = (box.with_control_points(box.control_points + step * direction) for step in (1e-5, -1e-5))
    slope = (np.linalg.det(there.jacobian(places)) - np.linalg.det(back.jacobian(places))) / 2e-5
    np.testing.assert_allclose(determinant_rows(box, places) @ direction.ravel(), slope, rtol=1e-6, atol=1e-9)


def test_the_matrix_gradient_gives_the_jacobian(box, rng):
    places = box.origin + rng.random((20, 3)) @ box.edges
    rows = np.einsum("nkb,ka->nab", box.matrix_gradient(places), box.control_points.reshape(-1, 3))
    np.testing.assert_allclose(rows, box.jacobian(places), atol=1e-12)


def test_lattice_points_lie_inside():
    surface = made()
    points = grid_inside(ControlBox.around(surface), [surface], 15)
    assert (surface.implicit(points) < 1 + 1e-8).all()
    assert len(points) == pytest.approx(15**3 * surface.volume() / (8 * surface.semi_axes.prod()), rel=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_lattice_points_that_touch_the_surface_are_inside_whatever_rounding_says(seed):
    """Six do where the box touches it; without one of them fold removal gave another result."""
    surface = replace(made(), rotation=turned(seed))
    points = grid_inside(ControlBox.around(surface), [surface], 15)
    assert (np.abs(surface.implicit(points) - 1) < 1e-12).sum() == 6


def test_removing_folds_leaves_the_surface_alone(start, folded):
    """Old bug: a larger strength everywhere removed a small fold inside, and the error grew eightfold."""
    unfolded = qf.refine(start, DENTED)
    assert folded.model.min_jacobian() < 0 < unfolded.model.min_jacobian()
    assert "FOLDING" not in unfolded.warnings and not unfolded.model.crossings()
    assert off(unfolded.model) < 1.1 * off(folded.model) < 0.1
    inside = 0.5 * TRUTH
    assert unfolded.model.undeform(unfolded.model.deform(inside)) == pytest.approx(inside, abs=1e-7)


def test_a_crossing_leaves_no_trace_after_its_removal(monkeypatch, start):
    """Old bug: fold removal from misleading foot points of a self-intersecting surface gave results 2 mm apart."""

    def self_intersecting(seed):
        rng = np.random.default_rng(seed)

        def wrecked(problem, refined, surfaces, most):
            places = refined.box.control_points
            box = refined.box.with_control_points(places + rng.normal(scale=np.ptp(places) / 4, size=places.shape))
            datasets = tuple(replace(data, origins=rng.permutation(data.origins)) for data in refined.datasets)
            return without_folds(problem, replace(refined, box=box, datasets=datasets), surfaces, most)

        monkeypatch.setattr(refinement, "without_folds", wrecked)
        return qf.refine(start, DENTED).model

    one, other = self_intersecting(0), self_intersecting(1)
    assert one.min_jacobian() > 0 and not one.crossings()
    assert off(one) < 0.1
    assert np.abs(one.distance(other.mesh().vertices)).max() < 1e-4


def test_several_surfaces_are_unfolded_at_any_price_but_the_accepted_one_is_sought_first(monkeypatch):
    seen = []
    unfolded = {0: [1.0, 0.4], 1: [0.5], 2: []}

    def look(problem, refined, surfaces, most):
        seen.append(most)
        for sigma in unfolded[(len(seen) - 1) % 3]:
            yield replace(refined, solution=replace(refined.solution, sigma=sigma))

    monkeypatch.setattr(refinement, "without_folds", look)
    fit = qf.fit({"epi": FEW, "endo": 0.7 * FEW}, box=(3, 3, 3))
    assert seen == [np.inf] * 3
    assert fit.noise == pytest.approx(0.4 * Frame.of(np.concatenate([FEW, 0.7 * FEW])).scale)
    seen.clear()
    qf.fit(FEW, box=(3, 3, 3))
    assert max(seen) < 0.5


def test_a_fold_whose_removal_raises_the_noise_too_much_is_reported(monkeypatch, start, folded):
    monkeypatch.setattr(refinement, "accepted_sigma", lambda refined: 0.0)
    fit = qf.refine(start, DENTED)
    assert "sampled points" in fit.warnings["FOLDING"]
    assert fit.model.min_jacobian() < 0
    assert off(fit.model) == off(folded.model)  # the removal that was tried has left no trace


def test_only_what_neither_folds_nor_crosses_is_certified():
    surface = made(exponents=(1.0, 1.0))
    box = ControlBox.around(surface, (3, 3, 3))
    folds = box.control_points.copy()
    folds[1, 1, 1] += 3 * box.edges[0]
    assert certified(box, {"surface": surface})
    assert not certified(box.with_control_points(folds), {"surface": surface})
    beside = replace(surface, translation=surface.translation + surface.rotation[:, 0])
    assert not certified(ControlBox.around(surface, (3, 3, 3)), {"one": surface, "other": beside})


def test_the_noise_after_fold_removal_is_that_of_the_data_alone():
    """Old bug: the residual of the penalty was part of it."""
    box = ControlBox.around(made(exponents=(1.0, 1.0)), (3, 3, 3))
    local = np.random.default_rng(0).random((500, 3))
    wanted = np.random.default_rng(1).normal(0, 0.1, (500, 3))
    data = normal_equations(local, np.tile(np.eye(3), (500, 1, 1)), wanted, box.degrees)
    linear = LinearProblem(data, regulariser_matrix("bending", (3, 3, 3)), 500)
    row = np.ones((1, 81))
    found = linear.with_extra_terms(NormalEquations.of_rows(row, np.array([3.0]), 1e3)).solve(1e-9)
    left = wanted - box.matrix(box.origin + local @ box.edges) @ found.displacement
    assert found.sigma == pytest.approx(np.sqrt((left**2).sum() / (500 - 12)), rel=1e-6)
