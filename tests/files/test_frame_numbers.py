"""The order of files in time: numbers count as numbers, and an order that is not clear is refused."""

from pathlib import Path

import pytest

from quadriform.errors import InputError
from quadriform.files.frame_numbers import frame_numbers, in_time, missing_numbers, names_of, natural


def paths(*names):
    return [Path(name) for name in names]


@pytest.mark.parametrize(
    "names",
    [
        [f"frame_{n}.ply" for n in range(1, 13)],
        [f"p12_t{n}_v3.nii.gz" for n in (0, 9, 10, 100)],
        [f"cine/{n}/mesh.stl" for n in (1, 2, 11)],
        [f"T{n:03d}.XYZ" for n in (8, 9, 10)],
        ["f_1.ply", "F_2.stl", "f_10.obj"],
        [f"{n}_{40 * n}ms.ply" for n in (1, 2, 10)],
        [f"t0.{n}.ply" for n in (10, 25, 99)],
        [f"scan.{n}" for n in (1, 9, 10)],
    ],
)
@pytest.mark.parametrize("by_hand", [True, False])
def test_numbers_give_the_order_whatever_is_given(names, by_hand):
    files = paths(*names)
    for given in (files, files[::-1], sorted(files), [*files[1:], files[0]]):
        assert in_time(given, by_hand) == files


def test_files_with_names_of_their_own_keep_the_order_of_a_hand_alone():
    given = paths("rest.ply", "peak.ply", "late_2.ply")
    assert in_time(given, by_hand=True) == given
    with pytest.raises(InputError, match=r"their names follow 3 patterns: rest\.ply, peak\.ply, late_2\.ply"):
        in_time(given, by_hand=False)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("f_1.ply", "f_2.ply", "old_2.ply"), "follow 2 patterns: f_1.ply, old_2.ply"),
        (("f_1.ply", "f_10.ply", "f_2b.ply"), "follow 2 patterns"),
        (("f_1.ply", "f_01.ply"), "two files for one frame: 'f_0?1.ply' and 'f_0?1.ply'"),
        (("f_1.ply", "f_1.stl"), "two files for one frame"),
        (("a/f_1.ply", "a/f_1.ply"), "two files for one frame"),
        (("p1_f1.ply", "p1_f2.ply", "p2_f1.ply"), "differ in 2 numbers"),
        (("t1.5.ply", "t1.25.ply"), "behind the point have different lengths"),
        (("t1e-3.ply", "t1e-2.ply", "t1e-1.ply"), "powers of ten"),
    ],
)
@pytest.mark.parametrize("by_hand", [True, False])
def test_an_order_that_is_not_clear_is_refused(names, said, by_hand):
    with pytest.raises(InputError, match=said):
        in_time(paths(*names), by_hand)


def test_one_file_needs_no_order():
    assert in_time(paths("a_2.ply"), by_hand=False) == paths("a_2.ply")


def test_numbers_of_frames():
    assert frame_numbers(paths("p3_f2.ply", "p3_f10.nii.gz")) == [2, 10]
    for names in (("a.ply", "b.ply"), ("p1_f1", "p2_f2"), ("a_1.ply",), ("a_1.ply", "b_2.ply")):
        assert frame_numbers(paths(*names)) is None


def test_missing_numbers_are_ranges():
    assert missing_numbers([0, 1, 2]) == missing_numbers([5]) == ""
    assert missing_numbers([12, 0, 5, 7]) == "1 to 4, 6, 8 to 11"


def test_long_lists_are_shortened():
    assert names_of(paths(*(f"x/f_{n}" for n in range(7)))) == ", ".join(f"f_{n}" for n in range(7))
    assert names_of(paths(*(f"x/f_{n}" for n in range(8)))) == "f_0, f_1, f_2, ..., f_5, f_6, f_7"


def test_names_are_sorted_as_people_count():
    assert sorted(["b2", "b10", "B1", "a", "10", "9"], key=natural) == ["9", "10", "a", "B1", "b2", "b10"]
