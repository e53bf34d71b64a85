"""Affine images of a deformed box, fitted to the points of all frames."""

import numpy as np
import pytest

import quadriform as qf
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.refinement.point_to_plane import Rows
from quadriform.fitting.refinement.unfolding import JacobianPenalty
from quadriform.motion.affine_start import AffineMotion, fitted_motion
from quadriform.motion.cycle import Cycle
from quadriform.motion.cycle_rounds import Report, _affine_images
from quadriform.motion.energies import Smoothness
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.splines import TimeBasis

FRAMES = 6
BASIS = TimeBasis(np.arange(float(FRAMES)), float(FRAMES))
VALUES = BASIS.values(np.arange(float(FRAMES)))


def deformed(seed=0, size=0.1):
    """A box around the unit ball whose control points are moved at random."""
    box = ControlBox.undeformed(np.full(3, -1.0), 2 * np.eye(3), (4, 3, 5))
    return box.with_control_points(box.rest + size * np.random.default_rng(seed).normal(size=box.rest.shape))


def harmonic_maps(seed=1):
    """Affine maps at the knots that change as a mean and a first harmonic do: no penalty in time acts on them."""
    mean, cosine, sine = np.random.default_rng(seed).normal(size=(3, 4, 3))
    phase = 2 * np.pi * np.arange(FRAMES) / FRAMES
    parts = 0.1 * (np.cos(phase)[:, None, None] * cosine + np.sin(phase)[:, None, None] * sine)
    return np.eye(4, 3) + 0.1 * mean + parts


def rows_of(box, maps, seed=2, count=40):
    """For each frame points of the box, their exact images as targets, and metrics of full rank."""
    rng = np.random.default_rng(seed)
    found = []
    for each in maps:
        origins, roots = rng.uniform(-0.6, 0.6, (count, 3)), rng.normal(size=(count, 3, 3))
        targets = np.c_[box.deform(origins), np.ones(count)] @ each
        found.append([Rows(origins, targets, roots @ roots.transpose(0, 2, 1))])
    return found


@pytest.mark.parametrize("gamma", [1e-9, 1e3])
@pytest.mark.parametrize("without", [(), (2,), (0, 4)])
def test_affine_motions_are_found_exactly_also_where_frames_have_no_data(gamma, without):
    box, maps = deformed(), harmonic_maps()
    rows = [[] if frame in without else each for frame, each in enumerate(rows_of(box, maps))]
    found = fitted_motion(rows, box, VALUES, BASIS, gamma)
    np.testing.assert_allclose(found.maps, maps, atol=1e-8)


def test_the_motion_minimises_the_sum_of_the_module():
    box, rng = deformed(), np.random.default_rng(3)
    rows = [
        [Rows(of.origins, of.targets + 0.2 * rng.normal(size=of.targets.shape), of.metric) for of in each]
        for each in rows_of(box, harmonic_maps())
    ]
    gamma, bending = 1e-3, BASIS.bending()
    feet = np.concatenate([box.deform(of.origins) for each in rows for of in each])

    def total(maps):
        result = 0.0
        for frame, each in enumerate(rows):
            now = sum(VALUES[frame, knot] * maps[knot] for knot in range(FRAMES))
            for of in each:
                for origin, target, metric in zip(of.origins, of.targets, of.metric):
                    left = target - (box.deform(origin[None])[0] @ now[:3] + now[3])
                    result += left @ metric @ left
        for one in range(FRAMES):
            for other in range(FRAMES):
                for foot in feet:
                    image, also = (foot @ maps[knot][:3] + maps[knot][3] for knot in (one, other))
                    result += gamma * bending[one, other] * (image @ also)
        return result

    found = fitted_motion(rows, box, VALUES, BASIS, gamma)
    least = total(found.maps)
    for _ in range(2):
        step = 1e-3 * rng.normal(size=found.maps.shape)
        up, down = total(found.maps + step), total(found.maps - step)
        assert up > least and down > least
        assert up - down == pytest.approx(0, abs=1e-6 * (up + down - 2 * least))  # no slope at the minimum


def test_boxes_are_the_box_and_then_the_affine_map():
    box, maps = deformed(), harmonic_maps()
    points = np.random.default_rng(4).uniform(-0.9, 0.9, (50, 3))
    motion = AffineMotion(maps, VALUES)
    for moved, each in zip(motion.boxes(box), maps):  # the knots are the frames
        np.testing.assert_allclose(moved.deform(points), np.c_[box.deform(points), np.ones(50)] @ each, atol=1e-12)
    np.testing.assert_allclose(motion.at_knots(points), [np.c_[points, np.ones(50)] @ each for each in maps])
    assert motion.least_determinant == pytest.approx(min(np.linalg.det(each[:3]) for each in maps))


def test_no_motion_moves_nothing():
    box, none = deformed(), AffineMotion.identity(VALUES)
    assert all(np.allclose(each.control_points, box.control_points) for each in none.boxes(box))
    assert none.least_determinant == pytest.approx(1)


def test_without_data_and_with_mirrored_data_there_is_no_motion():
    box = deformed()
    assert fitted_motion([[]] * FRAMES, box, VALUES, BASIS, 1e-3) is None
    mirrored = np.repeat(np.diag([1.0, -1, 1, 1])[:, :3][None], FRAMES, axis=0)
    assert fitted_motion(rows_of(box, mirrored), box, VALUES, BASIS, 1e-3) is None


def test_a_change_of_the_whole_volume_is_no_fold():
    ball, box, folded = {"a": qf.Superquadric()}, deformed(), deformed(size=1.0)
    penalty = JacobianPenalty.of(box, ball, 100, 0.1)
    shrunk = AffineMotion(np.array([np.diag([0.4, 0.5, 0.6, 1])[:, :3]] * FRAMES), VALUES).boxes
    relative = penalty.relative_to(shrunk(box.with_control_points(box.rest))[0])
    assert relative.usual == pytest.approx(0.12)
    assert relative.minimum(shrunk(folded)[0]) == pytest.approx(penalty.minimum(folded))
    assert relative.cost(shrunk(folded)[0]) == pytest.approx(penalty.cost(folded))
    assert penalty.cost(folded) > 0
    even = box.with_control_points(0.4 * box.rest)  # 0.064 of the volume
    assert penalty.cost(even) > 0 == relative.cost(even)


def test_the_equations_of_the_relative_penalty_have_its_slope():
    box, rng = deformed(size=1.0), np.random.default_rng(5)
    penalty = JacobianPenalty.of(box, {"a": qf.Superquadric()}, 100, 0.1)
    relative = penalty.relative_to(box.with_control_points(0.5 * box.rest))
    equations, moved = relative.equations(box), (box.control_points - box.rest).ravel()
    assert equations.squares(moved) == pytest.approx(relative.cost(box), rel=1e-9)
    step = 1e-5 * rng.normal(size=box.rest.shape)
    slope = 2 * (equations.matrix @ moved - equations.right) @ step.ravel()
    up, down = (relative.cost(box.with_control_points(box.control_points + sign * step)) for sign in (1, -1))
    assert (up - down) / 2 == pytest.approx(slope, rel=1e-3)


def test_frames_that_are_affine_images_begin_on_their_points():
    """Once they began at the box plus an affine map, which folds where the box is compressed more than the motion."""
    surfaces, box = {"a": qf.Superquadric()}, ControlBox.undeformed(np.full(3, -1.1), 2.2 * np.eye(3), (4, 4, 4))
    bend = np.einsum("...i,...i->...", box.rest, box.rest)[..., None] * np.array([0.2, 0, -0.1])
    start = box.with_control_points(box.rest * np.array([1.0, 1.2, 1.8]) + bend)
    points = start.deform(surfaces["a"].grid(8)[0])
    frames = [{"a": points @ np.diag(each)} for each in ((1.0, 1, 1), (0.45, 0.5, 0.8), (0.7, 0.8, 0.9))]
    basis = TimeBasis(np.arange(3.0), 3.0)
    values, known = basis.values(np.arange(3.0)), KnownNoise.of_local({}, {})
    cycle = Cycle(
        surfaces, box, frames, values, basis, Smoothness("bending", (4, 4, 4)), False, None, known, [None] * 3
    )
    state = _affine_images(cycle, cycle.init(), start, Report(None))
    for moved, each in zip(state.boxes, state.datasets):
        assert each[0].distances(moved).max() < 0.02
        assert moved.jacobian_determinant(points * 0.3).min() > 0
    assert [each.usual for each in state.fold_penalties] == pytest.approx(
        [start_usual * volume for start_usual, volume in zip([state.fold_penalties[0].usual] * 3, (1, 0.18, 0.504))],
        rel=0.02,
    )
