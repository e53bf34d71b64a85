"""Tracking: known motions are found, cycles borrow over time, slices go back to their places, bad input is named."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes_made import even_directions, made

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.motion.whole_cycle import STACK
from quadriform.point_sets import PointSet
from quadriform.shapes.solid import Solid

FRAMES, BOX = 6, (3, 3, 3)
OUTER = made(exponents=(1, 1), semi_axes=(20, 18, 30))
INNER = made(exponents=(1, 1), semi_axes=(14, 12.6, 21))


def beat(points, time):
    """All space shrinks across the third axis and along it by different shares, with the period of the frames."""
    phase = 0.5 - 0.5 * np.cos(2 * np.pi * time / FRAMES)
    local = (points - OUTER.translation) @ OUTER.rotation
    return local * [1 - 0.2 * phase, 1 - 0.2 * phase, 1 - 0.1 * phase] @ OUTER.rotation.T + OUTER.translation


def heart(count=100, noise=0.2, seed=0):
    rng, frames = np.random.default_rng(seed), []
    for time in range(FRAMES):
        clouds = {"epi": beat(OUTER.surface(even_directions(count)), time)}
        clouds["endo"] = beat(INNER.surface(even_directions(count)), time)
        frames.append({name: cloud + rng.normal(0, noise, cloud.shape) for name, cloud in clouds.items()})
    return frames


def off(model, time, name="endo"):
    truth = beat((OUTER if name == "epi" else INNER).surface(even_directions(400)), time)
    return np.sqrt((model.distance(truth, name) ** 2).mean())


@pytest.fixture(scope="module")
def cycle():
    return qf.track(heart(), box=BOX)


@pytest.mark.parametrize("strategy", ["alone", "previous"])
def test_each_frame_comes_near_the_truth(strategy):
    found = qf.track(heart()[:3], strategy=strategy, box=BOX)
    assert max(off(model, time) for time, model in enumerate(found.models)) < 0.2
    assert found.rms == pytest.approx(0.2, rel=0.25)
    assert (found.moving is None) == (strategy == "alone")


def test_the_cycle_comes_near_the_truth_and_does_not_fold(cycle):
    for time, model in enumerate(cycle.models):
        assert off(model, time) < 0.12 and off(model, time, "epi") < 0.12
        assert model.min_jacobian() > 0 and not model.crossings()
    assert cycle.noise == pytest.approx(0.2, rel=0.15)
    assert cycle.status == "ok"


def test_the_moving_model_knows_the_times_of_its_frames():
    """Knots are even over the period, frames are not."""
    one = {"surface": heart()[0]["endo"]}
    found = qf.track([one, one], times=[1, 4], period=8, box=BOX, strength=1e-4)
    assert np.array_equal(found.moving.basis.knots, [1, 5])
    assert np.array_equal(found.moving.frame_times, [1, 4])


def test_a_frame_that_encloses_another_body_than_its_mask_is_named():
    cloud, body = heart()[0]["endo"], INNER.mesh(16)
    larger = qf.Mesh(OUTER.translation + 1.2 * (body.vertices - OUTER.translation), body.faces)
    own, other = (PointSet(cloud, solid=Solid.of_mesh(mesh)) for mesh in (body, larger))
    options = dict(times=[1, 4], period=8, box=BOX, strength=1e-4)
    assert qf.track([own, own], **options).status == "ok"
    found = qf.track([own, other], **options)
    assert found.status == "unreliable" and found.warnings["LOW_OVERLAP"].startswith("frame 1: ")
    # a body without a place: that of slices which are shifted
    slices = [np.arange(len(cloud)) % 5] * 2
    assert "LOW_OVERLAP" not in qf.track([own, other], slices=slices, **options).warnings


def test_between_the_frames_it_is_near_the_truth_too(cycle):
    assert off(cycle.moving.at(1.5), 1.5) < 0.25
    assert off(cycle.moving.at(1.5 + FRAMES), 1.5) < 0.25


def test_a_sparse_frame_borrows_from_its_neighbours():
    """Of one frame only a sixth of the points is left, all on one side."""
    frames = heart()
    side = (frames[2]["endo"] - OUTER.translation) @ OUTER.rotation[:, 0] > 7
    frames[2] = {"epi": frames[2]["epi"], "endo": frames[2]["endo"][side]}
    alone, together = qf.fit(frames[2], box=BOX), qf.track(frames, box=BOX)
    assert off(together.models[2], 2) < 0.6 * off(alone.model, 2)


@pytest.mark.parametrize("strategy", ["previous", "cycle"])
def test_a_strength_that_is_asked_for_is_used(strategy):
    assert qf.track(heart()[:2], strategy=strategy, box=BOX, strength=1e-3).strengths[0] == pytest.approx(1e-3)
    with pytest.raises(OptionError, match="strength"):
        qf.track(heart()[:3], strategy=strategy, strength=-1.0)


def test_volumes_of_the_cycle_are_those_of_the_motion(cycle):
    for time, model in enumerate(cycle.models):
        phase = 0.5 - 0.5 * np.cos(2 * np.pi * time / FRAMES)
        truth = 4 / 3 * np.pi * 14 * 12.6 * 21 * (1 - 0.2 * phase) ** 2 * (1 - 0.1 * phase)
        assert model.volume("endo") == pytest.approx(truth, rel=0.02)


def sliced(seed=1):
    """Rings of both surfaces across the third axis and along it, with the numbers of their slices."""
    t, frames, numbers = np.linspace(0, 2 * np.pi, 24, endpoint=False), [], []
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    rings = [circle * np.sqrt(1 - h**2) + [0, 0, h] for h in (-0.7, -0.35, 0, 0.35, 0.7)]
    rings += [circle[:, [0, 2, 1]], circle[:, [2, 0, 1]]]
    rng = np.random.default_rng(seed)
    for time in range(FRAMES):
        clouds, of = {}, {}
        for name, surface in (("epi", OUTER), ("endo", INNER)):
            unit = np.concatenate(rings) * surface.semi_axes
            cloud = beat(unit @ surface.rotation.T + surface.translation, time)
            clouds[name] = cloud + rng.normal(0, 0.1, cloud.shape)
            of[name] = np.repeat(np.arange(len(rings)), len(t))
        frames.append(clouds)
        numbers.append(of)
    return frames, numbers


def test_a_slice_that_moved_is_put_back():
    """Slice 3 lies 2 units aside; that all slices moved together could not be told, so their shifts sum to zero."""
    times = range(0, FRAMES, 2)
    frames, numbers = (each[::2] for each in sliced())
    aside = 2 * OUTER.rotation[:, 0]
    for clouds, of in zip(frames, numbers):
        for name in clouds:
            clouds[name] = clouds[name] + (of[name] == 3)[:, None] * aside
    plain, shifted = qf.track(frames, box=BOX), qf.track(frames, slices=numbers, box=BOX)
    relative = shifted.shifts[3] - np.mean([shifted.shifts[n] for n in (0, 1, 2, 4)], axis=0)
    np.testing.assert_allclose(relative, -aside, atol=0.4)
    assert shifted.rms < 0.6 * plain.rms
    mean, before = (np.mean([off(*pair) for pair in zip(found.models, times)]) for found in (shifted, plain))
    assert mean < before


def test_a_slice_that_rotated_in_its_plane_is_put_back():
    """Slice 5, along the axis, is an ellipse that rotated by 12 degrees: not to first order only."""
    frames, numbers = (each[::3] for each in sliced())
    known = np.radians(12) * OUTER.rotation[:, 1]
    for clouds, of in zip(frames, numbers):
        for name, cloud in clouds.items():
            rotated = Rotation.from_rotvec(known).apply(cloud - OUTER.translation) + OUTER.translation
            clouds[name] = np.where((of[name] == 5)[:, None], rotated, cloud)
    found = qf.track(frames, slices=numbers, box=BOX)
    others = np.mean([found.moves[n].rotation for n in (0, 1, 2, 3, 4, 6)], axis=0)

    np.testing.assert_allclose(
        (found.moves[5].rotation - others) @ OUTER.rotation[:, 1], -np.radians(12), atol=np.radians(1.5)
    )
    assert found.moves[5].sd[2] < 0.3 * found.moves[2].sd[2]  # a slice across is nearly a circle


def test_a_slice_with_another_number_in_each_frame_moves_in_each():
    """Frames of their own breath-holds: slice 3 lies 2 units aside in the second one alone."""
    frames, numbers = (each[::3] for each in sliced())
    aside = 2 * OUTER.rotation[:, 0]
    for name in frames[1]:
        frames[1][name] = frames[1][name] + (numbers[1][name] == 3)[:, None] * aside
        numbers[1][name] = numbers[1][name] + 10
    found = qf.track(frames, slices=numbers, box=BOX)
    assert list(found.moves) == [*range(7), *range(10, 17)]
    for first, expected in ((0, 0 * aside), (10, -aside)):
        rest = np.mean([found.shifts[first + n] for n in (0, 1, 2, 4)], axis=0)
        np.testing.assert_allclose(found.shifts[first + 3] - rest, expected, atol=0.4)


def test_shifts_that_the_slices_do_not_determine_are_noted():
    """Of short-axis slices alone; long-axis ones determine how the stack leans."""
    frames, numbers = ([{"endo": each["endo"]} for each in every[:2]] for every in sliced())
    stack = [{"endo": each["endo"] < 5} for each in numbers]
    across = [{"endo": cloud["endo"][kept["endo"]]} for cloud, kept in zip(frames, stack)]
    of_stack = [{"endo": each["endo"][kept["endo"]]} for each, kept in zip(numbers, stack)]
    assert STACK in qf.track(across, slices=of_stack, box=BOX).notes
    assert STACK not in qf.track(frames, slices=numbers, box=BOX).notes
    assert STACK not in qf.track(across, box=BOX).notes


@pytest.mark.parametrize(
    "options, message",
    [
        ({"times": [0, 1, 1, 2, 3, 4]}, "frame 2 at 1 does not come after frame 1 at 1"),
        ({"times": [0, 1]}, "expected 6 finite numbers"),
        ({"period": 3.0}, "more than the 5"),
        ({"strategy": "best"}, "strategy"),
        ({"strategy": "alone", "slices": [{}] * 6}, "use strategy='cycle'"),
        ({"slices": [{}] * 5}, "each of 6 frames"),
        ({"slices": [{"epi": [1], "endo": [1]}] * 6}, "frame 0, epi: expected 100 whole numbers"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(OptionError, match=message):
        qf.track(heart(), box=BOX, **options)


def test_one_frame_is_for_fit():
    with pytest.raises(OptionError, match="a single one is for fit"):
        qf.track(heart()[:1])


def test_the_frame_that_is_wrong_is_named():
    frames = heart()
    frames[3] = {"epi": frames[3]["epi"]}
    with pytest.raises(OptionError, match="frame 3 has the surfaces"):
        qf.track(frames)
    frames[3] = {"epi": frames[0]["epi"], "endo": np.full((100, 3), np.nan)}
    with pytest.raises(PointsError, match="frame 3"):
        qf.track(frames)


@pytest.mark.parametrize("strategy", ["cycle", "alone"])
def test_a_loss_of_digits_is_reported_with_its_frame(strategy):
    """As they came: once they are checked all are double precision."""
    far = [frame["endo"] + 1e6 for frame in heart()[:2]]
    found = qf.track([far[0], far[1].astype(np.float32)], strategy=strategy, box=BOX)
    assert found.status == "warned"
    assert found.warnings["PRECISION_LOSS"].startswith("frame 1: neighbouring float32 values at 1e+06")
