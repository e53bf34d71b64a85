"""The posterior of a single fit: its deviations against `uncertainty`, and against fits of a body with other noise."""

from dataclasses import replace

import numpy as np
import pytest

import quadriform as qf
from quadriform.fitting.elements import Elements
from quadriform.fitting.fit import refine
from quadriform.heart.deviations import aligned_samples
from quadriform.shapes.posterior import STEP
from quadriform.shapes.superquadric import Superquadric

BODY = Superquadric("ellipsoid", (30, 30, 40), (1, 1), np.eye(3), (0, 0, 0))
DRAWS = 8


def points(seed, size=1.0, noise=0.5, count=400, below=1.0):
    """Points of an ellipsoid with a bulge, with noise, of its part below a fraction of its height."""
    rng = np.random.default_rng([7, seed])
    directions = rng.normal(size=(3 * count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[directions[:, 2] < below][:count]
    bulge = 1 + 0.1 * directions[:, :1] * directions[:, 2:]
    return size * bulge * directions * BODY.semi_axes + rng.normal(0, noise, (count, 3))


def fitted(seed, size=1.0):
    start = replace(BODY, semi_axes=size * BODY.semi_axes)
    return refine(start, points(seed, size), box=(3, 3, 3))


@pytest.fixture(scope="module")
def repeated():
    """Fits of a body in two sizes to independent points."""
    return [(fitted(2 * k), fitted(2 * k + 1, 0.8)) for k in range(DRAWS)]


def root_mean_square(values):
    return np.sqrt(np.mean(np.square(values)))


def normal_deviations(fit):
    """Standard deviations of the samples along the normals, and those of `uncertainty`, at points of the surface."""
    elements, samples = Elements.of(fit.model, "surface", None), fit.posterior
    box = fit.model.box.elevate(fit.enriched.degrees)
    rows = (box.matrix(elements.origins)[:, :, None] * elements.normals[:, None, :]).reshape(len(elements.origins), -1)
    found = samples.deviations.reshape(len(samples), -1) @ rows.T
    return np.sqrt((found**2).mean(axis=0)), fit.uncertainty(elements.points), elements.points


def test_samples_have_the_deviations_of_the_uncertainty(repeated):
    found, expected, _ = normal_deviations(repeated[0][0])
    assert root_mean_square(found) == pytest.approx(root_mean_square(expected), rel=0.1)
    assert ((found / expected > 0.5) & (found / expected < 1.7)).all()


def test_the_stated_deviation_of_a_volume_is_that_over_other_noise(repeated):
    for measured in (qf.Fit.volume, qf.Fit.area):
        every = [measured(fit) for fit, _ in repeated]
        scatter = np.std([each.value for each in every], ddof=1)
        stated = root_mean_square([each.sd for each in every])
        assert 0.6 < stated / scatter < 1.7  # of so few draws the scatter is known to a quarter


def test_the_stated_deviation_of_an_ejection_fraction_is_that_over_other_noise(repeated):
    def fraction(models):
        full, empty = (model.mesh(None, 12).volume() for model in models)
        return 100 * (1 - empty / full)

    values, stated = [], []
    for pair in repeated:
        models = [replace(fit.model, posterior=fit.posterior) for fit in pair]
        values.append(fraction(models))
        stated.append(np.std([fraction(sample) for sample in aligned_samples(models)], ddof=1) / STEP)
    assert 0.6 < root_mean_square(stated) / np.std(values, ddof=1) < 1.7
    assert np.mean(values) == pytest.approx(100 * (1 - 0.8**3), abs=np.std(values, ddof=1))


def test_the_deviation_does_not_depend_on_the_coordinates_of_the_model(repeated):
    fit = replace(repeated[0][0], model=replace(repeated[0][0].model, space="LPS"))
    other = replace(fit, model=fit.model.in_space("RAS"))
    assert other.volume().sd == pytest.approx(fit.volume().sd, rel=1e-4)
    at = points(1)[:20]
    np.testing.assert_allclose(other.uncertainty(at * [-1, -1, 1]), fit.uncertainty(at), rtol=1e-6)


def test_the_part_without_data_is_known_less_as_one_whole():
    half = qf.fit(points(3, below=0.3), box=(3, 3, 3))
    found, expected, at = normal_deviations(half)
    is_open = at[:, 2] > 0.3 * 40 + 8
    assert root_mean_square(found[is_open]) == pytest.approx(root_mean_square(expected[is_open]), rel=0.3)
    alone = replace(half, extrapolations={})
    assert half.volume().sd > 1.2 * alone.volume().sd


def test_the_model_with_estimates_has_the_posterior(repeated):
    fit = repeated[0][0]
    assert fit.model.posterior is None
    model = fit.with_estimates().model
    np.testing.assert_array_equal(model.posterior.deviations, fit.posterior.deviations)
    assert model.record.estimates["volume"].sd == fit.volume().sd
    assert fit.posterior.source != repeated[1][0].posterior.source
    paper = qf.fit(points(1), method="paper", iterations=1)
    assert paper.posterior is None and paper.volume().sd is None
