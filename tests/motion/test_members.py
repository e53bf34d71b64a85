"""Cycles of a member of a population: the energy in each frame, and motions known from a few points of each."""

import numpy as np
import pytest
from priors_made import meshes
from scipy.spatial.transform import Rotation

from quadriform import Mesh, fit, learn_prior, track
from quadriform.errors import InputError, OptionError
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.population.coordinates import PriorCoordinates
from quadriform.fitting.population.linear_problem import PriorProblem
from quadriform.motion.cycle_equations import LinearCycleProblem
from quadriform.motion.members import Population
from quadriform.shapes.splines import TimeBasis

NOISE, SCORES = 0.3, ((1.0, -1.0, 0.5), (0.4, 0.2, 0.6), (-0.8, 0.9, 0.2))
RATIO, COUNT = 1e3, 200.0
BASIS = TimeBasis(np.arange(4.0), 4.0)


def bent(mesh):
    """A body that is no superquadric: bent by a third of its half length."""
    across = 0.008 * mesh.vertices[:, 2] ** 2
    return Mesh(mesh.vertices + np.outer(across, [1.0, 0.0, 0.0]), mesh.faces)


@pytest.fixture(scope="module")
def prior():
    return learn_prior([bent(mesh) for mesh in meshes()])


@pytest.fixture(scope="module")
def small(prior):
    """The prior with a size of about one, as in a fit."""
    return prior.transformed(0.03, np.zeros(3))


@pytest.fixture(scope="module")
def boxes(small):
    """The shapes of four frames, each in another pose."""
    found = []
    for number in range(4):
        box = small.model(SCORES[number % 3]).box
        rotation = Rotation.from_rotvec([0.1 * number, -0.05, 0.02 * number]).as_matrix()
        found.append(box.with_control_points(box.control_points @ rotation.T + 0.1 * number))
    return found


def rows(size, seed):
    rng = np.random.default_rng(seed)
    return NormalEquations.of_rows(rng.normal(size=(90, size)), rng.normal(size=90), 1.0)


def test_a_member_in_any_pose_costs_its_scores_alone(small, boxes):
    """With rho s^2 well above one the energy is the sum of squared scores over rho."""
    energy = Population(small, 1e6).energy(boxes)
    control = np.stack([box.control_points.reshape(-1, 3) - small.box.control_points.reshape(-1, 3) for box in boxes])
    coordinates = np.einsum("hj,fji->fhi", energy.inverse, control).reshape(4, -1)
    scores = np.array([SCORES[number % 3] for number in range(4)])
    assert energy.value(coordinates, np.eye(4)) == pytest.approx((scores**2).sum() / 4 / 1e6, rel=0.01)
    # in the pose of another frame it costs more
    other = energy.value(coordinates[[1, 2, 3, 0]], np.eye(4))
    assert other > 10 * energy.value(coordinates, np.eye(4))


def test_the_energy_is_the_quadratic_form_that_is_added(small, boxes, rng):
    energy, splines = Population(small, RATIO).energy(boxes), rng.normal(size=(4, 4))
    size = len(energy.mass)
    matrix = np.zeros((4 * size, 4 * size))
    energy.add(matrix, 1.0, splines)
    p = rng.normal(size=(4, size))
    found = p.ravel() @ matrix @ p.ravel() - 2 * energy.right(splines) @ p.ravel() + energy.constant
    assert energy.value(p, splines) == pytest.approx(found, rel=1e-9)


def test_determinants_are_those_of_the_matrices(small, boxes):
    energy = Population(small, RATIO).energy(boxes[:1])
    matrix = np.zeros_like(energy.mass)
    energy.add(matrix, 1.0, np.ones((1, 1)))
    pairs = [(1e-2, 1.0), (1.0, 1.0), (1e3, 1e-2)]
    expected = np.array([np.linalg.slogdet(alpha * matrix + gamma * energy.mass)[1] for alpha, gamma in pairs])
    found = np.array([energy.log_determinant(*pair) for pair in pairs])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    values = np.linalg.eigvalsh(matrix)[energy.null_dimension :]
    assert energy.log_determinant(3.0, 0.0) == pytest.approx(np.log(3.0 * values).sum(), rel=1e-6)


def test_frames_that_time_does_not_couple_are_those_of_single_fits(small, boxes):
    """Of two frames no motion is penalised, so that each has the solution of its own linear problem."""
    basis, population = TimeBasis(np.arange(2.0), 2.0), Population(small, RATIO)
    size = small.mean.size
    each = [rows(size, seed) for seed in range(2)]
    energy = population.energy(boxes[:2])
    problem = LinearCycleProblem(each, basis.values(np.arange(2.0)), basis, energy, 2 * COUNT)
    found = problem.solve(1e-2, 1.0)
    for number in range(2):
        single = PriorProblem(each[number], population.at(boxes[number]), COUNT, 1.0, 0.0, RATIO).solve(1e-2)
        np.testing.assert_allclose(found.displacement[number], single.displacement.reshape(-1, 3), atol=1e-7)
    cost = problem.cost(found.displacement, np.zeros(0), 1e-2, 1.0)
    assert found.sigma == pytest.approx(np.sqrt(cost / (2 * COUNT - 2 * energy.null_dimension)), rel=1e-9)


def test_the_pose_of_a_frame_is_that_of_its_box(small, boxes):
    moved = Population(small, RATIO).at(boxes[2])
    rotation = Rotation.from_rotvec([0.2, -0.05, 0.04]).as_matrix()
    expected = PriorCoordinates.of(small.rotated(rotation).transformed(1.0, np.full(3, 0.2)))
    weights = expected.weights(RATIO)
    one, other = (each.directions * np.sqrt(weights) for each in (moved, expected))
    np.testing.assert_allclose(one @ one.T, other @ other.T, atol=1e-6)


def frames_of(prior, noise=NOISE):
    """Each frame from the points near two planes through the axis, turned and moved against each other."""
    result, truths = [], []
    for number, scores in enumerate(SCORES):
        rotation = Rotation.from_rotvec([0.03 * number, 0.02 * number, 0.0]).as_matrix()
        points = prior.model(scores).mesh(resolution=24).vertices
        angles = np.arctan2(points[:, 1], points[:, 0])
        near = (np.abs(np.sin(2 * angles + 0.5)) < 0.1) & (points[:, 2] < 10)
        truths.append(points @ rotation.T + number)
        result.append(truths[-1][near] + np.random.default_rng(number).normal(0, noise, (near.sum(), 3)))
    return result, truths


def errors(models, truths):
    return [float(np.sqrt((model.distance(points) ** 2).mean())) for model, points in zip(models, truths)]


@pytest.fixture(scope="module")
def found(prior):
    frames, truths = frames_of(prior)
    return track(frames, prior=prior), frames, truths


def test_a_motion_of_members_is_known_from_a_few_points(found, prior):
    moving, frames, truths = found
    with_prior, without = errors(moving.models, truths), errors(track(frames).models, truths)
    assert max(with_prior) < NOISE and np.mean(with_prior) < 0.35 * np.mean(without)
    scores = [np.linalg.norm(each) for each in SCORES]
    np.testing.assert_allclose(moving.prior_distances, scores, atol=0.5)
    assert all(model.min_jacobian() > 0 for model in moving.models)
    assert "of the population" in " ".join(moving.warnings.values())


def test_frames_alone_have_a_prior_too(found, prior):
    moving, frames, _ = found
    alone = track(frames, strategy="alone", prior=prior)
    single = fit(frames[1], prior=prior)
    np.testing.assert_array_equal(alone.models[1].box.control_points, single.model.box.control_points)
    np.testing.assert_allclose(alone.prior_distances, moving.prior_distances, atol=0.5)


def test_the_motion_turns_with_its_points(found, prior):
    moving, frames, truths = found
    rotation = Rotation.from_rotvec([0.5, 1.0, -2.0]).as_matrix()
    turned = track([frame @ rotation.T + 7.0 for frame in frames], prior=prior)
    again = errors(turned.models, [truth @ rotation.T + 7.0 for truth in truths])
    np.testing.assert_allclose(again, errors(moving.models, truths), atol=0.2 * NOISE)


def test_options_that_a_prior_takes_the_place_of_are_refused(found, prior):
    _, frames, _ = found
    for options in ({"box": (4, 4, 4)}, {"strength": 1e-3}, {"regularity": "springs"}):
        with pytest.raises(OptionError, match=f"option {next(iter(options))}"):
            track(frames, prior=prior, **options)
    with pytest.raises(OptionError, match="strategy='previous'"):
        track(frames, prior=prior, strategy="previous")
    with pytest.raises(InputError, match="the prior is of the surfaces"):
        track([{"other": frame} for frame in frames], prior=prior)
    with pytest.raises(InputError, match="same unit"):
        track([frame / 1000 for frame in frames], prior=prior)
    with pytest.raises(OptionError, match="expected a prior"):
        track(frames, prior="lv.prior.npz")
