"""Fits with a prior: members of a population in any pose, from part of their surface, with outliers, and others."""

from dataclasses import replace

import numpy as np
import pytest
from priors_made import AXES, SIGMAS, SPHERE, meshes, models, poses, wall

from quadriform import fit, learn_prior, refine
from quadriform.errors import InputError, OptionError
from quadriform.fitting.population.poses import closest_poses
from quadriform.shapes.superquadric import Superquadric

NOISE = 0.3


@pytest.fixture(scope="module")
def prior():
    return learn_prior(meshes())


def surface(prior, scores=(1.0, -1.0, 0.5), resolution=8):
    return prior.model(scores).mesh(resolution=resolution).vertices


def noisy(points, seed=0, noise=NOISE):
    return points + np.random.default_rng(seed).normal(0, noise, points.shape)


def rms(found, points):
    return float(np.sqrt((found.model.distance(points) ** 2).mean()))


@pytest.fixture(scope="module")
def half(prior):
    """A fit to the half of a member with x > 0, and points of all of it."""
    whole = surface(prior)
    return fit(noisy(whole[whole[:, 0] > 0]), prior=prior), whole


@pytest.mark.parametrize("number", range(2))
def test_a_member_is_found_in_any_pose(prior, number):
    rotations, shifts = poses(2)
    points = surface(prior) @ rotations[number].T + shifts[number]
    found = fit(noisy(points), prior=prior)
    assert rms(found, points) < 0.25 * NOISE
    assert found.status == "ok" and found.noise == pytest.approx(NOISE, rel=0.15)
    # the modes of an ellipsoid are those of its axes, so the scores are those of the member
    assert found.prior_distance == pytest.approx(1.5, abs=0.3)


def test_a_surface_without_data_is_that_of_the_population(half):
    found, whole = half
    assert rms(found, whole[whole[:, 0] < -10]) < 3 * NOISE
    assert found.status == "warned" and "that of the population" in found.warnings["PARTIAL_COVERAGE"]


def test_the_error_without_data_is_explained_by_the_uncertainty(half):
    """Errors are those of three modes, alike over the surface, so that no fraction of points is expected."""
    found, whole = half
    ratio = found.model.distance(whole) / found.uncertainty(whole)
    assert np.abs(ratio).max() < 4 and 0.2 < np.sqrt((ratio**2).mean()) < 2


def test_outliers_do_not_matter(prior):
    points = noisy(surface(prior))
    far = np.random.default_rng(5).uniform(-80, 80, (60, 3))
    found = fit(np.concatenate([points, far]), prior=prior)
    assert rms(found, surface(prior)) < 0.3 * NOISE
    assert np.mean(found.inliers[len(points) :] < 0.5) > 0.85


def test_a_shape_outside_of_the_population_is_fitted_to_its_data(prior):
    """A bulge that no member has stays; the mean of the population would be eight units away there."""
    points = surface(prior, resolution=14)
    top = points[points[:, 2].argmax()]
    height = 8 * np.exp(-((points - top) ** 2).sum(axis=1) / (2 * 15**2))
    points = points + height[:, None] * np.array([0.0, 0.0, 1.0])
    found, alone = fit(noisy(points), prior=prior), fit(noisy(points))
    assert rms(found, points) < 1.05 * rms(alone, points)


def test_a_shape_unlike_all_members_is_named():
    prior = learn_prior([mesh for _ in range(8) for mesh in meshes()])  # of 64, so that its variances are well known
    # nine standard deviations longer; the sign of a mode is a convention
    found = fit(noisy(SPHERE.vertices * (AXES + 9 * SIGMAS * (0, 0, 1))), prior=prior)
    assert "OUTSIDE_POPULATION" in found.warnings and found.status == "warned"


def test_a_prior_without_sizes_finds_a_member_of_another_size():
    prior = learn_prior(meshes(), scale=True)
    points = 2.0 * surface(prior, (1.0, -1.0))
    found = fit(noisy(points), prior=prior)
    assert rms(found, points) < 0.5 * NOISE
    assert found.volume().value == pytest.approx(8 * prior.model((1.0, -1.0)).volume(), rel=0.02)


def test_two_walls_are_fitted_together():
    prior = learn_prior([wall(mesh) for mesh in meshes()])
    member = prior.model((1.0, 0.0, 0.0))
    points = {name: noisy(member.mesh(name, 8).vertices) for name in ("epi", "endo")}
    found = fit(points, prior=prior)
    assert found.status == "ok" and list(found.residuals) == ["epi", "endo"]
    assert any("wall thickness" in note for note in found.notes)
    for name in points:
        assert np.sqrt((found.model.distance(member.mesh(name, 8).vertices, name) ** 2).mean()) < 0.5 * NOISE


def test_refine_begins_where_the_superquadric_lies(prior):
    rotations, shifts = poses(1)
    points = surface(prior) @ rotations[0].T + shifts[0]
    own = next(iter(prior.surfaces.values()))
    there = replace(own, rotation=rotations[0] @ own.rotation, translation=rotations[0] @ own.translation + shifts[0])
    found = refine(there, noisy(points), prior=prior)
    assert rms(found, points) < 0.25 * NOISE


def test_models_of_a_cohort_make_a_prior_that_fits_them():
    prior = learn_prior(models())
    points = models()[3].mesh(resolution=12).vertices
    found = fit(noisy(points), prior=prior, space="LPS", unit="mm")
    assert rms(found, points) < 0.3 * NOISE and found.model.unit == "mm"


@pytest.mark.parametrize(
    ("options", "named"),
    (
        ({"kind": "toroid"}, "kind"),
        ({"box": (3, 3, 3)}, "box"),
        ({"strength": 0.1}, "strength"),
        ({"regularity": "springs"}, "regularity"),
        ({"method": "paper"}, "method='paper'"),
        ({"viewpoint": (0, 0, 99.0)}, "viewpoint"),
        ({"prior": "x.prior.npz"}, "prior"),
    ),
)
def test_options_that_a_prior_takes_the_place_of_are_refused(prior, options, named):
    with pytest.raises(OptionError, match=named):
        fit(surface(prior), **({"prior": prior} | options))


def test_a_prior_of_other_surfaces_is_refused(prior):
    with pytest.raises(InputError, match=r"surface.*endo"):
        fit({"endo": surface(prior)}, prior=prior)


def test_a_prior_in_another_unit_is_refused(prior):
    with pytest.raises(InputError, match="unit"):
        fit(surface(prior), prior=replace(prior, unit="mm"), unit="m")
    with pytest.raises(InputError, match="RMS radius"):
        fit(surface(prior) / 1000, prior=prior)


def test_a_prior_in_another_frame_is_refused(prior):
    with pytest.raises(InputError, match="RAS"):
        fit(surface(prior), prior=replace(prior, space="LPS"), space="RAS")


def test_refine_with_a_prior_has_no_start(prior):
    with pytest.raises(OptionError, match="start"):
        refine(Superquadric(), surface(prior), prior=prior, start=prior.box)


def test_poses_upside_down_are_tried_too(prior):
    """The nearest pose of the mean shape may be wrong; only with the modes one is clearly nearer."""
    starts = closest_poses(prior, {"surface": surface(prior, (2.0, 0.0, 0.0))})
    turns = [next(iter(each.surfaces.values())).rotation for each in starts]
    along = [turn[:, 2] @ turns[0][:, 2] for turn in turns]
    assert max(along) > 0.9 and min(along) < -0.9
