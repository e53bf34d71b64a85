"""Priors of populations whose mean, variances and modes are known, and what no prior can be learned from."""

from dataclasses import replace

import numpy as np
import pytest
from priors_made import AXES, SIGMAS, VARIANCES, bent, elsewhere, meshes, models, poses, semi_axes, wall
from scipy.spatial.distance import pdist

import quadriform as qf
from quadriform.errors import DegenerateError, InputError, OptionError, PointsError
from quadriform.priors.alignment import CELLS, aligned_rigidly
from quadriform.priors.corresponding_meshes import procrustes
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric

BOX = (3, 3, 3)


def learned(shapes, **options):
    return qf.learn_prior(shapes, **{"box": BOX} | options)


def test_ellipsoids_of_varying_axes_have_three_modes_of_known_variances():
    prior = learned(meshes())
    np.testing.assert_allclose(prior.variances, np.sort(VARIANCES)[::-1], rtol=1e-6)
    assert prior.n_models == 8 and prior.report.residual < 1e-6


def test_the_mean_of_ellipsoids_has_their_mean_axes():
    mean = learned(meshes()).mean_model()
    exact = Superquadric("ellipsoid", AXES).mesh(12).vertices
    assert np.abs(mean.distance(exact)).max() < 1e-6


def test_the_number_of_modes_for_a_fraction_of_the_variance():
    explained = np.cumsum(np.sort(VARIANCES)[::-1]) / VARIANCES.sum()
    report = learned(meshes()).report
    expected = [int((explained < fraction).sum()) + 1 for fraction in (0.90, 0.95, 0.99)]
    assert [report.modes_90, report.modes_95, report.modes_99] == expected and expected[0] < expected[2]


def test_a_score_of_one_is_one_standard_deviation_of_an_axis():
    prior = learned(meshes())
    longest = prior.model([1.0]).mesh(resolution=8).vertices[:, 2].max()
    grown = np.sqrt(8 / 7) * SIGMAS[2]
    assert min(abs(longest - AXES[2] - grown), abs(longest - AXES[2] + grown)) < 0.1


def test_models_give_the_prior_of_meshes():
    prior = learned(models())
    sphere = Superquadric("ellipsoid", (1, 1, 1)).grid(CELLS)[0]
    expected = 8 / 7 * SIGMAS**2 * (sphere**2).mean(axis=0)
    np.testing.assert_allclose(prior.variances, np.sort(expected)[::-1], rtol=1e-3)
    assert (prior.space, prior.unit) == ("LPS", "mm")
    assert prior.mean_model().superquadric().semi_axes == pytest.approx(AXES, rel=1e-6)


def test_members_may_lie_anywhere():
    shapes = bent()
    moved = [elsewhere(*each) for each in zip(shapes, *poses(len(shapes)))]
    here, there = learned(shapes), learned(moved)
    np.testing.assert_allclose(there.variances, here.variances, rtol=1e-6)
    assert there.report.leave_one_out == pytest.approx(here.report.leave_one_out, rel=1e-6)
    assert there.mean_model().volume() == pytest.approx(here.mean_model().volume(), rel=1e-6)


def test_no_rotation_brings_aligned_shapes_nearer_to_their_mean():
    moved = np.array([elsewhere(*each).vertices for each in zip(bent(), *poses(8))])
    points = procrustes(moved)
    mean = points.mean(axis=0)
    for given, shape in zip(moved, points):
        np.testing.assert_allclose(shape, aligned_rigidly(shape, mean), atol=1e-9)
        np.testing.assert_allclose(pdist(shape[::20]), pdist(given[::20]), rtol=1e-12)


def test_two_surfaces_share_one_box():
    prior = learned([wall(mesh) for mesh in meshes()])
    assert list(prior.surfaces) == ["endo", "epi"]
    exact = Superquadric("ellipsoid", AXES).mesh(12).vertices
    mean = prior.mean_model()
    assert np.abs(mean.distance(exact, "endo")).max() < 1e-6
    assert np.abs(mean.distance(1.2 * exact, "epi")).max() < 1e-6
    expected = np.sort(VARIANCES)[::-1] * (1 + 1.2**2) / 2
    np.testing.assert_allclose(prior.variances, expected, rtol=1e-6)


def test_open_walls_have_maps_that_do_not_fold():
    half = Superquadric("ellipsoid", (1, 1, 1)).mesh(12)
    kept = (half.vertices[half.faces][:, :, 2] < 0.4).all(axis=1)
    used, faces = np.unique(half.faces[kept], return_inverse=True)
    shapes = [wall(Mesh(each * half.vertices[used], faces.reshape(-1, 3))) for each in semi_axes()]
    prior = qf.learn_prior(shapes)
    assert not len(prior.mean_model().folds())
    assert prior.report.residual < 0.01 * AXES.min()


def test_without_size_a_population_of_sizes_is_one_shape():
    shapes = [mesh for size in (0.8, 1.0, 1.3) for mesh in meshes(size)[:1]]
    assert len(learned(shapes).variances) == 1
    with pytest.raises(DegenerateError, match="all 3 shapes are the same"):
        learned(shapes, scale=True)
    with pytest.raises(DegenerateError, match="all 3 shapes are the same"):
        learned([models()[0].transformed(size, np.zeros(3)) for size in (0.8, 1.0, 1.3)], scale=True)


def test_sizes_are_the_mean_size_without_size():
    """Half of the members smaller and half larger, with the same mean size."""
    mixed = learned([*bent(0.8), *bent(1.2)], scale=True)
    alike = learned([*bent(), *bent()], scale=True)
    np.testing.assert_allclose(mixed.variances, alike.variances, rtol=1e-3)
    assert mixed.mean_model().volume() == pytest.approx(alike.mean_model().volume(), rel=1e-4)


def test_freedom_displaces_the_surface_by_the_leave_one_out_error():
    prior = learned(bent(), modes=2)
    alone = replace(prior, variances=prior.variances * 1e-30)  # the covariance is D
    covariance = np.linalg.inv(alone.precision())
    mean_square = np.trace(np.kron(prior.metric, np.eye(3)) @ covariance)
    assert np.sqrt(mean_square) == pytest.approx(prior.report.leave_one_out, rel=1e-6)


def test_the_same_shapes_give_the_same_bytes():
    one, other = learned(meshes()), learned(meshes())
    assert one.modes.tobytes() == other.modes.tobytes() and one.report == other.report


def other_faces():
    shapes = meshes()
    return [*shapes[:2], replace(shapes[2], faces=np.roll(shapes[2].faces, 1, axis=0))]


def flat(mesh):
    return Mesh(mesh.vertices * [1, 1, 0], mesh.faces)


def not_finite():
    shapes = meshes()
    vertices = shapes[1].vertices.copy()
    vertices[5] = np.nan
    return [shapes[0], replace(shapes[1], vertices=vertices), shapes[2]]


@pytest.mark.parametrize(
    ("shapes", "options", "error", "text"),
    [
        (lambda: meshes()[:2], {}, InputError, "three or more to learn a prior from, found 2"),
        (lambda: models()[0], {}, InputError, "found one DeformableModel"),
        (lambda: [*models()[:2], *meshes()[:1]], {}, InputError, "all to be meshes, found DeformableModel at index 0"),
        (lambda: [np.zeros((9, 3))] * 3, {}, InputError, "found ndarray at index 0"),
        (lambda: [wall(m) for m in meshes()[:2]] + meshes()[:1], {}, InputError, "mesh 2: expected the surfaces endo"),
        (lambda: [*meshes()[:2], SMALL], {}, InputError, "mesh 2, surface: expected 386 vertices.*found 98"),
        (lambda: [{"endo": np.zeros((9, 3))}] * 3, {}, InputError, "mesh 0, endo: expected a Mesh, found ndarray"),
        (lambda: [{}] * 3, {}, InputError, "mesh 0: expected one or more surfaces"),
        (lambda: [flat(mesh) for mesh in meshes()], {}, DegenerateError, "coplanar"),
        (other_faces, {}, InputError, "mesh 2, surface: its triangles"),
        (not_finite, {}, PointsError, "mesh 1, surface: 1 of 386 rows are not finite"),
        (lambda: meshes()[:1] * 3, {}, DegenerateError, "all 3 shapes are the same"),
        (lambda: models()[:1] * 3, {}, DegenerateError, "all 3 shapes are the same"),
        (lambda: [*models()[:2], *models(space="RAS")[2:]], {}, InputError, "expected one space, found LPS, RAS"),
        (lambda: [*models()[:2], *models(unit="m")[2:]], {}, InputError, "expected one unit, found mm, m"),
        (models, {"unit": "m"}, OptionError, "unit='m': the models are in mm"),
        (meshes, {"unit": "feet"}, OptionError, "unit='feet'"),
        (meshes, {"modes": 4}, OptionError, "modes=4: expected 1 to 3"),
        (meshes, {"box": (20, 20, 20)}, OptionError, "box=.*at most 1000 control points"),
        (meshes, {"box": (1, 2, 3)}, OptionError, "box="),
        (meshes, {"mode": 4}, OptionError, "did you mean modes"),
    ],
)
def test_what_no_prior_can_be_learned_from_is_refused(shapes, options, error, text):
    with pytest.raises(error, match=text):
        learned(shapes(), **options)


SMALL = Superquadric("ellipsoid", (1, 1, 1)).mesh(4)


def test_models_of_other_surfaces_are_refused():
    shapes = models()
    shapes[2] = replace(shapes[2], surfaces={"epi": shapes[2].superquadric()})
    with pytest.raises(InputError, match="model 2: expected the surfaces surface"):
        learned(shapes)


def test_hearts_of_an_atlas(shared):
    """Ten modes are what the atlas was made of; a hundred of its hearts have all of them."""
    atlas = np.load(shared / "data" / "mesa_lv_atlas" / "atlas_first_1000.npz")
    hearts = atlas["ed_mean"] + np.tensordot(atlas["ed_scores"][:100], atlas["ed_modes"], 1).astype(float)
    endo, epi = atlas["endo_faces"], atlas["epi_faces"]
    count = int(epi.min())
    shapes = [{"endo": Mesh(one[:count], endo), "epi": Mesh(one[count:], epi - count)} for one in hearts]
    prior = qf.learn_prior(shapes, unit="mm")
    assert len(prior.variances) == 10 and prior.report.leave_one_out < 0.01
    assert prior.report.residual < 0.5
    assert not len(prior.mean_model().folds())
