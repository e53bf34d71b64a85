"""Control points that nothing determines: an error where the user gave the strength, else a fit with its warnings."""

import numpy as np
import pytest
from shapes_made import even_directions, made

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.initial import principal_axes
from quadriform.fitting.superquadric.levenberg_marquardt import Descent, accelerated
from quadriform.fitting.superquadric.problem import SearchProblem

INDICES = np.stack(np.meshgrid(*[np.arange(-16, 17)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
SPHERE = even_directions(300)


def voxels(inside):
    """Centres of the voxels where a function of the indices (n, 3) is true, as `np.argwhere` returns them."""
    return INDICES[inside(INDICES)] + 16


FILLED = {
    "box": lambda x: (np.abs(x) <= (3, 5, 4)).all(axis=1),
    "ball": lambda x: (x**2).sum(axis=1) <= 7**2,
    "ellipsoid": lambda x: ((x / (4.0, 5.0, 7.0)) ** 2).sum(axis=1) <= 1,
}


@pytest.mark.parametrize("body", FILLED)
def test_filled_volumes_of_voxels_are_fitted_with_a_warning(body):
    """Old bug: "strength=2.6e-08 leaves control points undetermined; try a larger one", and none had been given."""
    found = qf.fit(voxels(FILLED[body]), box=(4, 4, 4))
    assert found.status == "unreliable" and "FILLED_VOLUME" in found.warnings
    assert np.isfinite(found.model.box.control_points).all() and np.isfinite(found.residuals).all()


@pytest.mark.parametrize("thin", [1e-2, 1e-4])
@pytest.mark.parametrize("exponents", [(1, 1), (0.3, 0.3)], ids=["lens", "plate"])
def test_nearly_flat_bodies_are_fitted(thin, exponents):
    points = made(semi_axes=(3.0, 2.0, thin), exponents=exponents).surface(SPHERE)
    found = qf.fit(points, box=(3, 3, 3))
    assert np.isfinite(found.model.box.control_points).all()
    assert found.rms < 1e-2
    true = qf.Superquadric(semi_axes=(3.0, 2.0, thin), exponents=exponents).volume()
    assert "ILL_CONDITIONED" in found.warnings or found.model.volume() == pytest.approx(true, rel=0.02)


def test_the_sides_of_a_thin_body_are_not_taken_for_each_other():
    """Old bug: sides nearer to each other than their points; a twelfth of the volume was left, and nothing was said."""
    thin = made(semi_axes=(3.0, 2.0, 0.1))
    found = qf.fit(thin.surface(even_directions(400)))
    assert found.model.volume() == pytest.approx(thin.volume(), rel=0.05)
    assert found.noise < 0.02


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_a_body_as_thin_as_the_noise_is_warned_of(noise, rng):
    thin = made(semi_axes=(3.0, 2.0, 0.1))
    points = thin.surface(even_directions(400))
    found = qf.refine(thin, points + noise * rng.normal(size=points.shape), box=(3, 3, 3))
    assert ("ILL_CONDITIONED" in found.warnings) == (noise > 0.05)


@pytest.mark.parametrize("strength", [1e-30, 1e-18])
def test_a_strength_that_the_user_gave_is_named_where_it_is_too_small(strength):
    ellipsoid = made(exponents=(1, 1))
    points = ellipsoid.surface(SPHERE)
    with pytest.raises(OptionError, match=rf"option strength={strength:g} leaves control points undetermined"):
        qf.refine(ellipsoid, points, strength=strength)


@pytest.mark.parametrize("strength", [1e6, 1e12])
def test_any_large_strength_gives_a_fit(strength):
    """Old bug: an error that called a strength of 1e6 too small."""
    points = made().surface(SPHERE)
    found = qf.refine(made(exponents=(1, 1)), points * [1, 1, 1.1], strength=strength, box=(3, 3, 3))
    assert found.strength == strength and np.isfinite(found.residuals).all()


def test_a_part_without_any_weight_is_the_whole_cloud():
    """Old bug: moments that are NaN, and an error of the eigenvalue solver."""
    weights = np.stack([np.zeros(300), np.ones(300)])
    axes = principal_axes(SPHERE * [1, 2, 3], weights)
    np.testing.assert_array_equal(axes[0], axes[1])


def test_candidates_without_inliers_stay_where_they_are():
    """Old bug: normal equations of zeros, which cannot be factorised."""
    candidates = Candidates.of([made(exponents=(1, 1))])
    problem = SearchProblem(SPHERE, np.zeros(300), "ellipsoid", {}, np.zeros(300), np.ones(300))
    descent = Descent(problem, candidates, Mixture(np.array([0.5]), np.array([0.1])))
    descent.damping[:] = 0
    np.testing.assert_array_equal(descent._step(), np.zeros((1, 11)))


def test_steps_that_are_not_finite_are_not_mixed():
    places, proposals = [np.zeros(2), np.ones(2), np.ones(2)], [np.ones(2), np.full(2, np.nan), np.ones(2)]
    np.testing.assert_array_equal(accelerated(places, proposals), np.ones(2))
