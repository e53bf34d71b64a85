import gzip
import os

import nibabel
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import (
    AffineError,
    FileFormatError,
    FileLimitError,
    InputError,
    MaskError,
    OptionError,
    QuadriformError,
)
from quadriform.imaging.reading import example_path, example_volume, frame_count, frame_times, read_volume

LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.fixture
def values(rng):
    return rng.integers(0, 900, (5, 4, 3)).astype(np.int16)


def refused(path, error, said, **options):
    with pytest.raises(error, match=said) as caught:
        read_volume(path, **options)
    assert type(caught.value) is error
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "A.NII.GZ"])
@pytest.mark.parametrize("dtype", ["i2", "u1", "f4", "f8"])
def test_what_nibabel_wrote_comes_back_in_lps(tmp_path, oblique, values, kind, name, dtype):
    image = kind(values.astype(dtype), oblique)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / name)
    volume = read_volume(tmp_path / name)
    assert_array_equal(volume.values, values.astype(dtype))
    assert_allclose(volume.world_from_voxel, LPS_FROM_RAS @ oblique, rtol=1e-6)
    assert (volume.space, volume.unit, volume.warnings) == ("LPS", "mm", {})


def test_left_is_positive(save_nifti, values):
    """A voxel 10 mm to the right, 20 anterior and 30 up in NIfTI's RAS."""
    affine = np.eye(4)
    affine[:3, 3] = [10, 20, 30]
    assert_allclose(read_volume(save_nifti(values, affine)).points_world([[0, 0, 0]]), [[-10, -20, 30]])


@pytest.mark.parametrize("code, scale, unit", [(1, 1000, "mm"), (2, 1, "mm"), (3, 0.001, "mm"), (0, 1, "unknown")])
def test_units_become_millimetres(save_nifti, values, oblique, code, scale, unit):
    volume = read_volume(save_nifti(values, oblique, xyzt_units=code + 8))
    expected = LPS_FROM_RAS @ oblique
    expected[:3] *= scale
    assert_allclose(volume.world_from_voxel, expected, rtol=1e-6)
    assert volume.unit == unit
    assert ("UNKNOWN_UNIT" in volume.warnings) == (unit == "unknown")


def test_the_qform_is_used_without_an_sform(tmp_path, values):
    image = nibabel.Nifti1Image(values, None)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # left-handed too
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = turn @ np.diag([2.0, 3.0, 4.0]), [5, 6, 7]
    image.set_qform(affine, code=1)
    image.set_sform(None, code=0)
    nibabel.save(image, tmp_path / "q.nii")
    assert_allclose(read_volume(tmp_path / "q.nii").world_from_voxel, LPS_FROM_RAS @ affine, atol=1e-6)


def test_a_qform_that_cannot_be_is_named_and_the_sform_used(tmp_path, values):
    image = nibabel.Nifti1Image(values, np.diag([2.0, 2, 2, 1]))
    image.set_sform(np.diag([2.0, 2, 2, 1]), code=1)
    image.header["qform_code"] = 1
    image.header["quatern_b"] = image.header["quatern_c"] = 1.0  # longer than one
    nibabel.save(image, tmp_path / "two.nii")
    volume = read_volume(tmp_path / "two.nii")
    assert_allclose(volume.world_from_voxel, np.diag([-2.0, -2, 2, 1]))
    assert "the qform is unusable" in volume.warnings["AFFINE_REPAIRED"]


@pytest.mark.parametrize("degrees, apart", [(0, "5 ("), (30, None)])
def test_a_qform_that_disagrees_is_named_and_the_sform_used(tmp_path, values, degrees, apart):
    image = nibabel.Nifti1Image(values, np.diag([2.0, 2, 2, 1]))
    moved = np.eye(4)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    moved[:3, :3] = 2 * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved[:3, 3] = [3, 0, 4]
    image.set_qform(moved, code=1)
    nibabel.save(image, tmp_path / "two.nii")
    volume = read_volume(tmp_path / "two.nii")
    assert_allclose(volume.world_from_voxel, np.diag([-2.0, -2, 2, 1]))
    sentence = volume.warnings["AFFINE_REPAIRED"]
    assert f"differ by {degrees} degrees" in sentence
    assert apart is None or f"image {apart}" in sentence


def test_a_qfac_of_zero_is_one(save_nifti, values):
    path = save_nifti(values, sform_code=0, qform_code=1, pixdim=[0, 2, 3, 4, 1, 1, 1, 1])
    assert_allclose(read_volume(path).world_from_voxel, np.diag([-2.0, -3.0, 4.0, 1.0]))


@pytest.mark.parametrize("dtype", ["<i2", ">i2"])
def test_either_byte_order_becomes_the_native_one(save_nifti, values, dtype):
    volume = read_volume(save_nifti(values.astype(dtype)))
    assert_array_equal(volume.values, values)
    assert volume.values.dtype.isnative


@pytest.mark.parametrize("slope, intercept", [(2.0, 0.0), (0.5, -10.0), (-1.0, 3.0)])
def test_slope_and_intercept_are_applied_once(save_nifti, values, slope, intercept):
    volume = read_volume(save_nifti(values, scl_slope=slope, scl_inter=intercept))
    assert_allclose(volume.values, values * slope + intercept, rtol=1e-15)


def test_a_slope_of_zero_means_none(save_nifti, values):
    assert_array_equal(read_volume(save_nifti(values, scl_slope=0, scl_inter=7)).values, values)


def test_labels_stay_whole_numbers(save_nifti, values):
    assert read_volume(save_nifti(values)).values.dtype == np.int16


@pytest.mark.parametrize("slope, intercept", [(np.inf, 0), (1, np.nan), (1, np.inf)])
def test_a_bad_slope_or_intercept_is_refused(save_nifti, values, slope, intercept):
    refused(save_nifti(values, scl_slope=slope, scl_inter=intercept), FileFormatError, "slope")


@pytest.mark.parametrize("intercept", [np.nan, 0, 7, np.inf])
def test_a_slope_that_is_no_number_means_none(save_nifti, values, intercept):
    """nibabel keeps "no slope" so in memory, programs that write its header as it is write that, and it reads it so."""
    path = save_nifti(values, scl_slope=np.nan, scl_inter=intercept)
    found = read_volume(path)
    assert_array_equal(found.values, values)
    assert_array_equal(nibabel.load(path).get_fdata(), values)
    assert found.values.dtype == values.dtype


@pytest.mark.parametrize("row", [[np.nan, 0, 0, 0], [0, 0, 0, 0]])
def test_an_unusable_sform_is_refused_with_both_forms(save_nifti, values, row):
    refused(save_nifti(values, srow_x=row), AffineError, r"sform \(code 1\) \[\[.*qform \(code 0\) \[\[")


def test_an_all_zero_sform_is_refused(save_nifti, values):
    zero = {f"srow_{axis}": [0, 0, 0, 0] for axis in "xyz"}
    refused(save_nifti(values, **zero), AffineError, "singular.*sform.*qform")


def test_a_file_without_codes_is_refused(save_nifti, values):
    refused(save_nifti(values, sform_code=0, qform_code=0), AffineError, "no form has a code.*sform.*qform")


@pytest.mark.parametrize("pixdim", [[1, 2, 0, 2, 1, 1, 1, 1], [1, 2, -1, 2, 1, 1, 1, 1], [1, np.nan, 1, 1, 1, 1, 1, 1]])
def test_a_voxel_size_that_cannot_be_is_not_repaired(save_nifti, values, pixdim):
    refused(save_nifti(values, sform_code=0, qform_code=1, pixdim=pixdim), AffineError, "qform")


def test_a_quaternion_that_cannot_be_is_refused(save_nifti, values):
    refused(save_nifti(values, sform_code=0, qform_code=1, quatern_b=5), AffineError, "qform")


class TestFrames:
    def test_the_requested_frame_is_read(self, save_nifti, rng):
        values = rng.integers(0, 99, (4, 5, 6, 3)).astype(np.uint8)
        path = save_nifti(values)
        for frame in range(3):
            assert_array_equal(read_volume(path, frame=frame).values, values[..., frame])

    def test_four_dimensions_need_a_frame(self, save_nifti):
        refused(
            save_nifti(np.zeros((4, 5, 6, 3), np.uint8)), MaskError, r"\(4, 5, 6, 3\).*frame=0 to frame=2, or .* track"
        )

    @pytest.mark.parametrize("frame", [3, -1, 1.5, "first"])
    def test_a_frame_that_is_not_there(self, save_nifti, frame):
        refused(save_nifti(np.zeros((4, 5, 6, 3), np.uint8)), OptionError, "frames 0 to 2", frame=frame)

    @pytest.mark.parametrize("shape", [(5, 4, 3, 1), (5, 4, 3, 1, 1)])
    def test_empty_dimensions_do_not_count(self, save_nifti, values, shape):
        assert_array_equal(read_volume(save_nifti(values.reshape(shape))).values, values)

    @pytest.mark.parametrize("shape", [(6, 6), (6,), (4, 4, 4, 1, 3)])
    def test_other_dimensions_are_refused_with_the_shape(self, save_nifti, shape):
        refused(save_nifti(np.zeros(shape, np.uint8)), MaskError, rf"\({shape[0]},.*\)")


class TestTimes:
    """Of NIfTI; those of the other formats are tested beside their readers."""

    @pytest.mark.parametrize("code, scale", [(8, 1000), (16, 1), (24, 0.001)])
    def test_are_milliseconds(self, save_nifti, code, scale):
        path = save_nifti(np.zeros((4, 5, 6, 3), np.uint8), xyzt_units=2 + code, pixdim=[1, 1, 1, 1, 0.5, 1, 1, 1])
        assert frame_count(path) == 3
        assert_allclose(frame_times(path), np.array([0, 0.5, 1]) * scale)

    def test_voxels_begin_where_the_header_states(self, save_nifti):
        fields = {"pixdim": [1, 1, 1, 1, 30, 1, 1, 1], "toffset": 12}
        assert_allclose(frame_times(save_nifti(np.zeros((4, 5, 6, 2)), xyzt_units=18, **fields)), [12, 42])

    @pytest.mark.parametrize("code, step", [(0, 30), (16, 0), (16, np.nan), (16, -1)])
    def test_are_not_guessed(self, save_nifti, code, step):
        path = save_nifti(np.zeros((4, 5, 6, 3), np.uint8), xyzt_units=2 + code, pixdim=[1, 1, 1, 1, step, 1, 1, 1])
        assert (frame_count(path), frame_times(path)) == (3, None)

    def test_a_still_image_has_none(self, save_nifti, values):
        path = save_nifti(values, xyzt_units=18)
        assert (frame_count(path), frame_times(path)) == (1, None)

    def test_a_damaged_file_is_refused(self, save_nifti, values):
        path = save_nifti(values)
        path.write_bytes(path.read_bytes()[:20])
        with pytest.raises(FileFormatError, match="cut short"):
            frame_count(path)


def test_nan_voxels_are_counted_and_the_file_named(save_nifti):
    values = np.ones((4, 4, 4), np.float32)
    values[:2, 0, 0] = np.nan
    refused(save_nifti(values), MaskError, r"image\.nii\.gz.*2 of 64 .*\(0, 0, 0\)")


@pytest.mark.parametrize("code", [32, 128])
def test_complex_and_colour_voxels_are_refused(save_nifti, code):
    refused(save_nifti(np.zeros((4, 4, 4), np.uint8), datatype=code), MaskError, "real number")


def test_an_unknown_data_type_is_refused(save_nifti, values):
    refused(save_nifti(values, datatype=1234), FileFormatError, "1234")


@pytest.mark.parametrize("dim", [[3, 5, -4, 3, 1, 1, 1, 1], [0, 5, 4, 3, 1, 1, 1, 1], [9, 5, 4, 3, 1, 1, 1, 1]])
def test_impossible_dimensions_are_refused(save_nifti, values, dim):
    refused(save_nifti(values, dim=dim), FileFormatError, "dimensions")


@pytest.mark.parametrize("offset", [0, np.nan, -352, 1e20])
def test_an_impossible_start_of_the_voxels_is_refused(save_nifti, values, offset):
    refused(save_nifti(values, vox_offset=offset), FileFormatError, "begin at byte")


@pytest.mark.parametrize("name", ["image.nii", "image.nii.gz"])
class TestStatedSizes:
    def test_beyond_the_budget(self, save_nifti, values, name):
        refused(
            save_nifti(values, name=name, dim=[3, 32767, 32767, 32767, 1, 1, 1, 1]), FileLimitError, "in the header"
        )

    def test_beyond_the_file(self, save_nifti, values, name):
        refused(save_nifti(values, name=name, dim=[3, 500, 500, 500, 1, 1, 1, 1]), FileFormatError, "the header states")

    def test_a_little_beyond_the_file(self, save_nifti, values, name):
        refused(save_nifti(values, name=name, dim=[3, 5, 4, 4, 1, 1, 1, 1]), FileFormatError, "cut short")


@pytest.mark.parametrize("name", ["image.nii", "image.nii.gz"])
def test_a_file_cut_anywhere_is_refused(save_nifti, values, tmp_path, name):
    data = save_nifti(values, name=name).read_bytes()
    path = tmp_path / f"cut_{name}"
    for length in range(1, len(data), 7):
        path.write_bytes(data[:length])
        refused(path, FileFormatError, "cut_image")


@pytest.mark.parametrize("name", ["image.nii", "image.nii.gz"])
def test_a_later_frame_that_is_cut_is_refused_too(save_nifti, name):
    path = save_nifti(np.zeros((4, 4, 4, 3), np.uint8), name=name)
    data = path.read_bytes()
    path.write_bytes(gzip.compress(gzip.decompress(data)[:-1]) if name.endswith("gz") else data[:-1])
    refused(path, FileFormatError, "cut short", frame=0)


def test_a_flipped_bit_in_a_gzip_is_refused_or_changes_nothing(save_nifti, values):
    path = save_nifti(values)
    good, volume = path.read_bytes(), read_volume(path)
    refusals = 0
    for position in range(len(good)):
        path.write_bytes(good[:position] + bytes([good[position] ^ 16]) + good[position + 1 :])
        try:
            found = read_volume(path)
        except QuadriformError:
            refusals += 1
        else:
            assert_array_equal(found.values, volume.values)
            assert_array_equal(found.world_from_voxel, volume.world_from_voxel)
    assert refusals > 0.9 * len(good)


def test_a_gzip_is_read_to_its_checksum(save_nifti, values):
    path = save_nifti(values)
    good = path.read_bytes()
    for position in range(len(good) - 8, len(good)):  # checksum and length
        path.write_bytes(good[:position] + bytes([good[position] ^ 1]) + good[position + 1 :])
        refused(path, FileFormatError, "damaged")


def test_a_gzip_that_expands_beyond_the_budget_is_stopped(save_nifti, values, monkeypatch):
    path = save_nifti(values)
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()) + bytes(10_000)))
    monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", 5_000)
    refused(path, FileLimitError, "expands")


class TestNames:
    def test_missing(self, tmp_path):
        refused(tmp_path / "none.nii.gz", InputError, "no such file")

    def test_folder(self, tmp_path):
        refused(tmp_path, InputError, "folder")

    def test_pipe(self, tmp_path):
        os.mkfifo(tmp_path / "pipe.nii")
        refused(tmp_path / "pipe.nii", InputError, "pipe")

    def test_empty(self, tmp_path):
        (tmp_path / "empty.nii.gz").touch()
        refused(tmp_path / "empty.nii.gz", FileFormatError, "empty")

    def test_unknown_suffix(self, tmp_path):
        (tmp_path / "image.png").write_bytes(b"\x89PNG")
        refused(tmp_path / "image.png", FileFormatError, r"\.nii\.gz")

    def test_plain_text(self, tmp_path):
        (tmp_path / "text.nii").write_text("x y z\n" * 100)
        refused(tmp_path / "text.nii", FileFormatError, "not a NIfTI")

    def test_gzip_named_plain(self, save_nifti, values, tmp_path):
        save_nifti(values).rename(tmp_path / "wrong.nii")
        refused(tmp_path / "wrong.nii", FileFormatError, "a gzip file")

    def test_plain_named_gzip(self, save_nifti, values, tmp_path):
        save_nifti(values, name="image.nii").rename(tmp_path / "wrong.nii.gz")
        refused(tmp_path / "wrong.nii.gz", FileFormatError, "no gzip file")

    def test_half_of_a_pair(self, save_nifti, values):
        refused(save_nifti(values, magic=b"ni1"), FileFormatError, "one of a pair.*called .hdr")


def test_the_example_is_what_nibabel_reads():
    volume = example_volume()
    image = nibabel.load(example_path())
    assert_array_equal(volume.values, np.asarray(image.dataobj)[..., 0])
    assert_allclose(volume.world_from_voxel, LPS_FROM_RAS @ image.affine, rtol=1e-12)
    assert volume.values.shape == (128, 96, 24)
    assert_allclose(volume.spacing, [2, 2, 2.2], rtol=1e-5)


def test_real_frames_are_what_nibabel_reads(shared):
    path = shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz"
    volume = read_volume(path, frame=11)
    assert_array_equal(volume.values, np.asarray(nibabel.load(path).dataobj[..., 11]))
    assert_allclose(volume.spacing, [0.82, 0.82, 5.0], rtol=1e-3)


def test_real_times_are_those_of_the_scanner(shared):
    assert_allclose(
        frame_times(shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz"), 31.55 * np.arange(20), rtol=1e-6
    )
