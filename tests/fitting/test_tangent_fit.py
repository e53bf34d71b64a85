"""The refinement by tangent distance as a whole: how near it comes to the truth, and how well it knows it."""

import numpy as np
import pytest
from clouds_made import EGG, error, noisy_egg, with_outliers
from notes import note_of
from shapes_made import even_directions, gap, made

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.least_squares.regularisers import Bending
from quadriform.points import Frame

NOISY = noisy_egg()
FEW = NOISY[:500]
CLEAN = noisy_egg(400, noise=0.0)
BODIES = {
    "sphere": made(exponents=(1, 1), semi_axes=(5, 5, 5)),
    "ellipsoid": made(exponents=(1, 1)),
    "box": made(exponents=(0.3, 0.3)),
}


@pytest.fixture(scope="module")
def start():
    """The superquadric that all refinements of half of it begin with."""
    return qf.fit_superquadric(FEW).superquadric


@pytest.fixture(scope="module")
def fitted():
    """The noisy egg on its defaults."""
    return qf.fit(NOISY)


@pytest.fixture(scope="module")
def refined(start):
    """Half of it, from one start."""
    return qf.refine(start, FEW)


@pytest.mark.parametrize("body", BODIES)
def test_superquadrics_are_met_exactly(body):
    points = BODIES[body].surface(even_directions(300))
    fit = qf.fit(points)
    assert np.abs(fit.residuals).max() < 1e-6 * Frame.of(points).scale
    assert not fit.warnings and fit.model.min_jacobian() > 0.9


@pytest.mark.skip(reason="a foot point caught at a sharp edge makes an exact point an outlier: the last look is local")
def test_a_pinched_superquadric_has_no_outliers():
    points = made().surface(even_directions(500))
    fit = qf.fit(points)
    assert np.abs(fit.residuals).max() < 1e-4 * Frame.of(points).scale
    assert fit.inliers.min() > 0.5 and not note_of(fit, "OUTLIERS")


def test_the_true_surface_is_nearer_than_the_noise_and_nearer_than_by_the_paper(fitted):
    """Three thousand numbers to find 386: a quarter of the noise. The paper's springs are at their best strength."""
    paper = qf.fit(NOISY, method="paper", strength=1e-7)
    assert error(fitted.model) < 0.3
    assert error(fitted.model) < 0.9 * error(paper.model)
    assert fitted.status == "ok" and fitted.model.n_parameters == 386


def test_without_noise_the_paper_is_left_far_behind():
    ours = qf.refine(qf.fit_superquadric(CLEAN).superquadric, CLEAN)
    paper = qf.fit(CLEAN, method="paper", strength=1e-7)
    assert error(ours.model) < 0.25 * error(paper.model)
    assert ours.noise < 0.03


def test_the_noise_is_found(fitted):
    assert fitted.noise == pytest.approx(1.0, rel=0.05)
    assert fitted.rms < fitted.noise < fitted.superquadric_rms


def test_the_uncertainty_is_the_size_of_the_error(fitted):
    """Of the true surface between 85 and 99.9 % is within two sigma, and sigma is the size of the error."""
    sigma, off = fitted.uncertainty(EGG), np.abs(fitted.model.distance(EGG))
    assert 0.85 <= (off < 2 * sigma).mean() <= 0.999
    assert 0.6 < np.sqrt((off**2).mean() / (sigma**2).mean()) < 1.6


def test_the_uncertainty_is_the_spread_of_the_finer_posterior_about_the_fit(refined, rng):
    """Finer boxes drawn around the fit: their surfaces lie along the normal as far away as was said."""
    foot, enriched = refined.model.foot_points(EGG[::100]), refined.enriched
    spread = np.linalg.cholesky(enriched._solution.covariance()) * enriched.independent_sigma / enriched._solution.sigma
    draws = enriched.shift[:, None] + spread @ rng.normal(size=(len(enriched.shift), 2000))
    rows = refined.model.box.elevate(enriched.degrees).matrix(foot.origins)[:, :, None] * foot.normals[:, None, :]
    off = rows.reshape(len(rows), -1) @ draws
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=1)), refined.uncertainty(EGG[::100]), rtol=0.1)


def test_what_few_control_points_cannot_say_is_in_the_uncertainty():
    """Old bug: it knew only the noise, and without noise claimed that a box of 27 points is right to a hundredth."""
    fit = qf.fit(noisy_egg(900, noise=0.02), box=(3, 3, 3))
    sigma, off = fit.uncertainty(EGG), np.abs(fit.model.distance(EGG))
    assert off.mean() > 3 * 0.02
    assert (off < 2 * sigma).mean() > 0.9
    rows = fit.model.foot_points(EGG)
    rows = (fit.model.box.matrix(rows.origins)[:, :, None] * rows.normals[:, None, :]).reshape(len(EGG), -1)
    only_noise = np.sqrt(np.einsum("ni,ij,nj->n", rows, fit.covariance, rows, optimize=True))
    assert (off < 2 * only_noise).mean() < 0.7


def test_outliers_hardly_matter_and_are_named(fitted):
    fit = qf.fit(with_outliers(NOISY, 100))
    assert error(fit.model) < 1.2 * error(fitted.model)
    assert fit.noise == pytest.approx(1.0, rel=0.06)
    assert fit.inliers[:900].mean() > 0.98
    far = np.abs(fit.residuals) > 6
    assert far.sum() > 50 and fit.inliers[far].max() < 0.05
    assert f"{(fit.inliers < 0.5).sum()} of 1000 points" in note_of(fit, "OUTLIERS")


def test_without_robustness_all_points_are_inliers_and_matter(start):
    cloud = with_outliers(FEW, 50)
    plain, robust = (qf.refine(start, cloud, robust=robust, box=(4, 4, 4)) for robust in (False, True))
    np.testing.assert_array_equal(plain.inliers, 1)
    assert not note_of(plain, "OUTLIERS")
    assert error(plain.model) > 1.4 * error(robust.model)


class Recorded:
    """A user's own regulariser: bending times a factor; remembers what it was asked."""

    def __init__(self, factor=1.0):
        self.factor, self.asked = factor, set()

    def matrix(self, shape):
        self.asked.add(shape)
        return self.factor * Bending().matrix(shape)


def test_a_regulariser_of_ones_own_is_used(start, refined):
    own = Recorded()
    same = qf.refine(start, FEW, regularity=own)
    assert own.asked == {(3, 3, 3), (5, 5, 5), (7, 7, 7)}
    np.testing.assert_array_equal(same.model.box.control_points, refined.model.box.control_points)


def test_twice_the_penalty_at_half_the_strength_is_the_same(start):
    one = qf.refine(start, FEW, strength=1e-5, box=(4, 4, 4))
    other = qf.refine(start, FEW, strength=5e-6, box=(4, 4, 4), regularity=Recorded(2.0))
    assert gap(one.model, other.model) < 1e-9
    assert (one.strength, other.strength) == (1e-5, 5e-6)


def test_springs_are_another_regulariser(start, refined):
    springs = qf.refine(start, FEW, regularity="springs")
    assert gap(springs.model, refined.model) > 1e-4
    assert error(springs.model) < 0.5


def test_a_very_strong_box_only_moves_affinely(start, refined):
    """What bending does not feel: the displacement of the control points has no second differences."""
    fit = qf.refine(start, FEW, strength=1e6)
    displacement = fit.model.box.control_points - fit.model.box.rest
    for axis in range(3):
        assert np.abs(np.diff(displacement, 2, axis=axis)).max() < 1e-4
    assert np.abs(displacement).max() > 0.1
    assert fit.rms > 1.3 * refined.rms


def test_the_strength_of_the_evidence_is_near_the_best_one(start, refined):
    """Thirty times weaker or stronger is farther from the truth."""
    weaker, stronger = (qf.refine(start, FEW, strength=k * refined.strength) for k in (1 / 30, 30))
    assert error(refined.model) < min(error(weaker.model), error(stronger.model))


def test_strengths_do_what_the_page_on_options_states(fitted):
    """docs/choose.md, which rounds the strength to one digit."""
    assert f"{fitted.strength:.0e}" == "7e-06"
    weak, detail_lost, affine = (qf.refine(fitted.model.surfaces, NOISY, strength=k) for k in (1e-9, 1e-3, 1.0))
    assert weak.rms < 0.95 * fitted.rms and error(weak.model) > 1.5 * error(fitted.model)
    assert error(detail_lost.model) > 3 * error(fitted.model)
    control, undeformed = affine.model.box.control_points.reshape(-1, 3), affine.model.box.rest.reshape(-1, 3)
    ones = np.column_stack([undeformed, np.ones(len(undeformed))])
    left = control - ones @ np.linalg.lstsq(ones, control)[0]
    assert np.abs(left).max() < 0.02 * Frame.of(NOISY).scale


def test_every_round_is_reported_and_recorded(start):
    told = []
    fit = qf.refine(start, FEW[:300], progress=lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == list(range(1, fit.iterations + 1))
    assert all(0 <= done <= total for done, total in told)
    last = fit.history[-1]
    box = fit.model.box
    expected = np.sqrt(((box.control_points - box.rest) ** 2).sum(axis=-1).mean())
    assert last.box_displacement == pytest.approx(expected, rel=1e-6)
    assert last.error == pytest.approx(fit.noise, rel=1e-9)


def test_the_papers_method_estimates_no_uncertainty():
    fit = qf.fit(CLEAN, method="paper", iterations=1)
    assert fit.covariance is None
    with pytest.raises(OptionError, match=r"uncertainty.*method='tangent'"):
        fit.uncertainty(CLEAN)
