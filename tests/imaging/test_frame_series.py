"""FrameSeries from files: what is refused, and warnings of several files."""

import nibabel
import numpy as np
import pytest

from quadriform.errors import InputError, OptionError, PointsError
from quadriform.imaging.file_points import Source
from quadriform.imaging.frame_series import FrameSeries, frame_files, read_frames
from quadriform.point_sets import PointSet

CLOUD = np.random.default_rng(1).normal(size=(20, 3))


def test_a_folder_without_a_frame_is_refused(tmp_path):
    (tmp_path / "notes.pdf").write_bytes(b"")
    with pytest.raises(InputError, match="no contours, points, meshes or images"):
        frame_files([tmp_path])


def test_contours_name_their_surfaces_themselves(tmp_path):
    path = tmp_path / "GPFile_000.txt"
    path.write_text("x\ty\tz\n", encoding="utf-8")
    with pytest.raises(OptionError, match=r"--surface does not go with contours such as 'GPFile_000\.txt'"):
        read_frames([path], ["epi=label:1"])


def test_contours_bring_their_walls_and_slices(tmp_path):
    path = tmp_path / "GPFile_000.txt"
    rows = [f"{k}\t2\t3\tSAX_LV_{wall}\t{k}\t1\t0" for k, wall in enumerate(("ENDOCARDIAL", "EPICARDIAL"))]
    header = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    found = read_frames([path], [])
    assert found.space_and_unit == ("LPS", "mm") and found.grids == [None]
    assert (found.sets[0]["epi"].factor, found.sets[0]["epi"].noise, found.sets[0]["epi"].solid) == (1.0, None, None)
    assert found.clouds[0]["epi"].tolist() == [[1, 2, 3]] and found.slice_of_point[0]["epi"].tolist() == [1]


def contours(path, frame, surfaces=("ENDOCARDIAL", "EPICARDIAL"), weight=1):
    """A GPFile with one point of each wall, whose x is the number of the frame."""
    rows = [f"{frame}\t2\t3\tSAX_LV_{wall}\t1\t{weight}\t{frame}" for wall in surfaces]
    path.write_text("\n".join(rows or [f"1\t2\t3\tRV_INSERT\t1\t1\t{frame}"]) + "\n", encoding="utf-8")
    return path


def test_missing_frames_of_contours_leave_their_times_out_with_a_note(tmp_path):
    for frame in (0, 1, 3, 12):
        contours(tmp_path / f"GPFile_{frame:03d}.txt", frame)
    found = read_frames(frame_files([tmp_path]), [])
    assert [cloud["endo"][0, 0] for cloud in found.clouds] == [0, 1, 3, 12]
    assert found.with_times({"box": (3, 3, 3)}) == {"box": (3, 3, 3), "times": found.times, "period": 13.0}
    assert found.times.tolist() == [0, 1, 3, 12]
    assert any("no frames with the numbers 2, 4 to 11" in note for note in found.notes)


def test_frames_without_the_ventricle_have_no_data(tmp_path):
    """Frame 1 shows the right ventricle alone; what is given by hand stays."""
    files = [contours(tmp_path / f"GPFile_{n}.txt", n, () if n == 1 else ("ENDOCARDIAL",), 0.5) for n in (0, 1, 2)]
    found = read_frames(files, [])
    assert [list(cloud) for cloud in found.clouds] == [["endo"], ["endo"]]
    assert found.times.tolist() == [0, 2] and found.with_times({"times": [1, 2]}) == {"times": [1, 2]}
    assert found.with_times({"period": None})["period"] is None
    assert any("frames without points of the left ventricle's contours: 1" in note for note in found.notes)
    assert any("weights of the contours other than 0 and 1 are not used" in note for note in found.notes)
    with pytest.raises(InputError, match="no points of the left ventricle's contours in any frame"):
        read_frames([files[1]], [])
    contours(files[2], 2)
    with pytest.raises(PointsError, match="frame 0: no points of LV_EPICARDIAL"):
        read_frames(files, [])


def test_the_frames_of_one_file_are_frames_of_a_motion(tmp_path):
    one, other = contours(tmp_path / "a.txt", 5), contours(tmp_path / "b.txt", 4)
    one.write_text(one.read_text() + other.read_text())
    found = read_frames([one], [])
    assert [cloud["epi"][0, 0] for cloud in found.clouds] == [4, 5] and found.times is None


def test_files_are_read_in_the_order_of_their_numbers(tmp_path):
    """Given as a shell lists them, from a folder, and with one of them missing."""
    for frame in range(1, 13):
        np.savetxt(tmp_path / f"frame_{frame}.xyz", CLOUD * frame)
    for inputs in ([tmp_path], sorted(tmp_path.iterdir())):
        found = read_frames(frame_files(inputs), [])
        assert [round(cloud["surface"][0, 0] / CLOUD[0, 0]) for cloud in found.clouds] == list(range(1, 13))
        assert found.times is None and "in the order of the numbers in their names: frame_1.xyz," in found.notes[0]
    (tmp_path / "frame_7.xyz").unlink()
    found = read_frames(frame_files([tmp_path]), [])
    assert found.times.tolist() == [1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12] and found.period == 12
    assert "no frames with the numbers 7:" in found.notes[1]


def test_contours_and_other_files_do_not_make_one_motion(tmp_path):
    np.savetxt(tmp_path / "a_1.xyz", CLOUD)
    with pytest.raises(InputError, match=r"holds contours, .* do not"):
        read_frames([tmp_path / "a_1.xyz", contours(tmp_path / "a_2.txt", 2)], [])


def test_frames_in_different_frames_of_the_world_are_refused(tmp_path):
    """Points that say nothing of theirs, then an image of a body in LPS and mm."""
    np.savetxt(tmp_path / "a.xyz", CLOUD)
    values = np.zeros((12, 12, 12), np.uint8)
    values[3:9, 3:9, 3:9] = 1
    image = nibabel.Nifti1Image(values, np.eye(4))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "b.nii")
    with pytest.raises(InputError, match="the frames differ in space or unit"):
        read_frames([tmp_path / "a.xyz", tmp_path / "b.nii"], [])


def test_warnings_of_one_kind_are_joined_without_repetition():
    frames = FrameSeries()
    for text in ("the first", "the second", "the first"):
        frames.add_sources({"endo": Source(PointSet(CLOUD), warnings={"PRECISION_LOSS": text})})
    assert frames.warnings == {"PRECISION_LOSS": "the first; the second"}


def test_conflicting_headers_are_warned_of_and_the_other_one_can_be_chosen(tmp_path):
    """A cine whose sform has voxels of 1 mm beside pixdim and qform of 2 mm."""
    values = np.zeros((10, 10, 10, 2), np.uint8)
    values[2:8, 2:8, 2:8] = 1
    image = nibabel.Nifti1Image(values, None)
    image.header.set_xyzt_units("mm", "sec")
    image.set_qform(np.diag([2.0, 2, 2, 1]), 1)
    image.set_sform(np.eye(4), 1)
    image.header["pixdim"][1:5] = [2, 2, 2, 0.1]
    nibabel.save(image, tmp_path / "cine.nii")
    for affine, size in ((None, 12), ("qform", 12), ("sform", 6)):
        found = read_frames([tmp_path / "cine.nii"], ["endo=label:1"], affine=affine)
        assert [np.ptp(cloud["endo"], axis=0).max() for cloud in found.clouds] == pytest.approx([size, size], abs=0.01)
        assert ("AFFINE_REPAIRED" in found.warnings) == (affine is None)
