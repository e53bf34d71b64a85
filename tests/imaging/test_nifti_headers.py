"""Fields of NIfTI headers, one by one: sizes, times, scales, units, labels, and how much of a file is read."""

import io

import nibabel
import numpy as np
import pytest
from nibabel.nifti1 import Nifti1Extension

from quadriform.errors import FileFormatError, FileLimitError, MaskError
from quadriform.files import reading
from quadriform.imaging import nifti
from quadriform.imaging.nifti import nifti_times, read_nifti

AFFINE = np.diag([2.0, 3.0, 4.0, 1.0])


def header(**fields):
    made = nibabel.Nifti1Header()
    for name, value in fields.items():
        made[name] = value
    return made


@pytest.mark.parametrize(
    ("dim", "expected"),
    [
        ([3, 4, 5, 6, 9, 9, 9, 9], (4, 5, 6, 1)),
        ([4, 4, 5, 6, 7, 9, 9, 9], (4, 5, 6, 7)),
        ([5, 4, 5, 6, 7, 1, 9, 9], (4, 5, 6, 7)),
        ([7, 4, 5, 6, 1, 1, 1, 1], (4, 5, 6, 1)),
        ([2, 4, 5, 1, 1, 1, 1, 1], "three-dimensional image, found shape"),
        ([5, 4, 5, 6, 7, 2, 1, 1], "three-dimensional image, found shape"),
        ([0, 4, 5, 6, 7, 1, 1, 1], "impossible dimensions"),
        ([8, 4, 5, 6, 7, 1, 1, 1], "impossible dimensions"),
        ([3, 4, 0, 6, 7, 1, 1, 1], "impossible dimensions"),
    ],
)
def test_the_first_number_is_that_of_dimensions(dim, expected):
    if isinstance(expected, str):
        with pytest.raises((FileFormatError, MaskError), match=expected):
            nifti._shape(header(dim=dim))
    else:
        assert nifti._shape(header(dim=dim)) == expected


@pytest.mark.parametrize(
    ("slope", "offset", "expected"),
    [
        (0, 5, (1, 0)),
        (np.nan, np.nan, (1, 0)),
        (np.nan, 0, (1, 0)),
        (2, 5, (2, 5)),
        (1, 0, (1, 0)),
        (np.nan, 3, (1, 0)),
        (np.inf, 0, None),
        (2, np.nan, None),
    ],
)
def test_a_slope_of_zero_or_none_scales_nothing(slope, offset, expected):
    made = header(scl_slope=slope, scl_inter=offset)
    if expected is None:
        with pytest.raises(FileFormatError, match="slope"):
            nifti._scale(made)
    else:
        assert nifti._scale(made) == expected


@pytest.mark.parametrize(
    ("unit", "factor", "name"), [(1, 1000, "mm"), (2, 1, "mm"), (3, 1e-3, "mm"), (0, 1, "unknown"), (10, 1, "mm")]
)
def test_lengths_become_millimetres_of_lps(unit, factor, name):
    made = header(xyzt_units=unit, dim=[3, 4, 5, 6, 1, 1, 1, 1], sform_code=1)
    made.set_sform(AFFINE, 1)
    made["pixdim"][1:4] = [2, 3, 4]
    (affine, space, found), warnings = nifti._placement(made, (4, 5, 6, 1), None)
    np.testing.assert_allclose(affine, np.diag([-2, -3, 4, 1 / factor]) * factor)
    assert (space, found) == ("LPS", name) and ("UNKNOWN_UNIT" in warnings) == (name == "unknown")


@pytest.mark.parametrize(("code", "scale"), [(8, 1000.0), (16, 1.0), (24, 1e-3), (0, None)])
def test_times_are_steps_from_the_first_in_milliseconds(tmp_path, code, scale):
    image = nibabel.Nifti1Image(np.zeros((3, 3, 3, 4), np.int16), AFFINE)
    image.header["pixdim"][4], image.header["toffset"], image.header["xyzt_units"] = 20, 5, code + 2
    nibabel.save(image, tmp_path / "a.nii")
    count, times = nifti_times(tmp_path / "a.nii")
    assert count == 4
    if scale is None:
        assert times is None
    else:
        np.testing.assert_allclose(times, scale * np.array([5, 25, 45, 65]))
    image.header["pixdim"][4] = 0
    nibabel.save(image, tmp_path / "b.nii")
    assert nifti_times(tmp_path / "b.nii") == (4, None)
    nibabel.save(nibabel.Nifti1Image(np.zeros((3, 3, 3), np.int16), AFFINE), tmp_path / "c.nii")
    assert nifti_times(tmp_path / "c.nii") == (1, None)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize("frame", [0, 2, 3])
def test_a_frame_of_several_is_read_and_the_file_to_its_end(tmp_path, suffix, frame, rng):
    values = rng.integers(-9, 9, (3, 4, 5, 4)).astype(np.int16)
    image = nibabel.Nifti1Image(values, AFFINE)
    image.header.extensions.append(Nifti1Extension("comment", b"some text"))
    path = tmp_path / f"a{suffix}"
    nibabel.save(image, path)
    found = read_nifti(path, frame)
    np.testing.assert_array_equal(found.values, values[..., frame])
    assert found.values.dtype == np.int16
    scaled = nibabel.Nifti1Image(values, AFFINE)
    scaled.header.set_slope_inter(2, 7)
    nibabel.save(scaled, tmp_path / "s.nii")
    expected = np.asarray(nibabel.load(tmp_path / "s.nii").dataobj)[..., frame]
    np.testing.assert_allclose(read_nifti(tmp_path / "s.nii", frame).values, expected)
    if suffix == ".nii":
        path.write_bytes(path.read_bytes()[:-1])
        with pytest.raises(FileFormatError, match="cut short"):
            read_nifti(path, frame)


def test_no_more_than_the_budget_is_expanded(tmp_path, monkeypatch):
    path = tmp_path / "a.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.zeros((3, 4, 5), np.uint8), AFFINE), path)
    monkeypatch.setattr(reading, "MAX_BYTES", 500)
    assert read_nifti(path, None).values.shape == (3, 4, 5)
    import gzip

    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()) + bytes(501)))
    with pytest.raises(FileLimitError, match="more than the budget of 500 bytes"):
        read_nifti(path, None)


def test_a_stated_size_must_fit_the_file(tmp_path):
    path = tmp_path / "a.nii"
    path.write_bytes(bytes(100))
    nifti._check_size(100, path)
    with pytest.raises(FileFormatError, match="states 101 bytes, found 100"):
        nifti._check_size(101, path)
    packed = tmp_path / "a.nii.gz"
    packed.write_bytes(bytes(100))
    nifti._check_size(100 * nifti.MAX_EXPANSION, packed)
    with pytest.raises(FileFormatError):
        nifti._check_size(100 * nifti.MAX_EXPANSION + 1, packed)


def test_bytes_are_passed_over_up_to_the_end(monkeypatch):
    monkeypatch.setattr(nifti, "CHUNK", 4)
    stream = io.BytesIO(bytes(range(20)))
    assert nifti._skip(stream, 9) == 9 and stream.read(1) == b"\t"
    assert nifti._skip(stream, 0) == 0 and nifti._skip(stream, 99) == 10


@pytest.mark.parametrize(("start", "allowed"), [(352, True), (351, False), (400, True), (np.nan, False), (1e12, False)])
def test_voxels_begin_behind_the_header(start, allowed):
    made = header(vox_offset=start)
    if allowed:
        assert nifti._start(made, 352) == start
    else:
        with pytest.raises(FileFormatError, match="begin at byte"):
            nifti._start(made, 352)


def test_names_of_labels_are_plain_text_and_zero_is_none():
    text = b'<LabelTable><Label Key="0">none</Label><Label Key="3"><![CDATA[ a & b ]]></Label>'
    text += b'<Label Key="12">c &amp; d</Label></LabelTable>'
    found = nifti._label_table(text)
    assert [(each.name, each.number, each.values) for each in found] == [("a & b", 3, (3,)), ("c & d", 12, (12,))]


@pytest.mark.parametrize(("kind", "allowed"), [(np.uint8, True), (np.float32, True), (np.complex64, False)])
def test_voxels_are_real_numbers(kind, allowed):
    made = nibabel.Nifti1Header()
    made.set_data_dtype(kind)
    if allowed:
        assert nifti._dtype(made) == kind
    else:
        with pytest.raises(MaskError, match="one real number a voxel"):
            nifti._dtype(made)
    with pytest.raises(FileFormatError, match="unknown data type"):
        nifti._dtype(header(datatype=777))


def test_the_first_bytes_are_those_of_a_size_an_order_and_a_version(tmp_path):
    for image in (nibabel.Nifti1Image, nibabel.Nifti2Image):
        for order in ("<", ">"):
            path = tmp_path / "a.nii"
            made = image(np.arange(24, dtype=np.int16).reshape(2, 3, 4), AFFINE)
            made = image(made.dataobj, AFFINE, made.header.as_byteswapped(order))
            nibabel.save(made, path)
            np.testing.assert_array_equal(read_nifti(path, None).values, np.arange(24).reshape(2, 3, 4))
            path.write_bytes(path.read_bytes()[:100])
            with pytest.raises(FileFormatError, match="ends within its header"):
                read_nifti(path, None)
    path.write_bytes(b"abcd" + bytes(600))
    with pytest.raises(FileFormatError, match="not a NIfTI image; its first bytes are"):
        read_nifti(path, None)
