"""Statistics of shape on shapes whose mean and modes are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cohort_made import needs
from scipy.linalg import subspace_angles
from scipy.spatial.transform import Rotation

from quadriform.errors import InputError, OptionError
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

pytestmark = needs("sklearn")
HEART = SyntheticVentricle()
SURFACE = replace(HEART.surface("endo"), semi_axes=np.array([28.0, 22.0, 44.0]))
BOX = ControlBox.around(SURFACE)
BASE = BOX.with_control_points(HEART.positions(BOX.rest.reshape(-1, 3), 0.2))
SIGMAS = (6.0, 5.0, 4.0, 3.0)


@pytest.fixture(scope="module")
def statistics():
    """The module under test, imported when it is needed: scikit-learn takes a second."""
    from quadriform.cohort import statistics

    return statistics


def fields():
    """Four displacements of the control points, smooth and different: wider, longer, bent, conical; (4, 5, 5, 5, 3)."""
    s, t, u = (2 * BOX.local(BOX.rest.reshape(-1, 3)) - 1).T
    zero = np.zeros_like(s)
    axes = BOX.edges / np.linalg.norm(BOX.edges, axis=1, keepdims=True)
    found = [[s, zero, zero], [zero, zero, u**3], [u**2, zero, zero], [s * u, t * u, zero]]
    return np.array([np.stack(one, axis=1) @ axes for one in found]).reshape(4, 5, 5, 5, 3)


def model(amounts, surface=SURFACE):
    moved = np.tensordot(np.multiply(amounts, SIGMAS), fields(), 1)
    return DeformableModel({"endo": surface}, BASE.with_control_points(BASE.control_points + moved), "LPS", "mm")


def draws(count=40, seed=8):
    return np.random.default_rng(seed).normal(size=(count, 4))


def elsewhere(shape, turn, shift):
    surfaces = {name: one.rotated(turn).transformed(1, shift) for name, one in shape.surfaces.items()}
    return DeformableModel(surfaces, shape.box.rotated(turn).transformed(1, shift), shape.space, shape.unit)


def as_they_lie(shapes):
    return shapes


def moved_a_little(shapes):
    rng = np.random.default_rng(3)
    turns = Rotation.from_rotvec(0.1 * rng.normal(size=(len(shapes), 3))).as_matrix()
    return [elsewhere(one, turn, 20 * rng.normal(size=3)) for one, turn in zip(shapes, turns)]


def moved_anyhow(shapes):
    rng = np.random.default_rng(4)
    turns = Rotation.random(len(shapes), random_state=4).as_matrix()
    return [elsewhere(one, turn, 200 * rng.normal(size=3)) for one, turn in zip(shapes, turns)]


@pytest.mark.parametrize("place", [as_they_lie, moved_a_little, moved_anyhow])
def test_known_modes_are_found(statistics, place):
    found = statistics.shape_modes(place([model(amounts) for amounts in draws()]))
    steps = [found.shapes.transform([model(h * row) for h in (0.5, -0.5)]) for row in np.eye(4)]
    truth = np.array([one - other for one, other in steps])
    angles = np.degrees(subspace_angles(truth.T, found.components[:4].T))
    assert angles.max() < 5
    assert found.variance_ratios[:4].sum() > 0.999  # all the variance lies in as many modes as were drawn
    assert found.modes_for(0.95) <= 4
    assert found.variance_ratios[3] > 100 * found.variance_ratios[4]


def test_rows_are_as_far_apart_as_surfaces(statistics):
    """A shape blown up about its centre: each point moves by what its distance from there is stretched by."""
    small = model(np.zeros(4))
    large = small.transformed(1.1, np.zeros(3))
    shapes = statistics.CorrespondingShapes().fit([small])
    one, other = shapes.transform([small, large])
    vertices = small.mesh(resolution=8).vertices
    expected = np.sqrt(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1).mean()) * 0.1
    assert np.linalg.norm(one - other) == pytest.approx(expected, rel=0.01)


def test_rows_become_models_again(statistics):
    shapes = [model(amounts) for amounts in draws(6)]
    correspond = statistics.CorrespondingShapes().fit(shapes)
    rows = correspond.transform(shapes)
    assert rows.shape == (6, 375) and len(correspond.get_feature_names_out()) == 375
    again = correspond.inverse_transform(rows)
    assert (again[0].space, again[0].unit) == ("LPS", "mm")
    for shape, back in zip(shapes, again):
        assert back.volume() == pytest.approx(shape.volume(), rel=1e-4)
    assert np.abs(correspond.transform(again) - rows).max() < 1e-3  # they lie where the transformer puts them


def test_position_and_orientation_change_nothing(statistics):
    shapes = [model(amounts) for amounts in draws(8)]
    correspond = statistics.CorrespondingShapes().fit(shapes)
    rows = correspond.transform(shapes)
    shifted = [elsewhere(shape, np.eye(3), np.array([100.0, -50.0, 7.0])) for shape in shapes]
    assert np.abs(correspond.transform(shifted) - rows).max() < 1e-6
    tilt = Rotation.from_rotvec([0.2, -0.1, 0.15]).as_matrix()
    assert np.abs(correspond.transform([elsewhere(s, tilt, np.zeros(3)) for s in shapes]) - rows).max() < 0.1


def test_scores_and_reconstruction_from_k_modes(statistics):
    amounts = draws()
    shapes = [model(row) for row in amounts]
    found = statistics.shape_modes(shapes, modes=4)
    scores = found.scores(shapes)
    assert np.abs(scores.mean(axis=0)).max() < 1e-9 and np.allclose(scores.std(axis=0, ddof=1), 1)
    rows = found.shapes.transform(shapes)
    errors = []
    for k in range(5):
        back = found.shapes.transform(found.reconstruct(scores[:, :k]))
        errors.append(np.sqrt(((back - rows) ** 2).sum(axis=1).mean()))
    assert all(later < earlier for earlier, later in pairwise(errors))
    assert errors[4] < 0.02 * errors[0]


def mirrored(shape):
    """The mirror image at x = 0 of a model whose box is symmetric to it."""
    control = shape.box.control_points[::-1] * [-1, 1, 1]
    return replace(shape, box=shape.box.with_control_points(control))


def test_the_mean_of_a_shape_and_its_mirror_image_is_symmetric(statistics):
    surface = Superquadric("ellipsoid", (30, 22, 45))
    box = ControlBox.around(surface)
    moved = box.control_points + 3 * np.random.default_rng(5).normal(size=box.control_points.shape)
    shape = DeformableModel({"surface": surface}, box.with_control_points(moved))
    image = mirrored(shape)
    vertices = shape.mesh(resolution=8).vertices * [-1, 1, 1]
    assert np.abs(image.distance(vertices)).max() < 1e-9
    assert np.abs(shape.distance(vertices)).max() > 2  # the shape itself is not symmetric
    mean = statistics.shape_modes([shape, image]).mean
    assert np.abs(mean.distance(mean.mesh(resolution=8).vertices * [-1, 1, 1])).max() < 1e-8


def test_two_walls_have_one_box(statistics):
    walls = [HEART.model(t) for t in np.linspace(0, 0.5, 6)]
    found = statistics.shape_modes(walls)
    assert set(found.mean.surfaces) == {"endo", "epi"}
    assert found.variance_ratios[0] > 0.95  # one motion
    volumes = [[one.volume(name) for name in ("endo", "epi")] for one in found.reconstruct(found.scores(walls))]
    assert np.allclose(volumes, [[one.volume(name) for name in ("endo", "epi")] for one in walls], rtol=2e-3)


def test_modes_are_those_of_scikit_learn(statistics):
    from sklearn.decomposition import PCA

    shapes = [model(amounts) for amounts in draws(6)]
    found = statistics.shape_modes(shapes, modes=4)
    rows = found.shapes.transform(shapes)
    other = PCA(4, svd_solver="full").fit(rows)
    np.testing.assert_allclose(found.components, other.components_, atol=1e-12)
    np.testing.assert_allclose(found.deviations**2, other.explained_variance_)
    np.testing.assert_allclose(found.variance_ratios, other.explained_variance_ratio_)
    np.testing.assert_allclose(found.scores(shapes) * found.deviations, other.transform(rows), atol=1e-9)


def test_it_is_the_first_step_of_a_pipeline_and_accepts_clouds(statistics):
    from sklearn.decomposition import PCA
    from sklearn.pipeline import make_pipeline

    clouds = [model(amounts).mesh(resolution=4).vertices for amounts in draws(2)]
    line = make_pipeline(statistics.CorrespondingShapes(box=(3, 3, 3)), PCA(1)).set_params(
        correspondingshapes__passes=1
    )
    assert line.fit_transform(clouds).shape == (2, 1)
    assert line.named_steps["pca"].n_components_ == 1


def test_what_cannot_be_compared_is_refused(statistics):
    one = model(np.zeros(4))
    with pytest.raises(InputError, match="two or more"):
        statistics.shape_modes([one])
    with pytest.raises(InputError, match="model 1: expected the surfaces endo"):
        statistics.shape_modes([one, replace(one, surfaces={"epi": SURFACE})])
    toroid = Superquadric("toroid", hole_radius=2.0)
    with pytest.raises(InputError, match="'ellipsoid'"):
        statistics.CorrespondingShapes().fit([replace(one, surfaces={"endo": toroid})])
    with pytest.raises(OptionError, match="modes=9"):
        statistics.shape_modes([one, model(np.ones(4))], modes=9)
    with pytest.raises(OptionError, match="fraction"):
        statistics.shape_modes([one, model(np.ones(4))]).modes_for(1.5)
