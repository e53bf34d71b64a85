"""The 17 segments: where each lies, and what anchors them."""

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.heart.aha_segments import NAMES, AhaSegmentation
from quadriform.heart.axis import LongAxis
from quadriform.shapes.pose import rotation_from_euler
from quadriform.shapes.superquadric import Superquadric

AXIS = LongAxis(np.array([0.0, 0, -90]), np.zeros(3))
"""Apex below; seen from there, x to the left is y up: counter-clockwise about -z."""


def at(degrees, height):
    """A point 20 from the axis, by the angle counter-clockwise from the apex, x being 0; height from 0 to 1."""
    angle = -np.radians(degrees)
    return np.array([20 * np.cos(angle), 20 * np.sin(angle), -90 + 90 * height])


INSERTS = np.array([at(-50, 0.5), at(-65, 0.8), at(50, 0.5), at(65, 0.8)])
"""Anterior ones clockwise from the septum's middle, inferior ones counter-clockwise."""


@pytest.mark.parametrize(
    ("degrees", "height", "name"),
    [
        (-90, 0.9, "basal anterior"),
        (-30, 0.9, "basal anteroseptal"),
        (30, 0.9, "basal inferoseptal"),
        (90, 0.9, "basal inferior"),
        (150, 0.9, "basal inferolateral"),
        (-150, 0.9, "basal anterolateral"),
        (-90, 0.5, "mid anterior"),
        (-150, 0.5, "mid anterolateral"),
        (-90, 0.2, "apical anterior"),
        (0, 0.2, "apical septal"),
        (90, 0.2, "apical inferior"),
        (180, 0.2, "apical lateral"),
        (70, -0.05, "apex"),
    ],
)
def test_each_position_has_its_segment(degrees, height, name):
    number = AhaSegmentation.anchored(AXIS, INSERTS).numbers(at(degrees, height)[None])[0]
    assert NAMES[number - 1] == name


def test_beyond_the_base_is_no_segment():
    assert AhaSegmentation.anchored(AXIS, INSERTS).numbers(at(10, 1.01)[None])[0] == 0


def test_segments_rotate_with_the_heart(rng):
    turn, shift = rotation_from_euler(np.array([0.5, -1.1, 2.0])), np.array([10.0, 20, -30])
    points = rng.normal(size=(300, 3)) * [20, 20, 40] - [0, 0, 45]
    axis = LongAxis(turn @ AXIS.apex + shift, turn @ AXIS.base + shift)
    before = AhaSegmentation.anchored(AXIS, INSERTS).numbers(points)
    after = AhaSegmentation.anchored(axis, INSERTS @ turn.T + shift).numbers(points @ turn.T + shift)
    assert (before == after).all()
    assert set(before) >= set(range(1, 18))


def test_more_insertions_on_one_side_do_not_move_the_septum():
    many = np.concatenate([INSERTS, [at(-50, h) for h in np.linspace(0.4, 0.9, 10)]])
    septum = AhaSegmentation.anchored(AXIS, many).septum
    assert np.degrees(np.arccos(septum @ [1, 0, 0])) < 4


@pytest.mark.parametrize(
    ("inserts", "words"),
    [
        ([at(10, 0.5)], "one point"),
        ([at(0, 0.5), at(180, 0.5)], "all around the long axis"),
        ([at(30, 0.5), at(30, 0.7)], "all on one side"),
    ],
)
def test_insertions_that_show_no_septum_are_refused(inserts, words):
    with pytest.raises(OptionError, match=words):
        AhaSegmentation.anchored(AXIS, inserts)


def test_without_insertions_rings_are_right():
    cavity = Superquadric(semi_axes=(20, 20, 45), translation=(0, 0, -45))
    numbers = AhaSegmentation.unanchored(AXIS, cavity).numbers(np.array([at(a, 0.5) for a in range(3, 360, 60)]))
    assert sorted(numbers) == [7, 8, 9, 10, 11, 12]
