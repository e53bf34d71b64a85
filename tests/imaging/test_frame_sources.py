"""Frames from files: what is refused, and warnings of several files."""

import nibabel
import numpy as np
import pytest

from quadriform.errors import InputError, OptionError
from quadriform.imaging.frame_sources import Frames, frame_files, read_frames

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
    assert found.marks == {("LPS", "mm")} and found.grids == [None]
    assert found.clouds[0]["epi"].tolist() == [[1, 2, 3]] and found.slices[0]["epi"].tolist() == [1]


def test_frames_in_different_frames_of_the_world_are_refused(tmp_path):
    """Points that say nothing of theirs, then an image of a body in LPS and mm."""
    np.savetxt(tmp_path / "a.xyz", CLOUD)
    values = np.zeros((12, 12, 12), np.uint8)
    values[3:9, 3:9, 3:9] = 1
    image = nibabel.Nifti1Image(values, np.eye(4))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "b.nii")
    with pytest.raises(InputError, match="the frames differ in frame of the world or unit"):
        read_frames([tmp_path / "a.xyz", tmp_path / "b.nii"], [])


def test_warnings_of_one_kind_are_joined_and_said_once():
    frames = Frames()
    for text in ("the first", "the second", "the first"):
        frames.add_warnings({"PRECISION_LOSS": text})
    assert frames.warnings == {"PRECISION_LOSS": "the first; the second"}
