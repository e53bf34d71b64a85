"""What is known of the noise, and how many points are independent, in a cycle."""

import numpy as np
import pytest
from remembered import remember
from shapes_made import even_directions, gap, lumpy

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.fitting.least_squares.normal_equations import normal_equations
from quadriform.fitting.least_squares.regularisers import regulariser_matrix
from quadriform.fitting.superquadric import fit as superquadrics
from quadriform.motion.cycle_equations import LinearCycleProblem
from quadriform.motion.energies import SmoothEnergy
from quadriform.point_sets import PointSet
from quadriform.shapes import comparison
from quadriform.shapes.bernstein import basis, gram, kronecker
from quadriform.shapes.splines import TimeBasis


@pytest.fixture(scope="module", autouse=True)
def remembered_starts():
    """The superquadric that a motion begins with is not what is tested here."""
    with pytest.MonkeyPatch.context() as patch:
        remember(patch, superquadrics, "solve")
        yield


SHRINKS = np.array([1.0, 0.9, 0.95])
TRUTH = [lumpy(100, seed=t) * shrinks for t, shrinks in enumerate(SHRINKS)]
SIGMA = np.where(np.arange(100) % 2, 0.2, 4.0)
"""In the unit of points on a body whose radius is about 30: every other point is bad."""
RNG = np.random.default_rng(5)
NOISY = [cloud + SIGMA[:, None] * RNG.normal(size=cloud.shape) for cloud in TRUTH]


def tracked(frames, **options):
    return qf.track(frames, **{"box": (3, 3, 3), "robust": False} | options)


def off(found):
    return np.sqrt(np.mean([(model.distance(cloud) ** 2).mean() for model, cloud in zip(found.models, TRUTH)]))


@pytest.fixture(scope="module")
def known():
    return tracked(NOISY, noise=[SIGMA] * 3)


def test_points_that_are_known_to_be_bad_count_less(known):
    assert off(known) < 0.5 * off(tracked(NOISY))


def test_all_forms_of_the_same_noise_give_the_same(known):
    covariances = SIGMA[:, None, None] ** 2 * np.eye(3)
    forms = [
        tracked(NOISY, noise=[covariances] * 3),
        tracked([{"a": cloud} for cloud in NOISY], noise=[{"a": SIGMA}] * 3),
        tracked([PointSet(cloud, noise=covariances) for cloud in NOISY]),
    ]
    for found in forms:
        assert max(gap(one, other) for one, other in zip(found.models, known.models)) < 1e-9


def test_the_noise_is_at_least_as_large_as_is_known():
    """Of exact points: they would have less."""
    assert tracked(TRUTH).noise < 1 < tracked(TRUTH, noise=2.0).noise == pytest.approx(2.0, rel=0.05)


def test_noise_of_some_frames_only_says_nothing_of_the_others():
    covariances = SIGMA[:, None, None] ** 2 * np.eye(3)
    some = [PointSet(NOISY[0], noise=covariances), NOISY[1], NOISY[2]]
    found, none = tracked(some), tracked(NOISY)
    assert max(gap(*pair) for pair in zip(found.models, none.models)) < 1e-9
    (note,) = set(found.notes) - set(none.notes)
    assert "1 of 3 clouds is known but not used" in note and "frame 1: surface" in note


@pytest.mark.parametrize(
    "noise, error, message",
    [
        ([1.0, 1.0], OptionError, "noise: expected a number or one entry for each of 3 frames, found 2"),
        ([1.0, -1.0, 1.0], PointsError, "frame 1: noise"),
        ([1.0, np.ones(7), 1.0], PointsError, "frame 1: noise"),
    ],
)
def test_wrong_noise_is_named(noise, error, message):
    with pytest.raises(error, match=message):
        tracked(NOISY, noise=noise)


def rings(points_of_each):
    """Contours of a beating, twisted body in twelve planes, each drawn with a smooth error; frames of (n, 3)."""
    rng, frames, angles = np.random.default_rng(8), [], np.arange(points_of_each) * 2 * np.pi / points_of_each
    for shrinks in SHRINKS:
        frame = []
        for height in np.linspace(-0.9, 0.9, 12):
            waves = rng.normal(0, 0.3, (5, 2))
            error = sum(a * np.cos(k * angles) + b * np.sin(k * angles) for k, (a, b) in enumerate(waves, 1))
            lobes = 1 + 0.15 * height * np.cos(2 * angles)
            radius = 20 * shrinks * np.sqrt(1 - height**2) * lobes + error
            frame.append(np.column_stack([radius * np.cos(angles), radius * np.sin(angles), 0 * angles + 30 * height]))
        frames.append(np.concatenate(frame))
    return frames


def test_ten_times_more_points_along_the_same_contours_change_little(monkeypatch):
    """Counted as independent, or held across contours, they would move the surface by a tenth of the noise or more."""
    monkeypatch.setattr(comparison, "SAMPLES", 2000)
    few, many = (qf.track(rings(count), box=(4, 4, 4)) for count in (16, 160))
    assert few.noise == pytest.approx(many.noise, rel=0.1)
    for one, other in zip(few.models, many.models):
        assert max(way.rms for way in qf.surface_distances(one, other)) < 0.05 * few.noise


UP = np.array([0.0, 0.0, 1.0])


def open_tube(height, radius, sigma, seed):
    """Points with noise of a tube with a round apex, open at z = height."""
    random = np.random.default_rng(seed)
    z, around = random.uniform(-1, height / radius, 300), random.uniform(0, 2 * np.pi, 300)
    wide = np.sqrt(1 - np.minimum(z, 0) ** 2)
    points = radius * np.column_stack([wide * np.cos(around), wide * np.sin(around), z])
    return points + sigma * random.normal(size=points.shape)


@pytest.mark.parametrize("strategy", ["cycle", "previous", "alone"])
def test_open_tubes_close_near_the_base_of_each_frame(strategy):
    """Without the prior beyond the base, a cycle reaches half its length farther."""
    heights, radii = (20.0, 14.0, 17.0), (30.0, 22.0, 26.0)
    frames = [open_tube(*shape, 0.5, seed) for seed, shape in enumerate(zip(heights, radii))]
    bases = [(height * UP, UP) for height in heights]
    found = qf.track(frames, base=bases, strategy=strategy, box=(4, 4, 4))
    for model, height, radius in zip(found.models, heights, radii):
        vertices = model.mesh(resolution=16).vertices
        assert vertices[:, 2].max() - height < 0.5 * radius
        wall = vertices[(vertices[:, 2] < height - 3) & (np.hypot(*vertices[:, :2].T) > radius / 2)]
        along = np.column_stack([wall[:, :2], np.minimum(wall[:, 2], 0)])
        assert np.sqrt(np.mean((np.linalg.norm(along, axis=1) - radius) ** 2)) < 1.0


@pytest.mark.parametrize(
    "base, message",
    [([None], "each of 3 frames, found 1"), ([None, None, (0 * UP, 0 * UP)], "frame 2: .*the direction of the plane")],
)
def test_a_base_that_is_none_is_named(base, message):
    frames = [open_tube(10, 20, 0.5, seed) for seed in range(3)]
    with pytest.raises(qf.errors.OptionError, match=message):
        qf.track(frames, base=base)


DEGREES, TIMES = (2, 2, 2), np.array([0.0, 0.3, 0.5, 0.8, 1.0])
BASIS = TimeBasis(np.array([0.0, 0.35, 0.7, 1.0]))
PENALTY = regulariser_matrix("bending", (3, 3, 3))


def observed(count):
    """Local coordinates and targets (5, count, 3) of five frames, and the linear problem that they pose."""
    random = np.random.default_rng(6)
    local, targets = random.uniform(0, 1, (5, count, 3)), random.normal(size=(5, count, 3))
    metric = np.broadcast_to(np.eye(3), (count, 3, 3))
    equations = [normal_equations(x, metric, y, DEGREES) for x, y in zip(local, targets)]
    problem = LinearCycleProblem(
        equations, BASIS.values(TIMES), BASIS, SmoothEnergy.of(PENALTY, (3, 3, 3)), total_weight=15.0 * count
    )
    return local, targets, problem


def test_under_strong_penalties_the_noise_is_that_of_an_affine_motion():
    """What penalties leave free is affine in space and linear in time: 24 parameters, by ordinary least squares."""
    local, targets, problem = observed(40)
    affine = np.concatenate([np.column_stack([x, np.ones(40)]) for x in local])
    design = np.column_stack([affine, np.repeat(TIMES, 40)[:, None] * affine])
    squares = np.linalg.lstsq(design, targets.reshape(200, 3), rcond=None)[1].sum()
    assert problem.solve(1e6, 1e6).sigma == pytest.approx(np.sqrt(squares / (600 - 24)), rel=1e-6)


def test_the_criterion_is_the_restricted_likelihood_of_the_dense_problem():
    """Of one coordinate at a time, from the matrices with a row for each point; up to a constant."""
    local, targets, problem = observed(40)
    rows = [np.kron(values, basis_matrix(x)) for values, x in zip(BASIS.values(TIMES), local)]
    design, y = np.concatenate(rows), targets.reshape(200, 3)
    mass = kronecker(gram(2), gram(2), gram(2))

    def dense(alpha, gamma):
        penalty = 600 * (alpha * np.kron(BASIS.mass(), PENALTY) + gamma * np.kron(BASIS.bending(), mass))
        matrix = design.T @ design + penalty
        fitted = np.linalg.solve(matrix, design.T @ y)
        variance = ((y**2).sum() - (y * (design @ fitted)).sum()) / (600 - 24)
        ranked = np.linalg.eigvalsh(penalty)[8:]
        determinants = np.linalg.slogdet(matrix)[1] - np.log(ranked).sum()
        return (600 - 24) * (np.log(variance) + 1) + 3 * determinants, np.sqrt(variance)

    pairs = [(1e-3, 1e-3), (1e-1, 1e-3), (1e-3, 1e-1), (1.0, 10.0)]
    found = [problem.solve(*pair) for pair in pairs]
    expected = [dense(*pair) for pair in pairs]
    np.testing.assert_allclose([one.sigma for one in found], [noise for _, noise in expected], rtol=1e-8)
    differences = np.array([one.criterion for one in found]) - [criterion for criterion, _ in expected]
    np.testing.assert_allclose(differences, differences[0], atol=1e-5)


def basis_matrix(local):
    """The Bernstein polynomials of degree 2 (n, 27) at local coordinates (n, 3)."""
    s, t, u = (basis(local[:, axis], 2) for axis in range(3))
    return np.einsum("ni,nj,nk->nijk", s, t, u).reshape(len(local), -1)


def displaced_slices(size: float, shift: float, pixel: float = 4.0) -> qf.Volume:
    """A mask of an ellipsoid in slices of 8 mm that are displaced in their planes, as between breath-holds."""
    voxel = np.array([pixel, pixel, 8.0])
    count = np.array([72 // pixel, 72 // pixel, 11], dtype=int)
    at = (np.moveaxis(np.indices(count), 0, -1) - (count - 1) / 2) * voxel
    at[..., :2] -= shift * np.random.default_rng(0).normal(size=(11, 2))
    inside = ((at / (size * np.array([26.0, 24.0, 40.0]))) ** 2).sum(axis=-1) < 1
    return qf.Volume(inside.astype(np.uint8), np.diag([*voxel, 1.0]))


def test_models_keep_the_base_that_was_given_and_volumes_are_below_it():
    """Old fault: only `fit` stored the base; volumes of tracked models counted what lies beyond it."""
    planes = [((0.0, 0.0, height), (0.0, 0.0, 1.0)) for height in (12.0, 10.0)]
    sizes = np.array([20.0, 18.0, 30.0]), np.array([16.0, 14.4, 27.0])
    clouds = [size * even_directions(900) for size in sizes]
    frames = [{"endo": cloud[cloud[:, 2] < plane[0][2]]} for cloud, plane in zip(clouds, planes)]
    found = qf.track(frames, base=planes, box=(3, 3, 3), period=None)
    for models in (found.models, [found.moving.at(time) for time in (0.0, 1.0)]):
        assert [model.landmarks.base.point[2] for model in models] == [12.0, 10.0]
    stored = qf.measure(found.models).curves["cavity volume"]
    # the part of an ellipsoid below z = h c: pi a b c (h - h^3 / 3 + 2 / 3)
    heights = np.array([12.0 / 30, 10.0 / 27])
    truth = np.pi * np.array([size.prod() for size in sizes]) * (heights - heights**3 / 3 + 2 / 3) / 1000
    np.testing.assert_allclose(stored, truth, rtol=0.02)
    assert qf.track([{"endo": cloud} for cloud in clouds], box=(3, 3, 3), period=None).moving.landmarks == ()


def test_the_noise_of_a_cycle_of_displaced_slices_is_their_displacement():
    """Old fault: the known errors were scaled as a whole, to 7.5 mm where slices were displaced by 3 mm."""
    masks = [displaced_slices(size, 3.0, pixel=1.5) for size in (1.0, 0.85)]
    found = qf.track([qf.points_from_image(mask).cloud for mask in masks], box=(3, 3, 3))
    assert found.rms < found.noise < 3.3


def test_voxels_of_displaced_slices_are_no_outliers():
    """Old fault: voxels know their points in a slice to a millimetre, so a slice displaced by three was left out."""
    masks = displaced_slices(1.0, 3.0), displaced_slices(0.7, 0.0)
    found = qf.track([qf.points_from_image(mask).cloud for mask in masks], box=(3, 3, 3))
    assert not {"OUTLIERS", "MANY_OUTLIERS"} & found.warnings.keys() and not any("OUTLIERS" in n for n in found.notes)
    for model, mask in zip(found.models, masks):
        assert model.volume() == pytest.approx(mask.values.sum() * 128, rel=0.02)
