"""Rows 59 and 61 to 64 of docs/reliability.md: archives and headers that are made to do harm."""

import gzip
import io
import tracemalloc
import zipfile

import nibabel
import numpy as np
import pytest

from quadriform.errors import FileFormatError, FileLimitError, InputError
from quadriform.files.points import read_points
from quadriform.imaging.reading import read_volume

MIB = 1024**2


def npy():
    stream = io.BytesIO()
    np.save(stream, np.eye(3))
    return stream.getvalue()


@pytest.fixture
def archive(tmp_path):
    """Writes an archive of members, each a name or a `ZipInfo`."""

    def write(*members):
        with zipfile.ZipFile(tmp_path / "p.npz", "w") as file:
            for member in members:
                file.writestr(member, npy())
        return tmp_path / "p.npz"

    return write


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_row_62_two_members_of_one_name(archive):
    with pytest.raises(FileFormatError, match="two members of one name"):
        read_points(archive("points.npy", "points.npy"))


def test_row_62_an_encrypted_member(archive):
    path = archive("points.npy")
    data = bytearray(path.read_bytes())
    for start, flags in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        data[data.index(start) + flags] |= 1
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=r"no plain \.npy"):
        read_points(path)


def test_row_62_a_link_is_but_the_name_it_holds(archive, tmp_path):
    """Nothing is unpacked to the disk: what a link points at is never opened."""
    link = zipfile.ZipInfo("points.npy")
    link.external_attr = 0o120777 << 16
    np.testing.assert_array_equal(read_points(archive(link)), np.eye(3))
    assert [path.name for path in tmp_path.iterdir()] == ["p.npz"]


def test_row_63_a_header_of_100_kb(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3), }" + b" " * 100_000 + b"\n"
    content = b"\x93NUMPY\x02\x00" + len(header).to_bytes(4, "little") + header + np.eye(3).tobytes()
    (tmp_path / "p.npy").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"expected a \.npy array"):
        read_points(tmp_path / "p.npy")


def test_row_64_a_device(tmp_path):
    (tmp_path / "zero.xyz").symlink_to("/dev/zero")
    with pytest.raises(InputError, match="a device or a pipe"):
        read_points(tmp_path / "zero.xyz")


def peak_of(call, error):
    """Bytes held at once until `call` is refused."""
    tracemalloc.start()
    try:
        with pytest.raises(error):
            call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_row_61_a_gzip_that_swells_takes_little_room(tmp_path, monkeypatch):
    """A whole image, and 400 MiB of nothing behind it."""
    image = nibabel.Nifti1Image(np.ones((3, 3, 3), np.uint8), np.eye(4)).to_bytes()
    (tmp_path / "image.nii.gz").write_bytes(gzip.compress(image + bytes(400 * MIB), 1))
    monkeypatch.setattr("quadriform.files.reading.MAX_BYTES", 300 * MIB)
    assert peak_of(lambda: read_volume(tmp_path / "image.nii.gz"), FileLimitError) < 64 * MIB


def test_row_61_an_archive_that_swells_takes_little_room(tmp_path):
    with zipfile.ZipFile(tmp_path / "p.npz", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("points.npy", bytes(300 * MIB))
    assert peak_of(lambda: read_points(tmp_path / "p.npz"), FileFormatError) < 64 * MIB


def test_row_59_a_promise_takes_no_room(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2000000000, 3), }\n"
    (tmp_path / "p.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(1000))
    assert peak_of(lambda: read_points(tmp_path / "p.npy"), FileLimitError) < MIB
