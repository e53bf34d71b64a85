"""A made series lies where its positions say; real ones lie where their NIfTI twins do."""

import shutil
import sys
import warnings
from pathlib import Path

import numpy as np
import pydicom
import pytest
from dicom_made import NAME, write_enhanced, write_nuclear, write_object, write_slice
from numpy.testing import assert_allclose, assert_array_equal
from pydicom.uid import RLELossless
from scipy.spatial import cKDTree

from quadriform.errors import (
    AffineError,
    FileFormatError,
    FileLimitError,
    InputError,
    MaskError,
    OptionError,
    QuadriformError,
)
from quadriform.imaging import formats
from quadriform.imaging.dicom import read_dicom
from quadriform.imaging.dicom_files import decoding
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.reading import frame_count, frame_times, read_volume
from quadriform.imaging.segmentation import Percentile

ALONG_ROW, ALONG_COLUMN = np.array([0.8, 0.6, 0.0]), np.array([0.0, 0.0, -1.0])
NORMAL = np.cross(ALONG_ROW, ALONG_COLUMN)
ORIGIN = np.array([-30.0, 12.0, 55.0])
SPACING = (1.5, 1.25)  # between rows, then within a row
GAP = 7.0
AFFINE = np.eye(4)
AFFINE[:3] = np.column_stack([1.25 * ALONG_ROW, 1.5 * ALONG_COLUMN, GAP * NORMAL, ORIGIN])


@pytest.fixture
def values(rng):
    """(i, j, k, frame)."""
    return rng.integers(-500, 900, (7, 5, 6, 4)).astype(np.int16)


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "series"
    made.mkdir()
    return made


def put(folder, image, k, name, **tags):
    """The image (i, j) in slice k."""
    place = {"position": ORIGIN + GAP * k * NORMAL, "along_row": ALONG_ROW, "along_column": ALONG_COLUMN}
    settings = {**place, "spacing": SPACING, "InstanceNumber": k + 1, **tags}
    write_slice(folder / name, image.T, **settings)


def still(folder, values, **tags):
    """The first frame, its files named against the order of the slices."""
    for k in range(values.shape[2]):
        put(folder, values[:, :, k, 0], k, f"I{99 - k}.dcm", **tags)
    return folder


def moving(folder, values, time=lambda k, f: {"TriggerTime": 10 + 30 * f}, skip=()):
    """All frames; instance numbers run against time."""
    for k, f in np.ndindex(values.shape[2:]):
        if (k, f) not in skip:
            tags = {"InstanceNumber": 100 * k + 50 - f, **time(k, f)}
            put(folder, values[:, :, k, f], k, f"k{k}f{f}.dcm", **tags)
    return folder


def refused(path, error, *said, exact=True, **options):
    with pytest.raises(error) as caught:
        read_dicom(path, **options)
    assert not exact or type(caught.value) is error
    message = str(caught.value)
    assert NAME not in message and "\n" not in message
    for words in said:
        assert words in message


class TestSeries:
    def test_voxels_lie_where_the_positions_say(self, folder, values):
        volume = read_volume(still(folder, values))
        assert_array_equal(volume.values, values[..., 0])
        assert_allclose(volume.world_from_voxel, AFFINE, atol=1e-9)
        assert (volume.space, volume.unit, volume.values.dtype) == ("LPS", "mm", np.int16)

    def test_thickness_location_and_stated_spacing_are_ignored(self, folder, values):
        volume = read_volume(still(folder, values, SliceThickness=3, SliceLocation=1, SpacingBetweenSlices=2))
        assert_allclose(volume.spacing, [1.25, 1.5, GAP])

    def test_one_file_gives_its_series(self, folder, values):
        still(folder, values)
        put(folder, values[:, :, 0, 1], 0, "other.dcm", series="9.9")
        assert_array_equal(read_volume(folder / "I97.dcm").values, values[..., 0])

    def test_names_without_suffix_and_other_files(self, folder, values):
        for file in still(folder, values).iterdir():
            file.rename(file.with_suffix(""))
        (folder / "README").write_text("about the images")
        (folder / "table.csv").write_bytes(b"\0\0")
        (folder / ".hidden").write_bytes(b"\0")
        assert_array_equal(read_volume(folder).values, values[..., 0])
        assert_array_equal(read_volume(folder / "I97").values, values[..., 0])

    def test_a_leaning_stack_keeps_its_lean(self, folder, values):
        step = GAP * NORMAL + 0.8 * ALONG_ROW
        for k in range(6):
            put(folder, values[:, :, k, 0], k, f"{k}.dcm", position=ORIGIN + k * step)
        assert_allclose(read_volume(folder).world_from_voxel[:3, 2], step, atol=1e-9)

    def test_positions_rounded_to_two_decimals_are_even(self, folder, values):
        for k in range(6):
            put(folder, values[:, :, k, 0], k, f"{k}.dcm", position=np.round(ORIGIN + 0.517 * k * NORMAL, 2))
        assert read_volume(folder).spacing[2] == pytest.approx(0.517, abs=0.005)

    def test_slope_and_intercept_are_applied_once(self, folder, values):
        for k in range(6):
            put(folder, values[:, :, k, 0], k, f"{k}.dcm", RescaleSlope=k + 0.5, RescaleIntercept=-k)
        expected = values[..., 0] * (np.arange(6) + 0.5) - np.arange(6)
        assert_allclose(read_volume(folder).values, expected, rtol=1e-15)

    def test_compressed_pixels_are_the_same(self, folder, values):
        for file in still(folder, values).iterdir():
            content = pydicom.dcmread(file)
            content.compress(RLELossless)
            content.save_as(file)
        assert_array_equal(read_volume(folder).values, values[..., 0])

    def test_pixels_in_lossless_jpeg(self, folder, values):
        """As hospitals' archives keep them."""
        import SimpleITK

        writer = SimpleITK.ImageFileWriter()
        writer.UseCompressionOn()
        writer.SetCompressor("JPEG")
        for k in range(6):
            image = SimpleITK.GetImageFromArray(values[:, :, k, 0].T[None])
            for tag, text in {"0020|0037": r"1\0\0\0\1\0", "0020|0032": rf"0\0\{k}", "0008|0060": "MR"}.items():
                image.SetMetaData(tag, text)
            image.SetMetaData("0020|000e", "1.2.3")
            writer.SetFileName(str(folder / f"{k}.dcm"))
            writer.KeepOriginalImageUIDOn()
            writer.Execute(image)
        syntax = pydicom.dcmread(folder / "0.dcm").file_meta.TransferSyntaxUID
        assert syntax.name.startswith("JPEG Lossless")
        assert_array_equal(read_volume(folder).values, values[..., 0])

    def test_reports_among_the_images_are_passed_by(self, folder, values):
        report = pydicom.dcmread(still(folder, values) / "I94.dcm")
        report.SOPClassUID = report.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.88.11"
        for keyword in ("Rows", "Columns", "PixelData"):
            delattr(report, keyword)
        report.save_as(folder / "report.dcm")
        assert_array_equal(read_volume(folder).values, values[..., 0])

    def test_nothing_of_the_patient_is_kept(self, folder, values):
        assert NAME not in repr(read_volume(still(folder, values)))


class TestFrames:
    def test_frames_are_sorted_by_trigger_time(self, folder, values):
        moving(folder, values)
        for f in range(4):
            assert_array_equal(read_volume(folder, frame=f).values, values[..., f])
        assert frame_count(folder) == 4
        assert_allclose(frame_times(folder), [10, 40, 70, 100])

    def test_heart_rates_may_differ_from_slice_to_slice(self, folder, values):
        moving(folder, values, lambda k, f: {"TriggerTime": (20 + 4 * k) * f})
        assert_array_equal(read_volume(folder, frame=3).values, values[..., 3])
        assert_allclose(frame_times(folder), 30 * np.arange(4))

    def test_without_trigger_times_the_clock_counts(self, folder, values):
        moving(folder, values, lambda k, f: {"AcquisitionTime": ("095958.5", "095959", "100000", "100100")[f]})
        for f in range(4):
            assert_array_equal(read_volume(folder, frame=f).values, values[..., f])
        assert frame_times(folder) is None

    def test_without_times_the_instance_number_counts(self, folder, values):
        moving(folder, values, lambda k, f: {"TriggerTime": 0, "InstanceNumber": 10 * f + k})
        assert_array_equal(read_volume(folder, frame=2).values, values[..., 2])
        assert (frame_count(folder), frame_times(folder)) == (4, None)

    def test_a_frame_must_be_chosen(self, folder, values):
        refused(moving(folder, values), MaskError, "(7, 5, 6, 4)", "frame=0 to frame=3")

    @pytest.mark.parametrize("frame", [4, -1, "first"])
    def test_a_frame_that_is_not_there(self, folder, values, frame):
        refused(moving(folder, values), OptionError, "frames 0 to 3", frame=frame)

    def test_a_still_series_has_one_frame(self, folder, values):
        assert (frame_count(still(folder, values)), frame_times(folder)) == (1, None)


class TestRagged:
    def test_a_missing_slice(self, folder, values):
        (still(folder, values) / "I97.dcm").unlink()
        refused(folder, InputError, "14 mm between I98.dcm", "and I96.dcm", "7 mm apart")

    def test_uneven_slices(self, folder, values):
        still(folder, values)
        put(folder, values[:, :, 3, 0], 3, "I96.dcm", position=ORIGIN + 3.2 * GAP * NORMAL)
        refused(folder, InputError, "uneven", "I96.dcm")

    def test_a_slice_beside_the_stack(self, folder, values):
        still(folder, values)
        put(folder, values[:, :, 3, 0], 3, "I96.dcm", position=ORIGIN + 3 * GAP * NORMAL + 2 * ALONG_ROW)
        refused(folder, InputError, "uneven", "I96.dcm")

    def test_a_slice_twice(self, folder, values):
        still(folder, values)
        shutil.copy(folder / "I97.dcm", folder / "copy.dcm")
        refused(folder, InputError, "ragged", "2 at", "I97.dcm", "copy.dcm")

    def test_every_slice_twice(self, folder, values):
        for file in list(still(folder, values).iterdir()):
            shutil.copy(file, folder / f"copy_{file.name}")
        refused(folder, InputError, "copies", "I99.dcm", "copy_I99.dcm")

    def test_two_positions_in_one_plane(self, folder, values):
        still(folder, values)
        put(folder, values[:, :, 3, 0], 3, "beside.dcm", position=ORIGIN + 3 * GAP * NORMAL + 2 * ALONG_ROW)
        refused(folder, InputError, "same plane", "I96.dcm", "beside.dcm")

    def test_another_size(self, folder, values):
        still(folder, values)
        put(folder, values[:-1, :, 0, 0], 9, "small.dcm")
        refused(folder, InputError, "sizes", "small.dcm", "(6, 5)", "(7, 5)")

    @pytest.mark.parametrize("tags", [{"along_row": (1, 0, 0)}, {"spacing": (1.5, 1.3)}])
    def test_another_orientation_or_pixel_size(self, folder, values, tags):
        still(folder, values)
        put(folder, values[:, :, 0, 0], 9, "turned.dcm", **tags)
        refused(folder, InputError, "orientations or pixel sizes", "turned.dcm")

    def test_one_slice_alone(self, folder, values):
        put(folder, values[:, :, 0, 0], 0, "alone.dcm")
        refused(folder, InputError, "one slice position alone")

    def test_a_missing_frame(self, folder, values):
        refused(moving(folder, values, skip={(2, 1)}), InputError, "ragged", "3 at", "k2f0.dcm, k2f2.dcm, k2f3.dcm")

    @pytest.mark.parametrize("gone", [1, 2, 3])
    def test_frames_missing_here_and_there(self, folder, values, gone):
        """As many images at each position; but they are not of the same phases."""
        skip = {(k, gone if k == 2 else 0) for k in range(6)}
        refused(moving(folder, values, skip=skip), InputError, "ragged", "trigger times", "k2f0.dcm")

    def test_frames_missing_between_the_same_first_and_last(self, folder, values):
        skip = {(k, 2 if k == 2 else 1) for k in range(6)}
        refused(moving(folder, values, skip=skip), InputError, "trigger times of 1 of 6 slices", "k2f0.dcm")


class TestSeveralSeries:
    def test_are_refused_by_name(self, folder, values):
        put(still(folder, values), values[:, :, 0, 0], 0, "scout.dcm", series="9.8.7", SeriesNumber=3)
        refused(folder, InputError, "2 series", "1.2.3 (series None, MR, 6 files", "9.8.7 (series 3, MR, 1 files")

    def test_one_is_chosen_by_name(self, folder, values):
        put(still(folder, values), values[:, :, 0, 0], 0, "scout.dcm", series="9.8.7")
        assert_array_equal(read_dicom(folder, series="1.2.3").values, values[..., 0])
        refused(folder, OptionError, "series='5'", "9.8.7", series="5")

    def test_a_folder_without_any(self, folder):
        refused(folder, InputError, "no DICOM images")


class TestObjectsWithoutImages:
    CLASSES = (
        ("1.2.840.10008.5.1.4.1.1.481.3", "RT Structure Set Storage"),
        ("1.2.840.10008.5.1.4.1.1.481.5", "RT Plan Storage"),
        ("1.2.840.10008.5.1.4.1.1.66.5", "Surface Segmentation Storage"),
        ("1.2.840.10008.5.1.4.1.1.88.11", "Basic Text SR Storage"),
        ("1.2.840.10008.5.1.4.1.1.88.33", "Comprehensive SR Storage"),
        ("1.2.840.10008.5.1.4.1.1.9.1.1", "12-lead ECG Waveform Storage"),
        ("1.2.840.10008.5.1.4.1.1.11.1", "Grayscale Softcopy Presentation State Storage"),
        ("1.2.840.10008.5.1.4.1.1.104.1", "Encapsulated PDF Storage"),
        ("1.2.840.10008.5.1.4.1.1.66.1", "Spatial Registration Storage"),
        ("1.2.840.10008.1.3.10", "Media Storage Directory Storage"),
        ("1.2.3.4.5.6", "1.2.3.4.5.6"),
    )

    @pytest.mark.parametrize("uid, name", CLASSES)
    def test_are_refused_by_the_name_of_their_class(self, folder, values, uid, name):
        write_object(folder / "object.dcm", uid)
        for path in (folder, folder / "object.dcm"):
            refused(path, InputError, name)

    def test_do_not_make_images_beside_them_fail(self, folder, values):
        """Of the same series or another, as scanners put them."""
        still(folder, values)
        for number, (uid, _) in enumerate(self.CLASSES):
            write_object(folder / f"object{number}", uid, series="1.2.3" if number % 2 else "9.9")
        for path in (folder, folder / "I97.dcm"):
            found = read_dicom(path)
            assert_array_equal(found.values, values[..., 0])
            assert found.warnings == {}

    def test_an_image_without_pixels_is_one_and_cut_short(self, folder, values):
        write_object(folder / "ct.dcm", "1.2.840.10008.5.1.4.1.1.2")
        refused(folder / "ct.dcm", FileFormatError, "CT Image Storage without pixels")

    def test_a_series_whose_files_cannot_be_read_is_not_the_neighbours_fault(self, folder, values):
        write_object(still(folder, values) / "ct.dcm", "1.2.840.10008.5.1.4.1.1.2", series="7.7")
        assert_array_equal(read_dicom(folder / "I97.dcm").values, values[..., 0])
        refused(folder, InputError, "2 series", "7.7 (1 files, none of which can be read)")

    @pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"])
    def test_a_file_without_the_letters_dicm_is_recognised_by_its_elements(self, folder, values, syntax):
        for file in list(still(folder, values).iterdir()):
            content = pydicom.dcmread(file)
            little, implicit = not syntax.endswith(".2.2"), syntax.endswith("1.2") and len(syntax) == 17
            content.PixelData = content.pixel_array.astype("<i2" if little else ">i2").tobytes()
            content.file_meta = pydicom.dataset.FileMetaDataset()
            without_meta = pydicom.Dataset(content)
            file.unlink()
            without_meta.save_as(file.with_suffix(""), implicit_vr=implicit, little_endian=little)
        assert_array_equal(read_volume(folder).values, values[..., 0])


class TestDamage:
    def test_a_slice_cut_anywhere_is_refused(self, folder, values):
        """Refused where it names its series; else left out, with a warning that names it."""
        file = still(folder, values) / "I94.dcm"  # the last of the stack: its absence would not be seen
        data = file.read_bytes()
        known = data.index(b"\x20\x00\x0e\x00UI") + 8 + len("1.2.3\0")
        for length in [*range(0, len(data) - 8, 23), len(data) - 1]:
            file.write_bytes(data[:length])
            if length < known:
                found = read_dicom(folder)
                assert "I94.dcm" in found.warnings["UNREADABLE_FILES"]
                assert_array_equal(found.values, values[:, :, :5, 0])
            else:
                with pytest.raises(QuadriformError, match="I94"):
                    read_dicom(folder)
                refused(folder / "I97.dcm", QuadriformError, "I94", exact=False)

    def test_an_unreadable_slice_is_named_where_the_gap_is(self, folder, values):
        (still(folder, values) / "I96.dcm").write_bytes(b"\0" * 300)
        refused(folder, InputError, "14 mm between", "I96.dcm")

    def test_pixels_cut_short(self, folder, values):
        file = still(folder, values) / "I94.dcm"
        file.write_bytes(file.read_bytes()[:-1])
        refused(folder, FileFormatError, "I94.dcm")

    def test_a_flipped_byte_is_a_typed_error_or_none(self, folder, values):
        file = still(folder, values[:, :, :2]) / "I98.dcm"
        data = file.read_bytes()
        for position in range(132, len(data), 3):
            file.write_bytes(data[:position] + bytes([data[position] ^ 0xA5]) + data[position + 1 :])
            try:
                read_dicom(folder)
            except QuadriformError as error:
                assert NAME not in str(error)

    @pytest.mark.parametrize("content", [b"", b"\0" * 50, b"x y z\n" * 50])
    def test_a_file_that_is_none(self, folder, values, content):
        """It is refused by itself, and does not make its neighbours fail."""
        (still(folder, values) / "junk.dcm").write_bytes(content)
        refused(folder / "junk.dcm", FileFormatError, "junk.dcm")
        for path in (folder, folder / "I97.dcm"):
            found = read_dicom(path)
            assert_array_equal(found.values, values[..., 0])
            assert "junk.dcm" in found.warnings["UNREADABLE_FILES"]

    @pytest.mark.parametrize(
        "tags, error, said",
        [
            ({"ImagePositionPatient": None}, AffineError, "ImagePositionPatient"),
            ({"ImageOrientationPatient": None}, AffineError, "ImageOrientationPatient"),
            ({"ImageOrientationPatient": [1, 0, 0, 0.1, 1, 0]}, AffineError, "right angle"),
            ({"PixelSpacing": None}, AffineError, "PixelSpacing"),
            ({"PixelSpacing": [1, 0]}, AffineError, "above 0"),
            ({"RescaleSlope": ""}, None, ""),
            ({"SamplesPerPixel": 3}, MaskError, "one real number"),
        ],
    )
    def test_a_header_that_cannot_be(self, folder, values, tags, error, said):
        still(folder, values, **tags)
        if error is None:
            assert_array_equal(read_dicom(folder).values, values[..., 0])
        else:
            refused(folder, error, said, "I94.dcm")

    def test_beyond_the_budget(self, folder, values, monkeypatch):
        sizes = [file.stat().st_size for file in still(folder, values).iterdir()]
        monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", max(sizes))
        assert read_dicom(folder).values.size
        monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", max(sizes) - 1)
        refused(folder, FileLimitError, "budget")

    def test_a_promise_beyond_the_budget(self, folder, values):
        refused(still(folder, values, Rows=60_000, Columns=60_000), FileLimitError, "budget")

    def test_a_missing_library_is_named_with_the_command(self, folder, values, monkeypatch):
        still(folder, values)
        monkeypatch.setitem(sys.modules, "pydicom", None)
        refused(folder, InputError, "pip install 'quadriform[images]'")


class TestEnhanced:
    @pytest.fixture
    def file(self, tmp_path, values):
        """Three slices downwards, two frames, the second first."""
        order = [(k, f) for f in (1, 0) for k in (2, 1, 0)]
        images = np.stack([values[:, :, k, f].T for k, f in order])
        positions = [ORIGIN + GAP * k * NORMAL for k, _ in order]
        slopes = [2 + k for k, _ in order]
        path = tmp_path / "enhanced.dcm"
        write_enhanced(path, images, positions, ALONG_ROW, ALONG_COLUMN, SPACING, [31 * f for _, f in order], slopes)
        return path

    def test_each_image_lies_where_its_group_says(self, file, values):
        for f in range(2):
            volume = read_volume(file, frame=f)
            assert_allclose(volume.values, values[:, :, :3, f] * [2.0, 3.0, 4.0] + 1)
            assert_allclose(volume.world_from_voxel, AFFINE, atol=1e-9)
        assert_allclose(frame_times(file), [0, 31])

    @pytest.mark.parametrize("count", [b"g ", b"\\ "])
    def test_a_count_that_is_none(self, file, count):
        data, head = file.read_bytes(), b"\x28\0\x08\0IS\2\0"
        file.write_bytes(data.replace(head + b"6 ", head + count))
        with pytest.raises(FileFormatError, match=r"enhanced.*cannot be decoded"):
            read_volume(file, frame=0)

    def test_a_group_too_few(self, file):
        content = pydicom.dcmread(file)
        del content.PerFrameFunctionalGroupsSequence[-1]
        content.save_as(file)
        refused(file, FileFormatError, "6 images", "5 functional groups")

    def test_two_files_of_one_series(self, file):
        shutil.copy(file, file.with_name("again.dcm"))
        refused(file.parent, InputError, "2 files of many images", "again.dcm, enhanced.dcm")

    def test_cut_short(self, file):
        file.write_bytes(file.read_bytes()[:-100])
        refused(file, FileFormatError, "enhanced.dcm", frame=0)


class TestNuclear:
    @pytest.mark.parametrize("step, low", [(-4.0, 88.0), (4.0, 100.0)])
    def test_the_sign_of_the_spacing_is_the_direction_of_the_slices(self, tmp_path, values, step, low):
        path = tmp_path / "nm.dcm"
        write_nuclear(path, values[:, :, :4, 0].transpose(2, 1, 0), (5, 6, 100), step, [1, 2, 3, 4], [1] * 4)
        volume = read_volume(path)
        assert_allclose(volume.world_from_voxel, [[4, 0, 0, 5], [0, 4, 0, 6], [0, 0, 4, low], [0, 0, 0, 1]])
        assert_array_equal(volume.values[:, :, :: int(np.sign(step))], values[:, :, :4, 0])

    def test_a_gated_study_has_frames(self, tmp_path, values):
        path, order = tmp_path / "nm.dcm", [(k, f) for f in range(3) for k in range(4)]
        images = np.stack([values[:, :, k, f].T for k, f in order])
        slices, slots = zip(*((k + 1, f + 1) for k, f in order))
        write_nuclear(path, images, (0, 0, 0), 4.0, slices, slots, frame_ms=55)
        assert_array_equal(read_volume(path, frame=2).values, values[:, :, :4, 2])
        assert_allclose(frame_times(path), [0, 55, 110])

    @pytest.mark.parametrize(
        "tags, error, said",
        [
            ({"SliceVector": None}, AffineError, "SliceVector"),
            ({"SpacingBetweenSlices": None}, AffineError, "SpacingBetweenSlices"),
            ({"EnergyWindowVector": [1, 2, 1, 2]}, MaskError, "EnergyWindowVector"),
            ({"DetectorInformationSequence": []}, AffineError, "ImageOrientationPatient"),
        ],
    )
    def test_what_is_no_single_reconstruction(self, tmp_path, values, tags, error, said):
        path = tmp_path / "nm.dcm"
        write_nuclear(path, values[:, :, :4, 0].transpose(2, 1, 0), (5, 6, 7), 4.0, [1, 2, 3, 4], [1] * 4, **tags)
        refused(path, error, said)

    def test_two_detectors_with_positions_are_refused(self, tmp_path, values):
        path, places = tmp_path / "nm.dcm", [pydicom.Dataset(), pydicom.Dataset()]
        for place in places:
            place.ImagePositionPatient, place.ImageOrientationPatient = [5, 6, 7], [1, 0, 0, 0, 1, 0]
        images = values[:, :, :4, 0].transpose(2, 1, 0)
        write_nuclear(path, images, (5, 6, 7), 4.0, [1, 2, 3, 4], [1] * 4, DetectorInformationSequence=places)
        refused(path, AffineError, "2 detectors with ImagePositionPatient")

    def test_images_without_positions(self, tmp_path, values):
        path = tmp_path / "movie.dcm"
        write_nuclear(
            path, values[:, :, :4, 0].transpose(2, 1, 0), (0, 0, 0), 4.0, [1, 2, 3, 4], [1] * 4,
            DetectorInformationSequence=None,
        )  # fmt: skip
        refused(path, AffineError, "no position of each")


def test_a_real_series_lies_where_its_nifti_does(shared):
    """The crop is frame 0 of the same scan; the slices' own SliceLocation would space them by 4.14 mm."""
    pig = shared / "data" / "pig_cine_mri"
    series, crop = read_volume(pig / "dicom_frame00"), read_volume(pig / "sax_cine_crop_4d.nii.gz", frame=0)
    assert_allclose(series.spacing[2], 5.0, atol=1e-3)
    corner = np.linalg.solve(series.world_from_voxel, crop.world_from_voxel[:, 3])[:3]
    assert_allclose(corner, np.round(corner), atol=1e-3)
    i, j, k = np.round(corner).astype(int)
    ni, nj, nk = crop.values.shape
    assert_array_equal(series.values[i : i + ni, j : j + nj, k : k + nk], crop.values)
    ends = np.array([[0, 0, 0], [ni - 1, nj - 1, nk - 1]])
    assert_allclose(series.points_world(np.add(ends, [i, j, k])), crop.points_world(ends), atol=2e-3)


@pytest.fixture
def spect(shared):
    """Pairs of DICOM and NIfTI files of the same three studies; which belong together is found by the voxels."""
    files = sorted((shared / "data" / "spect_mpi" / "dicom").iterdir())
    twins = [read_volume(shared / "data" / "spect_mpi" / "nifti" / f"mpi_rest_{n}.nii.gz") for n in (1, 2, 3)]
    volumes = [read_volume(file) for file in files]
    pairs = [(a, b) for a in volumes for b in twins if np.array_equal(a.values[:, :, ::-1], b.values)]
    assert len(pairs) == 3
    return pairs


def test_real_multi_frame_files_lie_where_their_niftis_do(spect):
    for dicom, nifti in spect:
        n = nifti.values.shape[2]
        ends = np.array([[0, 0, 0], [69, 0, 0], [0, 69, 0], [69, 69, n - 1]])
        assert_allclose(dicom.points_world(ends * [1, 1, -1] + [0, 0, n - 1]), nifti.points_world(ends), atol=1e-4)


def test_both_formats_give_the_same_surface(spect):
    options = {"select": Percentile(0.5, 99.9), "surface": "grey"}
    for dicom, nifti in spect:
        a = points_from_image(nifti, region=((17, 53), (12, 52), (10, 34)), **options).points
        b = points_from_image(dicom, region=((17, 53), (12, 52), (16, 40)), **options).points
        assert len(a) == len(b)
        assert cKDTree(a).query(b)[0].max() < 0.01
        assert cKDTree(b).query(a)[0].max() < 0.01


def test_warnings_of_the_decoder_do_not_reach_the_user():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with decoding(Path("I1.dcm")):
            warnings.warn("a value that breaks a rule of DICOM", stacklevel=1)
    assert caught == []


def test_a_first_element_is_known_by_two_capital_letters_or_a_short_length():
    """Without the preamble; a length of four bytes is that of a file without value representations."""

    def begins(after_tag, tag=b"\x08\x00\x05\x00"):
        return formats._begins_with_element((tag + after_tag).ljust(formats.PREAMBLE, b"\0"))

    assert begins(b"CS\x0a\0") and begins(b"\x0a\0\0\0")
    assert not begins(b"cs\x0a\1") and not begins(b"C1\x0a\1") and not begins(b"12\x0a\1")
    assert not begins(b"CS\x0a\0", tag=b"\x09\x09\x05\x00")
    assert not formats._begins_with_element(b"\x08\x00\x05\x00CS\x0a\0")  # too short for a file
