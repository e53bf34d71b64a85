"""Images of all formats on the terminal: told by content, and masks in place."""

import json

import numpy as np
import pytest
import SimpleITK
from dicom_made import write_segmentation, write_slice
from numpy.testing import assert_allclose

from quadriform.files import read_model
from quadriform.imaging.file_points import files_of
from quadriform.imaging.reading import read_volume

pytestmark = pytest.mark.usefixtures("blank_figures")
SPACING = (1.5, 1.2, 3.0)
ORIGIN = (-12.0, 30.0, 7.0)


def dicom_folder(folder, values):
    """Slices without a suffix."""
    folder.mkdir()
    for k in range(values.shape[2]):
        place = np.add(ORIGIN, [0, 0, SPACING[2] * k])
        write_slice(folder / f"IM{k:05d}", values[..., k].T, place, (1, 0, 0), (0, 1, 0), SPACING[1::-1])
    return folder


def by_simpleitk(path, values):
    image = SimpleITK.GetImageFromArray(values.T)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    SimpleITK.WriteImage(image, str(path))
    return path


WRITERS = {
    "nifti": lambda folder, values: by_simpleitk(folder / "a.nii", values),
    "packed nifti": lambda folder, values: by_simpleitk(folder / "a.nii.gz", values),
    "pair": lambda folder, values: by_simpleitk(folder / "a.hdr", values),
    "nrrd": lambda folder, values: by_simpleitk(folder / "a.nrrd", values),
    "metaimage": lambda folder, values: by_simpleitk(folder / "a.mha", values),
    "dicom folder": lambda folder, values: dicom_folder(folder / "slices", values),
    "dicom slice": lambda folder, values: dicom_folder(folder / "slices", values) / "IM00003",
}


@pytest.fixture
def grey(body, rng):
    """A body of 1000 with noise in whole numbers."""
    return np.rint((body == 1) * 1000 + rng.normal(0, 20, body.shape)).astype(np.int16)


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd"])
def test_a_mask_lies_where_its_image_lies(terminal, tmp_path, body, grey, writer, suffix):
    path = WRITERS[writer](tmp_path, grey)
    result = terminal("segment", path, "-o", f"mask{suffix}", "--json")
    assert result.code == 0 and "grey image" in json.loads(result.out)["notes"][0]
    mask = SimpleITK.ReadImage(str(tmp_path / f"mask{suffix}"))
    assert np.array_equal(SimpleITK.GetArrayFromImage(mask).T, body == 1)
    assert_allclose(mask.GetOrigin(), ORIGIN, atol=1e-5)
    assert_allclose(mask.GetSpacing(), SPACING, atol=1e-6)
    assert_allclose(mask.GetDirection(), np.eye(3).ravel(), atol=1e-6)


@pytest.mark.parametrize("writer, name", [("nrrd", "scan.dat"), ("metaimage", "scan"), ("nifti", "scan.img.bin")])
def test_every_format_is_recognised_by_its_content(terminal, tmp_path, grey, writer, name):
    path = WRITERS[writer](tmp_path, grey).rename(tmp_path / name)
    assert np.array_equal(read_volume(path).values, grey)
    info = json.loads(terminal("info", path, "--json").out)
    assert (info["kind"], info["voxels"]) == ("image", list(grey.shape))
    assert terminal("segment", path, "-o", "mask.nii").code == 0


def test_a_frame_that_is_unknown_stays_so(terminal, tmp_path, body):
    lines = ["NRRD0004", "type: uint8", "dimension: 3", f"sizes: {' '.join(map(str, body.shape))}", "spacings: 1 1 2"]
    values = (body == 1).astype(np.uint8)
    path = tmp_path / "a.nrrd"
    path.write_bytes("\n".join([*lines, "encoding: raw"]).encode() + b"\n\n" + values.tobytes(order="F"))
    refused = terminal("segment", path, "-o", "mask.nii")
    assert refused.code == 2 and "as .nrrd instead" in refused.err and not (tmp_path / "mask.nii").exists()
    assert terminal("segment", path, "-o", "mask.nrrd").code == 0
    back = read_volume(tmp_path / "mask.nrrd")
    assert back.space == "unknown" and np.array_equal(back.values, values)
    assert_allclose(back.spacing, [1, 1, 2])


def test_long_voxels_are_a_note_on_the_mask_as_on_the_fit(terminal, tmp_path, body):
    image = SimpleITK.GetImageFromArray((body.T == 1).astype(np.uint8))
    image.SetSpacing((1.0, 1.0, 6.0))
    SimpleITK.WriteImage(image, str(tmp_path / "long.nii"))
    result = terminal("segment", "long.nii", "-o", "mask.nii", "--strict=warned", "--json")
    record = json.loads(result.out)
    assert result.code == 0 and record["warnings"] == {}
    assert any(note.startswith("ANISOTROPIC: voxels of 1 x 1 x 6") for note in record["notes"])
    assert "note: " in result.err and "warning: " not in result.err


def test_segments_are_chosen_by_name(terminal, tmp_path, body):
    masks = {"liver": body == 1, "spleen": body == 2}
    write_segmentation(tmp_path / "a.dcm", masks, ORIGIN, SPACING[:2], SPACING[2])
    asked = terminal("segment", "a.dcm", "-o", "mask.nii")
    assert asked.code == 4 and "'liver' (1)" in asked.err and "--label" in asked.err
    for name, mask in masks.items():
        result = terminal("segment", "a.dcm", "--label", name, "-o", f"{name}.nii", "--json")
        assert json.loads(result.out)["voxels"] == mask.sum()
    assert json.loads(terminal("info", "a.dcm", "--json").out)["segments"] == {"liver": 1, "spleen": 2}


def test_the_slices_without_suffix_of_the_cases(terminal, shared):
    folder = shared / "cases" / "dicom" / "slices_without_suffix"
    if not folder.is_dir():
        pytest.skip("this folder is not beside the repository")
    assert json.loads(terminal("info", folder, "--json").out)["voxels"] == [48, 48, 24]
    assert terminal("segment", folder, "-o", "mask.nii.gz").code == 0
    structure = terminal("segment", folder.parent / "RS.dcm", "-o", "other.nii")
    assert structure.code == 4 and "RT Structure Set Storage" in structure.err


def test_a_folder_with_hidden_and_empty_files_is_fitted(terminal, tmp_path, grey, blank_figures):
    folder = dicom_folder(tmp_path / "slices", grey)
    (folder / ".hidden").write_bytes(b"")
    (folder / "EMPTY").write_bytes(b"")
    assert [file.name for file in files_of(folder)] == [f"IM{k:05d}" for k in range(grey.shape[2])]
    by_simpleitk(tmp_path / "a.hdr", grey)
    assert [file.name for file in files_of(tmp_path / "a.img")] == ["a.hdr", "a.img"]
    assert terminal("fit", folder, "-o", "out", "--box", "2,2,2").code == 0


def test_the_volume_of_a_label_is_that_within_the_image(terminal, nifti, body):
    """Half of an ellipsoid of 2 x 2 x 3 mm voxels: what lies outside the image is not added."""
    half = (body == 1).astype(np.uint8)[:15]
    record = json.loads(terminal("fit", nifti("half.nii", half), "--label", "1", "-o", "out", "--json").out)
    assert read_model("out/model.json").volume() == pytest.approx(12 * half.sum(), rel=0.03)
    assert "BORDER_CUT" in record["warnings"]
