"""Three levels of status, decided in one table."""

import numpy as np
import pytest
from notes import note_of
from shapes_made import lumpy

import quadriform as qf
from quadriform.errors import LEVEL, LEVELS, FitError, OptionError, WarningKind, check_strict, status_of, without_notes
from quadriform.fitting.diagnostics import outliers

NOTE, WARNED, BAD = WarningKind.OUTLIERS, WarningKind.PARTIAL_COVERAGE, WarningKind.FOLDING


def test_every_kind_has_a_level():
    assert LEVEL.keys() == set(WarningKind) and set(LEVEL.values()) <= set(LEVELS)


def test_the_worst_kind_decides():
    assert [status_of(kinds) for kinds in ([], [NOTE], [NOTE, WARNED], [BAD, WARNED])] == [
        "ok",
        "ok",
        "warned",
        "unreliable",
    ]


def test_kinds_without_consequence_become_notes():
    assert without_notes({NOTE: "two", WARNED: "half"}) == ({WARNED: "half"}, ("OUTLIERS: two",))


@pytest.mark.parametrize(
    ("strict", "status", "refused"),
    [
        (None, "unreliable", False),
        ("unreliable", "warned", False),
        ("unreliable", "unreliable", True),
        ("warned", "warned", True),
        ("warned", "unknown", False),
        ("warned", "ok", False),
    ],
)
def test_what_is_refused(strict, status, refused):
    if refused:
        with pytest.raises(FitError, match="FOLDING: a fold"):
            check_strict(strict, status, {BAD: "a fold"})
    else:
        check_strict(strict, status, {BAD: "a fold"})


def test_an_unknown_level_is_refused_itself():
    with pytest.raises(OptionError, match="'warned', 'unreliable'"):
        check_strict("ok", "ok", {})


def test_more_than_a_quarter_of_outliers_is_more_than_a_note():
    inliers = np.ones(100)
    inliers[:25] = 0
    assert outliers(inliers).keys() == {WarningKind.OUTLIERS}
    counted = np.arange(100) < 99  # a point without weight is none
    assert outliers(inliers, counted).keys() == {WarningKind.MANY_OUTLIERS}


def test_one_outlier_among_many_points_is_a_note():
    found = qf.fit(np.vstack([lumpy(1500), [[500.0, 0, 0]]]), box=(3, 3, 3))
    assert found.status == "ok" and note_of(found, "OUTLIERS").startswith("1 of 1501 points")
    assert found.require_ok() is found and found.model.notes == found.notes


def test_what_is_warned_of_is_usable_and_not_ok():
    found = qf.fit(lumpy(600)[lumpy(600)[:, 2] > -15], box=(3, 3, 3))
    assert found.status == "warned" and found.require_usable() is found
    with pytest.raises(FitError, match="PARTIAL_COVERAGE"):
        found.require_ok()
