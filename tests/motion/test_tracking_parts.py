"""Parts of the tracking of a motion: the first frame, times, periods, bases, and how warnings name their frames."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions

from quadriform.errors import OptionError, PointsError
from quadriform.motion import frames, quality, tracking, whole_cycle
from quadriform.motion.task import Task
from quadriform.motion.track import Track
from quadriform.point_sets import PointSet
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric

SPHERE = even_directions(60)
SPHERES = {"a": Superquadric(), "b": Superquadric()}


def task(clouds, noise=None):
    noise = [{} for _ in clouds] if noise is None else noise
    return Task(clouds, noise, [None] * len(clouds), np.arange(len(clouds)), None, None, {"box": 3}, None)


def test_the_first_frame_has_many_points_and_a_large_extent():
    """Of a heart end diastole; the product of the number and the median distance from the middle decides."""
    assert task([{"a": SPHERE}, {"a": 1.2 * SPHERE}, {"a": 1.1 * SPHERE}]).reference == 1
    assert task([{"a": SPHERE[:40]}, {"a": 1.4 * SPHERE[:40]}, {"a": SPHERE}]).reference == 2
    assert task([{"a": 1.01 * SPHERE}, {"a": SPHERE + 100}, {"a": SPHERE}]).reference == 0
    walls = [{"a": SPHERE, "b": 0.5 * SPHERE}, {"a": SPHERE, "b": 0.6 * SPHERE}]
    sizes = [np.median(np.linalg.norm(np.concatenate(list(w.values())), axis=1)) for w in walls]
    assert task(walls).reference == int(np.argmax(sizes))


def test_frames_are_the_same_where_all_their_points_are():
    one = {"a": SPHERE, "b": SPHERE}
    assert tracking._equal(one, {"b": SPHERE.copy(), "a": SPHERE.copy()})
    assert not tracking._equal(one, {"a": SPHERE, "b": SPHERE + 1e-12}) and not tracking._equal(one, {"a": SPHERE})


def test_each_frame_starts_from_its_neighbour_on_the_side_of_the_first_one(monkeypatch):
    """Frame 3 is the first, frame 4 has the same points; the model of a frame is known by its control points."""

    def found(number, start):
        made.append((int(number), start))
        box = SimpleNamespace(control_points=np.full(3, number), origin="corner", edges="sides")
        return SimpleNamespace(model=SimpleNamespace(box=box, surfaces="all"))

    def refine(surfaces, points, *, start, **options):
        assert (surfaces, options) == ("all", {"box": 3, "base": None, "prior": None})
        return found(np.ptp(points["a"].points), int(start.control_points[0]))

    made, reported = [], []
    clouds = [{"a": np.array([[0, 0, 0], [size, 0, 0]])} for size in (10, 11, 12, 20, 20, 14, 15)]
    of = replace(task(clouds), progress=lambda done, of: reported.append((done, of)), basis=TimeBasis(np.arange(7)))
    monkeypatch.setattr(tracking, "fit", lambda points, **options: found(np.ptp(points["a"].points), None))
    monkeypatch.setattr(tracking, "refine", refine)
    monkeypatch.setattr(tracking, "MovingModel", lambda *parts: parts)
    monkeypatch.setattr(tracking, "_of_fits", lambda *parts: parts)
    strategy, _, fits, (surfaces, origin, edges, every, control) = tracking._previous(of)
    assert made == [(20, None), (14, 20), (15, 14), (12, 20), (11, 12), (10, 11)]
    assert reported == [(done, 7) for done in range(2, 8)]
    assert (strategy, surfaces, origin, edges) == ("previous", "all", "corner", "sides")
    assert control[:, 0].tolist() == [10, 11, 12, 20, 20, 14, 15] and fits[4] is fits[3]
    np.testing.assert_array_equal(every.knots, np.arange(7))


def test_all_frames_begin_as_a_smooth_box_of_one_alone_of_whose_noise_nothing_is_known(monkeypatch):
    monkeypatch.setattr(whole_cycle, "smooth_box", lambda *given: given)
    monkeypatch.setattr(whole_cycle, "nested_ellipsoids", lambda points: SPHERES)
    options = {"box": (3, 4, 5), "regularity": "springs", "robust": False, "strength": 2.0}
    points, base = {"a": SPHERE, "b": SPHERE[:9]}, (np.zeros(3), np.eye(3)[2])
    given, surfaces = whole_cycle.smooth_start(points, base, options).approach.box
    assert surfaces == SPHERES and given.clouds is points and given.half_space is base
    assert {name: each.tolist() for name, each in given.weights.items()} == {"a": [1.0] * 60, "b": [1.0] * 9}
    assert (given.normals, given.noise.relative, given.noise.least_sigma) == ({}, {}, 0.0)
    chosen = given.options
    assert (chosen.box, chosen.regularity, chosen.strength, chosen.robust) == ((3, 4, 5), "springs", "auto", False)


def test_the_same_warning_of_several_frames_is_one_sentence():
    found = quality.by_frame([{"A": "x", "B": "y"}, {"A": "x"}, {}, {"A": "z"}])
    assert found == {"A": "frames 0, 1: x; frame 3: z", "B": "frame 0: y"}
    assert quality.by_frame([{}, {}]) == {}


def test_options_of_a_frame_have_its_base():
    of = task([{"a": SPHERE}] * 2)
    plane = SimpleNamespace(point=1, direction=2)
    of.bases[1] = plane
    assert of.options_of(0) == {"box": 3, "base": None, "prior": None}
    assert of.options_of(1) == {
        "box": 3,
        "base": (1, 2),
        "prior": None,
    }


def track(residuals):
    return Track("cycle", np.arange(len(residuals)), (), None, tuple(residuals), 0.1, (1.0,))


def test_distances_of_frames_are_root_mean_squares_over_their_points():
    found = track([{"a": np.array([3.0, -3]), "b": np.array([0.0])}, {"a": np.array([1.0])}])
    assert found.rms == pytest.approx(np.sqrt(19 / 4))
    np.testing.assert_allclose(found.frame_rms, [np.sqrt(6), 1])


def test_noise_of_all_frames_is_relative_in_their_frame():
    noise = [{"a": np.tile(4 * np.eye(3), (60, 1, 1))}, {"a": np.tile(16 * np.eye(3), (60, 1, 1))}]
    local = [{"a": SPHERE}, {"a": SPHERE}]
    found = whole_cycle._local_noise(noise, local, 2.0)
    # along a normal and a hundredth of all three
    np.testing.assert_allclose(found.least_sigma**2, 1.03 * (1 + 4) / 2)
    assert set(found.relative) == {"frame 0: a", "frame 1: a"}
    np.testing.assert_allclose(found.relative["frame 1: a"][0], 4 * np.eye(3) / found.least_sigma**2)


def sets(*noises):
    return [{"a": PointSet(SPHERE, noise=noise)} for noise in noises]


def test_noise_counts_where_it_is_known_of_all_frames():
    known = np.tile(np.eye(3), (60, 1, 1))
    assert [list(each) for each in frames.covariances(sets(known, known))] == [["a"], ["a"]]
    assert frames.covariances(sets(known, None)) == [{}, {}]


@pytest.mark.parametrize(
    ("times", "period", "expected"),
    [
        (np.arange(5.0), "auto", (5, 5.0, [0, 1, 2, 3, 4])),
        (np.array([2.0, 3, 5, 8]), "auto", (4, 8.0, [2, 4, 6, 8])),
        (np.array([2.0, 3, 5, 8]), None, (4, None, [2, 4, 6, 8])),
        (np.array([0.0, 1, 2]), 6.0, (3, 6.0, [0, 2, 4])),
        (np.array([1.0, 2]), None, (2, None, [1, 2])),
    ],
)
def test_knots_are_even_over_the_period_or_between_first_and_last_frame(times, period, expected):
    found = frames.time_basis(times, period)
    assert isinstance(found, TimeBasis) and (len(found.knots), found.period) == expected[:2]
    np.testing.assert_allclose(found.knots, expected[2])


def test_there_are_only_so_many_knots():
    many = np.arange(float(frames.MOST_KNOTS + 5))
    for period in ("auto", None):
        found = frames.time_basis(many, period)
        assert len(found.knots) == frames.MOST_KNOTS
    assert found.knots[-1] == many[-1]
    for wrong in (2.0, 1.9, -1.0):
        with pytest.raises(OptionError, match="expected more than the 2 between first and last frame"):
            frames.time_basis(np.array([0.0, 1, 2]), wrong)


def test_a_period_in_words_is_auto():
    with pytest.raises(OptionError, match="period"):
        frames.time_basis(np.array([0.0, 1, 2]), "weekly")


def test_times_increase_one_a_frame():
    assert frames.checked_times(None, 3).tolist() == [0, 1, 2]
    assert frames.checked_times([1, 2.5], 2).tolist() == [1, 2.5]
    for wrong, text in (([0, 1, 1], "frame 2 at 1 does not come after frame 1 at 1"), ([0, 1], "3 finite numbers")):
        with pytest.raises(OptionError, match=text):
            frames.checked_times(wrong, 3)


def test_frames_are_two_or_more_with_the_same_surfaces():
    with pytest.raises(OptionError, match="expected two or more, found 1"):
        frames.checked_frames([SPHERE], None)
    with pytest.raises(OptionError, match="2 frames, found 1"):
        frames.checked_frames([SPHERE, SPHERE], [0.1])
    with pytest.raises(PointsError, match="frame 1: "):
        frames.checked_frames([SPHERE, SPHERE[:0]], None)
    with pytest.raises(OptionError, match=r"frame 1 has the surfaces \['b'\], frame 0 has \['a'\]"):
        frames.checked_frames([{"a": SPHERE}, {"b": SPHERE}], None)
    assert len(frames.checked_frames([SPHERE, SPHERE], 0.1)) == 2


def test_bases_are_one_for_all_or_one_for_each():
    given, plane = [{"a": PointSet(SPHERE)}] * 2, ((0, 0, 0.9), (0, 0, 2.0))
    both = frames.planes_of_frames(plane, given)
    assert [each.direction.tolist() for each in both] == [[0, 0, 1]] * 2
    assert frames.planes_of_frames([None, plane], given)[0] is None
    with pytest.raises(OptionError, match="2 frames, found 3 entries"):
        frames.planes_of_frames([plane] * 3, given)
    with pytest.raises(OptionError, match="frame 1: "):
        frames.planes_of_frames([plane, ((0, 0, 0), (0, 0, 1))], given)


def test_slices_are_numbered_point_by_point():
    clouds = [{"surface": SPHERE}] * 2
    numbers = np.arange(60) % 3
    found = frames.checked_slices([numbers, {"surface": numbers}], clouds, "cycle")
    assert [each["surface"].tolist() for each in found] == [numbers.tolist()] * 2
    assert frames.checked_slices(None, clouds, "alone") is None
    of_table = frames.checked_slices([numbers * 1.0, numbers.astype(np.uint8)], clouds, "cycle")
    assert [each["surface"].tolist() for each in of_table] == [numbers.tolist()] * 2
    for given, strategy, text in (
        ([numbers] * 2, "alone", "strategy='cycle'"),
        ([numbers], "cycle", "2 frames, found 1"),
        ([numbers, numbers[:5]], "cycle", r"frame 1, surface: expected 60 whole numbers, one a point, found \(5,\)"),
        ([numbers, {}], "cycle", "frame 1: expected a slice number of each point of surface, found none"),
        ([numbers, {"other": numbers}], "cycle", "frame 1 has no surface 'other'"),
        ([numbers, numbers + 0.5], "cycle", "whole numbers below 2.53, found .*0.5.* for point 0"),
        ([numbers, np.where(numbers == 2, np.nan, numbers)], "cycle", "found .*nan.* for point 2"),
        ([numbers, numbers > 1], "cycle", "whole numbers below 2.53, found .*False.* for point 0"),
        ([numbers, ["a"] * 60], "cycle", "surface: expected 60 whole numbers, found .'a'"),
        ([numbers, [[1, 2], [3]]], "cycle", "surface: expected 60 whole numbers"),
        ([numbers, 1e300 * numbers], "cycle", "for point 1"),
    ):
        with pytest.raises(OptionError, match=text):
            frames.checked_slices(given, clouds, strategy)


def test_a_motion_much_farther_from_the_points_than_the_folded_one_is_a_poor_fit():
    """By more than half, and more than a fortieth of the radius: what folds are removed to at any strength."""

    def found(sigma, before):
        return quality.fold_removal_warnings(SimpleNamespace(sigma=sigma, sigma_before=before))

    assert found(0.5, None) == found(0.0449, 0.03) == found(0.0249, 0.001) == {}
    assert list(found(0.0451, 0.03)) == list(found(0.0251, 0.001)) == ["POOR_FIT"]
    assert "2.0 times as far from the points: 6.0 %" in found(0.06, 0.03)["POOR_FIT"]
