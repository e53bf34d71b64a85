"""Which transform of a NIfTI header is used; a body of known volume shows whether it is the right one."""

import nibabel
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import AffineError, FileFormatError, InputError, OptionError
from quadriform.imaging.reading import frame_times, read_volume
from quadriform.imaging.segmentation import Labels, segment

SIZES = (1.32, 1.32, 10.0)
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
TURN = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])


@pytest.fixture
def labels():
    values = np.zeros((12, 10, 6), np.uint8)
    values[2:9, 2:8, 1:5] = 3
    return values


def form(sizes=SIZES, turn=None, origin=(5, -6, 7)):
    affine = np.eye(4)
    affine[:3, :3] = (np.eye(3) if turn is None else turn) @ np.diag(sizes)
    affine[:3, 3] = origin
    return affine


@pytest.fixture
def write(tmp_path):
    """A file with these forms and codes; `pixdim` is what it says it is, whatever the forms."""

    def save(values, sform=None, qform=None, codes=(1, 1), pixdim=SIZES, name="image.nii.gz"):
        image = nibabel.Nifti1Image(values, None)
        image.header.set_xyzt_units("mm", "sec")
        image.set_qform(form() if qform is None else qform, codes[1])
        image.set_sform(form() if sform is None else sform, codes[0])
        image.header["pixdim"][1:4] = pixdim
        nibabel.save(image, tmp_path / name)
        return tmp_path / name

    return save


def refused(path, *said, error=AffineError, **options):
    with pytest.raises(error) as caught:
        read_volume(path, **options)
    assert type(caught.value) is error
    for words in said:
        assert words in str(caught.value)


def volume_ml(path, **options):
    found = segment(read_volume(path, **options), select=Labels((3,)))
    return found.mask.sum() * abs(np.linalg.det(found.volume.world_from_voxel[:3, :3])) / 1000


TRUE_ML = 7 * 6 * 4 * 1.32 * 1.32 * 10 / 1000


@pytest.mark.parametrize("sform", [form((1, 1, 1), origin=(0, 0, 0)), form((1.32, 10, 1.32)), form((2.64, 2.64, 20))])
def test_of_two_sizes_the_one_that_pixdim_supports_is_used(write, labels, sform):
    path = write(labels, sform)
    found = read_volume(path)
    assert_allclose(found.world_from_voxel, LPS @ form(), rtol=1e-6)
    said = found.warnings["AFFINE_REPAIRED"]
    assert (
        "sform (code 1, voxels of " in said and "qform (code 1, 1.32 x 1.32 x 10)" in said and "--affine sform" in said
    )
    assert volume_ml(path) == pytest.approx(TRUE_ML, rel=1e-5)
    assert_allclose(read_volume(path, affine="sform").world_from_voxel, LPS @ sform, rtol=1e-6)
    assert read_volume(path, affine="sform").warnings == {}


@pytest.mark.parametrize("qform", [form(turn=TURN), form(origin=(1, 2, 3))])
def test_of_two_poses_the_sform_is_used(write, labels, qform):
    path = write(labels, qform=qform)
    found = read_volume(path)
    assert_allclose(found.world_from_voxel, LPS @ form(), rtol=1e-6)
    assert "the sform is used" in found.warnings["AFFINE_REPAIRED"]
    assert_allclose(read_volume(path, affine="qform").world_from_voxel, LPS @ qform, rtol=1e-6, atol=1e-5)


def test_forms_that_agree_are_no_conflict(write, labels):
    rounded = form((1.3203, 1.3198, 10.0))
    for sform in (form(), rounded):
        assert read_volume(write(labels, sform)).warnings == {}


def test_mirror_images_are_refused(write, labels):
    path = write(labels, form((-1.32, 1.32, 10)))
    refused(path, "mirror images", "sform (code 1)", "qform (code 1)", "--affine sform", "--affine qform")
    assert_allclose(read_volume(path, affine="qform").world_from_voxel, LPS @ form(), rtol=1e-6)
    refused(write(labels, form((-1, 1, 1))), "mirror images")


def test_a_shear_in_one_of_them_is_refused(write, labels):
    sheared = form()
    sheared[:3, 1] = 1.32 * np.array([0.5, 0.75**0.5, 0])
    refused(write(labels, sheared), "sheared", "--affine sform", "--affine qform")


def test_a_sform_alone_must_have_the_sizes_of_pixdim(write, labels):
    path = write(labels, form((1, 1, 1)), codes=(1, 0))
    refused(path, "sform has voxels of 1 x 1 x 1", "pixdim 1.32 x 1.32 x 10", "affine='sform'", "affine='pixdim'")
    assert volume_ml(path, affine="pixdim") == pytest.approx(TRUE_ML, rel=1e-5)
    assert read_volume(path, affine="pixdim").space == "unknown"
    assert volume_ml(path, affine="sform") == pytest.approx(0.168, rel=1e-6)


@pytest.mark.parametrize("pixdim", [(0, 0, 0), (np.nan, 1, 1)])
def test_a_pixdim_without_sizes_contradicts_nothing(write, labels, pixdim):
    found = read_volume(write(labels, codes=(1, 0), pixdim=pixdim))
    assert_allclose(found.world_from_voxel, LPS @ form(), rtol=1e-6)
    refused(write(labels, codes=(1, 0), pixdim=pixdim), "cannot be used", affine="pixdim")


def test_sizes_alone(write, labels):
    path = write(labels, codes=(0, 0))
    refused(path, "no form has a code", "affine='pixdim'")
    assert volume_ml(path, affine="pixdim") == pytest.approx(TRUE_ML, rel=1e-5)


def test_a_form_without_a_code_cannot_be_chosen(write, labels):
    path = write(labels, codes=(1, 0))
    refused(path, "has no qform (code 0)", error=OptionError, affine="qform")
    refused(path, "'sform', 'qform', 'pixdim'", error=OptionError, affine="best")


def test_other_formats_have_one_transform(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\n\n")
    refused(tmp_path / "a.nrrd", "no NIfTI image", error=OptionError, affine="sform")


class TestPairs:
    @pytest.mark.parametrize("name", ["p.hdr", "p.img"])
    def test_either_file_names_the_image(self, tmp_path, labels, name):
        image = nibabel.Nifti1Pair(np.stack([labels, labels * 2], axis=-1), form())
        image.header.set_xyzt_units("mm", "sec")
        image.header["pixdim"][4] = 0.5
        nibabel.save(image, tmp_path / "p.img")
        found = read_volume(tmp_path / name, frame=1)
        assert_array_equal(found.values, labels * 2)
        assert_allclose(found.world_from_voxel, LPS @ form(), rtol=1e-6)
        assert_allclose(frame_times(tmp_path / name), [0, 500])

    def test_the_other_file_is_missing_or_short(self, tmp_path, labels):
        nibabel.save(nibabel.Nifti1Pair(labels, form()), tmp_path / "p.img")
        voxels = tmp_path / "p.img"
        voxels.write_bytes(voxels.read_bytes()[:-1])
        refused(tmp_path / "p.hdr", "cut short", error=FileFormatError)
        voxels.unlink()
        refused(tmp_path / "p.hdr", "p.img", error=InputError)

    def test_analyze_has_no_orientation_and_is_refused(self, tmp_path, labels):
        nibabel.save(nibabel.AnalyzeImage(labels, form()), tmp_path / "old.img")
        for name in ("old.img", "old.hdr"):
            refused(tmp_path / name, "Analyze", error=FileFormatError)


def test_the_acdc_file_has_its_true_volume(shared):
    file = shared / "cases" / "acdc" / "patient100_frame01_gt.nii.gz"
    if not file.is_file():
        pytest.skip("this file is not beside the repository")
    assert volume_ml(file) == pytest.approx(109.2, abs=0.1)
