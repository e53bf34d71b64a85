"""Copies of a point are one point of all their weights together."""

import numpy as np

from quadriform.errors import WarningKind
from quadriform.fitting.cloud import Distinct
from quadriform.fitting.diagnostics import duplicates

ROWS = np.array([[1.0, 2, 3], [4, 5, 6], [1, 2, 3], [7, 8, 9], [1, 2, 3]])


def test_weights_of_copies_add():
    found = Distinct.of(ROWS, np.array([2.0, 1, 0.5, 0, 4]))
    assert found.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert found.weights.tolist() == [6.5, 1]


def test_what_is_found_of_a_point_holds_for_its_copies():
    found = Distinct.of(ROWS, np.array([2.0, 1, 0.5, 0, 4]))
    assert found.expand_to_duplicates(np.array([0.25, 0.75])).tolist() == [0.25, 0.75, 0.25, 0, 0.25]
    assert duplicates(found.copies, len(ROWS))[WarningKind.DUPLICATES].startswith("2 of 5 points")


def test_without_copies_all_stays_in_its_order():
    found = Distinct.of(ROWS[1::-1], np.array([3.0, 2]))
    assert found.points.tolist() == ROWS[1::-1].tolist() and found.weights.tolist() == [3, 2]
    assert duplicates(found.copies, 2) == {}
