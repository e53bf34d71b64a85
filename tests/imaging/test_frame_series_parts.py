"""Frames one by one: their slices, times, bases, noise and notes."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from quadriform.errors import InputError, OptionError
from quadriform.imaging import frame_series, image_points
from quadriform.imaging.frame_series import FrameSeries, drop_points_between_slices
from quadriform.imaging.image_points import BETWEEN, CAP
from quadriform.imaging.volume import Volume
from quadriform.point_sets import PointSet
from quadriform.shapes.landmarks import BasePlane, Landmarks
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric

GRID = np.diag([1.0, 1.0, 8.0, 1.0])
NUMBERS = np.array([0, BETWEEN, 1, CAP, BETWEEN, 2])
CLOUD = np.arange(18.0).reshape(6, 3)


def source(**more):
    made = {"cloud": PointSet(CLOUD), "slice_of_point": None, "image": None, "notes": (), "warnings": {}}
    return SimpleNamespace(**(made | {"space": "LPS", "unit": "mm"} | more))


def series(grids, numbers=NUMBERS):
    frames = FrameSeries()
    for grid in grids:
        noise = np.arange(6.0)[:, None, None] * np.eye(3)
        frames.add({"a": PointSet(CLOUD, CLOUD, noise=noise)}, ("LPS", "mm"))
        frames.slice_of_point.append({"a": numbers.copy()})
        frames.grids.append(grid)
    return frames


def test_points_between_slices_are_left_out_of_images_and_those_of_caps_stay():
    frames = series([GRID, GRID + 0.9e-3])
    drop_points_between_slices(frames)
    kept = NUMBERS != BETWEEN
    for frame, numbers in zip(frames.sets, frames.slice_of_point):
        np.testing.assert_array_equal(frame["a"].points, CLOUD[kept])
        np.testing.assert_array_equal(frame["a"].normals, CLOUD[kept])
        np.testing.assert_array_equal(frame["a"].noise[:, 0, 0], np.flatnonzero(kept))
        np.testing.assert_array_equal(numbers["a"], NUMBERS[kept])
    assert all(CAP in numbers["a"] for numbers in frames.slice_of_point)
    assert frames.notes == ["slices are taken along k, 8 apart; 4 of 12 points lie between two slices and are left out"]


def test_slices_of_contours_are_kept_as_they_are():
    frames = series([None, None])
    drop_points_between_slices(frames)
    assert len(frames.clouds[0]["a"]) == 6 and not frames.notes


@pytest.mark.parametrize("grids", [[GRID, GRID + 1.1e-3], [None, GRID], [GRID, None]])
def test_slices_of_other_grids_do_not_shift_together(grids):
    with pytest.raises(OptionError, match="the slices of frame 1 are not those of frame 0"):
        drop_points_between_slices(series(grids))


def test_slices_are_needed_in_all_frames():
    frames = series([GRID, GRID])
    frames.slice_of_point.pop()
    with pytest.raises(OptionError, match="needs slice numbers in all frames"):
        drop_points_between_slices(frames)


def test_frames_of_other_units_are_refused_and_sources_bring_what_they_know(monkeypatch):
    monkeypatch.setattr(frame_series, "common_space_and_unit", lambda sources: ("LPS", "mm"))
    frames, image = FrameSeries(), SimpleNamespace(world_from_voxel=GRID)
    noise = np.tile(np.eye(3), (6, 1, 1))
    with_all = source(
        cloud=PointSet(CLOUD, noise=noise, factor=10.0),
        slice_of_point=NUMBERS,
        image=image,
        notes=("one",),
        warnings={"BORDER_CUT": "x"},
    )
    frames.add_sources({"epi": with_all, "endo": source(notes=("two",))})
    assert frames.notes == ["one", "two"] and frames.warnings == {"BORDER_CUT": "x"}
    assert list(frames.sets[0]) == ["epi", "endo"] and list(frames.slice_of_point[0]) == ["epi"]
    assert frames.grids[0] is GRID
    frames.add_sources({"epi": source(slice_of_point=NUMBERS), "endo": source()})
    assert frames.grids[1] is None and len(frames.slice_of_point) == 2
    frames.add_sources({"epi": source(), "endo": source()})
    assert len(frames.slice_of_point) == 2 and len(frames.sets) == 3
    assert frames.sets[0]["epi"].noise is noise and frames.sets[0]["epi"].factor == 10
    with pytest.raises(InputError, match="first is in LPS mm, another in RAS mm"):
        frames.add({"epi": PointSet(CLOUD)}, ("RAS", "mm"))


def test_missing_numbers_are_times_and_the_cycle_ends_a_shortest_step_later():
    frames = FrameSeries(sets=[{}] * 4)
    frames.use_numbers([2, 3, 5, 9])
    assert frames.times.tolist() == [2, 3, 5, 9] and frames.period == 8
    assert "4, 6 to 8" in frames.notes[0]
    assert frames.with_times({}) == {"times": frames.times, "period": 8}
    assert "period" not in frames.with_times({"period": 5}) or frames.with_times({"period": 5})["period"] == 5
    none = FrameSeries()
    none.use_numbers([2, 3, 4])
    assert none.times is None and not none.notes
    none.use_numbers([2, 2**53 + 2])
    assert none.times is None
    other = FrameSeries(sets=[{}] * 3, times=np.arange(4.0))
    assert other.with_times({"a": 1}) == {"a": 1}


def base(z):
    return Landmarks(BasePlane(np.zeros(3), np.array([0, 0, float(z)])), "a face")


def test_bases_that_face_each_other_are_refused_and_missing_ones_drop_the_others():
    good = FrameSeries(landmarks=(base(1), base(1)))
    frame_series._check_ends(good)
    assert len(good.bases) == 2 and not good.notes
    with pytest.raises(InputError, match="frames 1, 2: the base was found at the other end"):
        frame_series._check_ends(FrameSeries(landmarks=(base(1), base(-1), base(-1))))
    partly = FrameSeries(landmarks=(Landmarks(), base(-1)))
    assert partly.bases[0] is None and partly.bases[1][1].tolist() == [0, 0, -1]
    frame_series._check_ends(partly)
    assert partly.landmarks == () and partly.bases is None and len(partly.notes) == 1


def test_a_folder_is_a_series_and_a_file_of_no_known_kind_is_itself(tmp_path):
    (tmp_path / "1.xyz").write_text("0 0 0\n", encoding="utf-8")
    (tmp_path / "2.xyz").write_text("0 0 0\n", encoding="utf-8")
    assert [p.name for p in frame_series.frame_files([tmp_path])] == ["1.xyz", "2.xyz"]
    odd = tmp_path / "odd.pdf"
    odd.write_bytes(b"")
    assert frame_series.frame_files([odd]) == [odd]


def test_slices_of_points_are_those_of_their_outlines():
    volume = Volume(np.zeros((4, 4, 9)), GRID)
    z = np.array([1.5, 2.0, 2.0009, 2.002, 2.5, 3.0, 5.0, 5.5]) * 8
    found = image_points.slice_numbers(volume, np.column_stack([z, z, z]))
    assert found.tolist() == [CAP, 2, 2, BETWEEN, BETWEEN, 3, 5, CAP]
    assert image_points.slice_axis(GRID) == 2 and image_points.slice_axis(np.diag([2.0, 2.0, 1.0, 1.0])) == 1
    assert image_points.slice_axis(np.diag([2.0, 2.0 * (1 - 0.9e-3), 1.0, 1.0])) == 1
    assert image_points.slice_axis(np.diag([2.0, 2.0 * (1 - 1.1e-3), 1.0, 1.0])) == 0


def test_the_part_of_a_surface_that_faces_its_middle():
    ball = Superquadric().mesh(8)
    inner = Mesh(0.5 * ball.vertices, ball.faces[:, ::-1])
    both = Mesh(
        np.concatenate([ball.vertices, inner.vertices]), np.concatenate([ball.faces, inner.faces + len(ball.vertices)])
    )
    assert image_points._fraction_facing_centre(ball) == 0
    assert image_points._fraction_facing_centre(inner) == 1
    assert image_points._fraction_facing_centre(both) == pytest.approx(0.2)
    assert image_points._fraction_facing_centre(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))) == 0
    moved = Mesh(both.vertices + 100, both.faces)
    assert image_points._fraction_facing_centre(moved) == pytest.approx(0.2)


@pytest.mark.parametrize("count", [1, 2])
def test_times_are_those_of_an_image_with_several_frames(monkeypatch, count):
    """A frame in a file of its own has none."""
    each = SimpleNamespace(surfaces={}, landmarks="landmarks")
    monkeypatch.setattr("quadriform.imaging.ventricle_files.read_ventricle_frames", lambda *of: [each] * count)
    monkeypatch.setattr("quadriform.imaging.reading.frame_times", lambda file: [0.0, 40.0])
    frames = FrameSeries()
    monkeypatch.setattr(FrameSeries, "add_sources", lambda self, sources: None)
    frame_series._add_ventricles(frames, "heart.nii.gz", None, None)
    assert frames.landmarks == ("landmarks",) * count
    assert (frames.times is None) if count == 1 else (list(frames.times) == [0.0, 40.0])


@pytest.mark.parametrize(("count", "asked"), [(1, [None]), (2, [0, 1])])
def test_frames_of_an_image_are_asked_for_by_number(monkeypatch, count, asked):
    """And one that has a single frame without."""
    seen = []
    monkeypatch.setattr("quadriform.imaging.reading.frame_count", lambda file: count)
    monkeypatch.setattr("quadriform.imaging.reading.frame_times", lambda file: [0.0, 40.0])
    monkeypatch.setattr(frame_series, "read_source", lambda file, options: seen.append(options.frame))
    monkeypatch.setattr(FrameSeries, "add_sources", lambda self, sources: None)
    frames = FrameSeries()
    frame_series._add_image(frames, "heart.nii.gz", {}, None)
    assert seen == asked
    assert (frames.times is None) if count == 1 else (list(frames.times) == [0.0, 40.0])


@pytest.mark.parametrize(("count", "notes"), [(1, 0), (2, 1), (3, 1)])
def test_the_order_of_several_files_is_noted(count, notes):
    frames = FrameSeries()
    frame_series.note_order(frames, [Path(f"frame_{n}.csv") for n in range(count)])
    assert len(frames.notes) == notes and all(note.startswith(f"{count} files") for note in frames.notes)
