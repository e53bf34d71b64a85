"""NRRD and MetaImage: what SimpleITK wrote comes back in the world; what is cut, NaN or of another kind is refused."""

import re
import sys

import numpy as np
import pytest
import SimpleITK
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
from quadriform.imaging.reading import frame_count, frame_times, read_volume

SUFFIXES = (".nrrd", ".nhdr", ".mha", ".mhd")
TURN = np.array([[0.8, -0.6, 0.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])  # det -1
AFFINE = np.eye(4)
AFFINE[:3, :3] = TURN * [1.5, 0.7, 8.0]
AFFINE[:3, 3] = [10, -20, 30]


@pytest.fixture
def values(rng):
    return rng.integers(-500, 900, (5, 4, 3)).astype(np.int16)


def write(path, values, compressed=False):
    """Whole numbers (i, j, k) or (i, j, k, frame)."""
    image = SimpleITK.GetImageFromArray(values.T, isVector=False)
    n = values.ndim
    direction, spacing, origin = np.eye(n), np.full(n, 25.0), np.zeros(n)
    direction[:3, :3], spacing[:3], origin[:3] = TURN, [1.5, 0.7, 8.0], AFFINE[:3, 3]
    image.SetDirection(direction.ravel().tolist())
    image.SetSpacing(spacing.tolist())
    image.SetOrigin(origin.tolist())
    SimpleITK.WriteImage(image, str(path), useCompression=compressed)
    return path


def nrrd(path, values, sizes=None, **fields):
    """A NRRD by hand; a field of None is left out."""
    lines = {
        "type": "short",
        "dimension": values.ndim,
        "space": "left-posterior-superior",
        "space dimension": None,
        "sizes": " ".join(map(str, sizes or values.shape)),
        "space directions": "(1,0,0) (0,2,0) (0,0,3)",
        "kinds": "domain domain domain",
        "endian": "little",
        "encoding": "raw",
        "space origin": "(10,20,30)",
    } | {name.replace("_", " "): value for name, value in fields.items()}
    text = "NRRD0004\n" + "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None) + "\n"
    path.write_bytes(text.encode() + values.tobytes(order="F"))
    return path


def refused(path, error, *said, **options):
    with pytest.raises(error) as caught:
        read_volume(path, **options)
    assert type(caught.value) is error
    assert "\n" not in str(caught.value)
    for words in (path.stem, *said):
        assert words in str(caught.value)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("suffix", SUFFIXES)
class TestWhatSimpleItkWrote:
    def test_comes_back_in_the_world(self, tmp_path, values, suffix, compressed):
        volume = read_volume(write(tmp_path / f"a{suffix}", values, compressed))
        assert_array_equal(volume.values, values)
        assert_allclose(volume.world_from_voxel, AFFINE, atol=1e-12)
        assert (volume.space, volume.unit, volume.values.dtype) == ("LPS", "mm", np.int16)

    def test_frames_come_back(self, tmp_path, rng, suffix, compressed):
        values = rng.integers(0, 99, (4, 5, 6, 3)).astype(np.uint8)
        path = write(tmp_path / f"a{suffix}", values, compressed)
        for frame in range(3):
            volume = read_volume(path, frame=frame)
            assert_array_equal(volume.values, values[..., frame])
            assert_allclose(volume.world_from_voxel, AFFINE, atol=1e-12)
        assert (frame_count(path), frame_times(path)) == (3, None)
        refused(path, MaskError, "(4, 5, 6, 3)", "frame=0 to frame=2")
        refused(path, OptionError, "frames 0 to 2", frame=3)

    def test_cut_anywhere_it_is_refused(self, tmp_path, values, suffix, compressed):
        path = write(tmp_path / f"a{suffix}", values, compressed)
        for file in tmp_path.iterdir():
            data = file.read_bytes()
            for length in range(0, len(data) - 1, 5):
                file.write_bytes(data[:length])
                with pytest.raises(QuadriformError):
                    read_volume(path)
            file.write_bytes(data)
        assert_array_equal(read_volume(path).values, values)

    def test_a_promise_beyond_the_bytes(self, tmp_path, values, suffix, compressed):
        path = write(tmp_path / f"a{suffix}", values, compressed)
        data = path.read_bytes()
        path.write_bytes(data.replace(b"5 4 3", b"5 4 4"))
        refused(path, FileFormatError, "cut short")
        path.write_bytes(data.replace(b"5 4 3", b"9000 9000 9000"))
        refused(path, FileLimitError, "budget")


class TestNrrd:
    def test_ras_becomes_lps(self, tmp_path, values):
        volume = read_volume(nrrd(tmp_path / "a.nrrd", values, space="right-anterior-superior"))
        assert_allclose(volume.points_world([[1, 1, 1]]), [[-11, -22, 33]])
        assert volume.space == "LPS"

    @pytest.mark.parametrize("space", [None, "scanner-xyz"])
    def test_without_an_anatomical_frame_the_space_is_unknown(self, tmp_path, values, space):
        path = nrrd(tmp_path / "a.nrrd", values, space=space, space_dimension=None if space else 3)
        volume = read_volume(path)
        assert volume.space == "unknown"
        assert_allclose(volume.points_world([[1, 1, 1]]), [[11, 22, 33]])

    def test_a_sheared_grid_keeps_its_shear(self, tmp_path, values):
        path = nrrd(tmp_path / "a.nrrd", values, space_directions="(1,0,0) (0.5,2,0) (0,0.25,3)")
        expected = np.array([[1, 0.5, 0, 10], [0, 2, 0.25, 20], [0, 0, 3, 30], [0, 0, 0, 1]])
        assert_allclose(read_volume(path).world_from_voxel, expected, atol=1e-12)

    @pytest.mark.parametrize("first", [True, False])
    def test_a_list_of_images_is_frames(self, tmp_path, values, first):
        """As 3D Slicer writes sequences."""
        frames = np.stack([values, values + 1], axis=0 if first else -1)
        axes = ["domain domain domain", "(1,0,0) (0,2,0) (0,0,3)"]
        kinds, directions = (f"{w} {a}" if first else f"{a} {w}" for a, w in zip(axes, ["list", "none"]))
        path = nrrd(tmp_path / "a.nrrd", frames, kinds=kinds, space_directions=directions)
        assert_array_equal(read_volume(path, frame=1).values, values + 1)
        assert_allclose(read_volume(path, frame=1).points_world([[1, 1, 1]]), [[11, 22, 33]])

    def test_colours_are_no_frames(self, tmp_path, values):
        colours = np.stack([values] * 3)
        path = nrrd(
            tmp_path / "a.nrrd", colours, kinds="RGB-color domain domain domain",
            space_directions="none (1,0,0) (0,2,0) (0,0,3)",
        )  # fmt: skip
        refused(path, MaskError, "3 values a voxel")

    @pytest.mark.parametrize(
        "fields, error, said",
        [
            ({"space_directions": "(1,0,0) (0,nan,0) (0,0,3)"}, FileFormatError, "cannot be read"),
            ({"space_directions": "(1,0,0) none (0,0,3)"}, AffineError, "spacing"),
            ({"space": None, "space_directions": None, "spacings": "1 nan 3", "space_origin": None}, AffineError, "sp"),
            ({"space": None, "space_directions": None, "space_origin": None}, AffineError, "spacing"),
            ({"space": "left-anterior-superior-time"}, FileFormatError, "expected one of"),
            ({"encoding": "ascii"}, FileFormatError, "raw or gzip"),
            ({"space_units": '"m" "m" "m"'}, FileFormatError, "expected mm"),
            ({"line_skip": "2"}, FileFormatError, "line skip"),
            ({"data_file": "slice%03d.raw 1 3 1"}, FileFormatError, "several files"),
            ({"data_file": "none.raw"}, InputError, "none.raw"),
            ({"type": "nonsense"}, FileFormatError, "cannot be read"),
        ],
    )
    def test_what_cannot_be_is_refused(self, tmp_path, values, fields, error, said):
        path = nrrd(tmp_path / "a.nrrd", values, **fields)
        with pytest.raises(error, match=said) as caught:
            read_volume(path)
        assert isinstance(caught.value, QuadriformError)

    @pytest.mark.parametrize("skip", [-1, 17])
    def test_bytes_before_the_voxels_are_skipped(self, tmp_path, values, skip):
        (tmp_path / "a.raw").write_bytes(bytes(17) + values.tobytes(order="F"))
        path = nrrd(tmp_path / "a.nhdr", np.empty((0, 0, 0)), values.shape, data_file="a.raw", byte_skip=skip)
        assert_array_equal(read_volume(path).values, values)
        (tmp_path / "a.raw").write_bytes(bytes(max(skip, 0)) + values.tobytes()[:-1])
        refused(path, FileFormatError, "cut short" if skip > 0 else "Skip")


class TestMeta:
    @pytest.mark.parametrize(
        "old, new, error, said",
        [
            (b"ElementSpacing = 1.5 ", b"ElementSpacing = nan ", AffineError, "spacing"),
            (b"ElementSpacing = 1.5 ", b"ElementSpacing = 0 ", AffineError, "spacing"),
            (b"ElementSpacing = ", b"Comment = ", AffineError, "spacing"),
            (b"BinaryData = True", b"BinaryData = False", FileFormatError, "BinaryData"),
            (b"ElementDataFile = LOCAL", b"ElementDataFile = LIST", FileFormatError, "several files"),
            (b"ElementDataFile", b"NoData", FileFormatError, "ElementDataFile"),
            (b"MET_SHORT", b"MET_NOTHING", FileFormatError, "cannot be read"),
            (b"NDims = 3", b"NDims =-3", FileFormatError, "expected NDims from 1 to 10, found '-3'"),
            (b"NDims = 3", b"NDims = 33", FileFormatError, "expected NDims from 1 to 10, found '33'"),
            (b"NDims = 3\n", b"NDims = 3\nNDims = -3\n", FileFormatError, "line 3: expected `key = value`"),
            (b"NDims = 3\n", b"NDims = 3\nNDims : -3\n", FileFormatError, "line 3: expected `key = value`"),
            (b"NDims = 3\n", b"", FileFormatError, "NDims"),
            (b"NDims = 3\n", b"NDims\x0b= 3\n", FileFormatError, "line 2: expected `key = value`"),
        ],
    )
    def test_what_cannot_be_is_refused(self, tmp_path, values, old, new, error, said):
        path = write(tmp_path / "a.mha", values)
        data = path.read_bytes()
        assert old in data
        path.write_bytes(data.replace(old, new))
        with pytest.raises(error, match=said):
            read_volume(path)

    def test_without_a_transform_the_space_is_unknown(self, tmp_path, values):
        path = write(tmp_path / "a.mha", values)
        lines = path.read_bytes().split(b"\n")
        path.write_bytes(b"\n".join(line for line in lines if not line.startswith(b"TransformMatrix")))
        assert read_volume(path).space == "unknown"

    def test_a_compressed_size_that_comes_first_is_refused(self, tmp_path, values):
        """SimpleITK passes over it, and leaves the voxels to chance."""
        path = write(tmp_path / "a.mha", values, compressed=True)
        head, size, rest = re.split(rb"(CompressedDataSize = \d+\n)", path.read_bytes(), maxsplit=1)
        path.write_bytes(size + head + rest)
        refused(path, FileFormatError, "expected CompressedData before CompressedDataSize")

    @pytest.mark.parametrize("off", [-1, 1])
    def test_another_compressed_size_is_refused(self, tmp_path, values, off):
        """SimpleITK would read so many bytes, and leave what they do not give to chance."""
        path = write(tmp_path / "a.mha", values, compressed=True)
        data = path.read_bytes()
        size = int(re.search(rb"CompressedDataSize = (\d+)", data)[1])
        path.write_bytes(data.replace(b"CompressedDataSize = %d" % size, b"CompressedDataSize = %d" % (size + off)))
        refused(path, FileFormatError, f"states {size + off} compressed bytes, found {size}")

    def test_a_flipped_byte_in_compressed_voxels_is_found(self, tmp_path, values):
        path = write(tmp_path / "a.mha", values, compressed=True)
        data = path.read_bytes()
        start = data.index(b"LOCAL\n") + 6
        for position in range(start + 2, len(data)):
            path.write_bytes(data[:position] + bytes([data[position] ^ 16]) + data[position + 1 :])
            try:
                assert_array_equal(read_volume(path).values, values)  # bits behind the last symbol say nothing
            except FileFormatError as error:
                assert "damaged" in str(error) or "cut short" in str(error)


def test_a_stream_that_expands_beyond_the_budget_is_stopped(tmp_path, values, monkeypatch):
    path = write(tmp_path / "a.nrrd", np.zeros((50, 50, 50), np.int16), compressed=True)
    monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", 250_001)
    assert read_volume(path).values.shape == (50, 50, 50)
    path.write_bytes(path.read_bytes().replace(b"50 50 50", b"50 50 49"))
    monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", 249_999)
    refused(path, FileLimitError, "expands")


def test_nan_voxels_are_refused_with_the_file(tmp_path):
    image = SimpleITK.GetImageFromArray(np.full((3, 3, 3), np.nan, np.float32))
    SimpleITK.WriteImage(image, str(tmp_path / "a.nrrd"))
    refused(tmp_path / "a.nrrd", MaskError, "27 of 27")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_text_of_another_kind(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text("x y z\n" * 100)
    refused(path, FileFormatError)


def test_a_missing_library_is_named_with_the_command(tmp_path, values, monkeypatch):
    path = write(tmp_path / "a.mha", values)
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    refused(path, InputError, "pip install 'quadriform[images]'")


def test_complex_voxels_are_refused(tmp_path):
    path = tmp_path / "complex.nrrd"
    SimpleITK.WriteImage(SimpleITK.Image([4, 4, 4], SimpleITK.sitkComplexFloat32), str(path))
    refused(path, MaskError, "expected one real number a voxel, found complex")


@pytest.mark.parametrize("suffix", [".mha", ".nrrd"])
def test_axes_of_space_and_time_that_are_mixed_are_refused(tmp_path, suffix):
    image, turn = SimpleITK.Image([4, 4, 4, 3], SimpleITK.sitkInt16), np.eye(4)
    turn[2:, 2:] = [[0.8, 0.6], [-0.6, 0.8]]
    image.SetDirection(turn.ravel().tolist())
    SimpleITK.WriteImage(image, str(tmp_path / f"mixed{suffix}"))
    refused(tmp_path / f"mixed{suffix}", AffineError, "space and time are mixed", frame=0)
