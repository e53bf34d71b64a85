"""Points from every format: what is accepted gives the same numbers, what is doubtful gives one typed error."""

import io
import os
import zipfile

import numpy as np
import pytest

from quadriform.errors import FileFormatError, FileLimitError, InputError, PointsError, QuadriformError
from quadriform.files import load, read_mesh, read_model
from quadriform.files.meshes import encode_mesh
from quadriform.files.models import read_moving_model
from quadriform.files.points import read_points, write_points

ROWS = np.array([[1.0, 2.0, 3.0], [-4.5, 5e-3, 6e7], [0.1, 0.2, 0.3]])


def npy(array, **options):
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def npy_claiming(header):
    text = header.encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def text(separator, end="\n"):
    return "".join(separator.join(repr(float(v)) for v in row) + end for row in ROWS)


@pytest.fixture
def write(tmp_path):
    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".txt", ".TXT"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   ", ", ", " ; "])
def test_every_separator_gives_the_same_values(write, suffix, separator):
    assert np.array_equal(read_points(write("p" + suffix, text(separator))), ROWS)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + text(","),
        text(",", "\r\n"),
        text(" ", "\r"),
        "x,y,z\n" + text(","),
        '"x","y","z"\n' + text(","),
        text(",").replace("1.0", '"1.0"'),
        "# points: 3\n" + text(" "),
        "# points: 3\n# X Y Z\n" + text(" "),
        "# contour 1\n# points: 2\n" + text(" "),
        "# made by hand\n\n" + text(" ") + "\n   \n# end",
        text(" ").replace("\n", "   # a point\n"),
        text(",").replace("\n", "  \n"),
        text(",").rstrip("\n"),
    ],
    ids=[
        "bom",
        "crlf",
        "cr",
        "header",
        "quoted header",
        "quoted number",
        "count",
        "count and names",
        "a count of its own",
        "comments",
        "end comments",
        "blanks",
        "no last line end",
    ],
)
def test_harmless_variants_are_accepted(write, content):
    assert np.array_equal(read_points(write("p.csv", content)), ROWS)


@pytest.mark.parametrize("content", ["1 2 3", "1\n1 2 3\n"], ids=["alone", "below its count"])
def test_one_row_keeps_its_shape(write, content):
    assert read_points(write("p.xyz", content)).tolist() == [[1.0, 2.0, 3.0]]


def test_a_header_chooses_the_columns_whatever_their_order(write):
    content = "label\tz\tx\tkind of point\ty\na\t3\t1\tapex\t2\n"
    assert read_points(write("p.txt", content)).tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1,5;2,5;3,5\n", "line 1: decimal commas"),
        ("1 2 3\n1,5 2 3\n", "line 2: decimal commas"),
        ("1,5 2,5 3,5\n", "line 1: decimal commas"),
        ("x;y;z\n1;2;3\n1,5;2;3\n", "line 3: decimal commas"),
        ("1,5,2,5,3,5\n", "line 1: expected 3 columns.*found 6"),
        ("1 2 3\n# note\n1 2\n", "line 3: expected 3 columns.*found 2"),
        ("1 2 3\n1 2 3 4\n", "line 2: expected 3 columns.*found 4"),
        ("1 2 3 0 0 1\n", "line 1: expected 3 columns.*x, y and z.*found 6"),
        ("1 2 3\n1 two 3\n", "line 2: expected numbers, found 'two'"),
        ("1;1,234.5;3\n", "line 1: expected numbers, found '1,234.5'"),
        ('1,2,3"\n', "line 1: expected numbers, found '3\"'"),
        ("1 1_000 3\n", "line 1: expected numbers, found '1_000'"),
        ("# only a comment\n", "no rows"),
        ("# points: 3\n1 2 3\n4 5 6\n", "says that it has 3 points, found 2"),
        ("x,y,z,rows\n1,2,3,2\n4,5,6,3\n", "says that it has 3 points, found 2"),
        ("X;Y;Z;Rows\n1;2;3;nan\n", "says that it has nan points, found 1"),
        ("\ufeff#points:1 \r\nx,y,z\r\n1,2,3\r\n4,5,6\r\n", "says that it has 1 points, found 2"),
        (b"\xff\xfe1\x00 \x00", "expected a text table"),
        (b"\x1f\x8b\x08\x00\x00\x00", "found gzip"),
        (b"1 2 3\n\x00\x00\n", "found binary data"),
    ],
)
def test_doubtful_text_is_refused_with_its_line(write, content, message):
    with pytest.raises(FileFormatError, match=message):
        read_points(write("p.txt", content))


@pytest.mark.parametrize(
    ("content", "message"),
    [("1 2 3\n1 nan 3\n", "index 1"), ("1 2 1e400\n", "index 0"), ("x y z\n", "no points")],
)
def test_text_without_usable_points_says_so(write, content, message):
    with pytest.raises(PointsError, match=message):
        read_points(write("p.txt", content))


@pytest.mark.parametrize("array", [ROWS, np.asfortranarray(ROWS), ROWS.astype(">f8"), ROWS.astype(np.float32)])
def test_arrays(write, array):
    assert np.array_equal(read_points(write("p.npy", npy(array))), array.astype(np.float64))


def test_an_array_of_python_2_is_read_without_a_warning(write):
    head = npy_claiming("{'descr':'<f8','fortran_order':False,'shape':(3L,3L)}")
    assert np.array_equal(read_points(write("p.npy", head + ROWS.tobytes())), ROWS)


def test_npz_takes_the_only_array_or_the_one_called_points(write):
    assert np.array_equal(read_points(write("a.npz", npz(anything=ROWS))), ROWS)
    assert np.array_equal(read_points(write("b.npz", npz(points=ROWS, other=np.zeros(2)))), ROWS)
    with pytest.raises(FileFormatError, match="found 2: a, b"):
        read_points(write("c.npz", npz(a=ROWS, b=ROWS)))


@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        (npy(np.array([{}], dtype=object), allow_pickle=True), FileFormatError, "type object"),
        (npy(np.zeros(2, dtype=[("x", "f8")])), FileFormatError, "columns named x, y and z, found 'x'"),
        (npy(np.zeros(2, dtype=[("x", [("y", "f8")])])), FileFormatError, "plain numbers"),
        (npy(np.array([["a", "b", "c"]])), PointsError, "real numbers"),
        (npy(ROWS)[:-1], FileFormatError, "declares 72 bytes.*found 71"),
        (npy(ROWS) + b"\0", FileFormatError, "declares 72 bytes.*found 73"),
        (npy(ROWS)[:20], FileFormatError, "expected a .npy array"),
        (npy_claiming("{'descr':'<f8','fortran_order':False,'shape':(2000000000,3)}"), FileLimitError, "budget"),
        (
            npy_claiming("{'descr':'<f8','fortran_order':False,'shape':(4294967296,4294967296,3)}"),
            FileLimitError,
            "bud",
        ),
        (npy_claiming("{'descr':'<f8','fortran_order':False,'shape':(-1,3)}"), FileFormatError, "negative"),
        (npy_claiming("{'descr':'<f8','fortran_order':False,'shape':(0,3)}"), PointsError, "no points"),
        (npy(ROWS[:, :2]), PointsError, r"expected an array of shape \(n, 3\), found \(3, 2\)"),
        (b"1 2 3\n", FileFormatError, "found text"),
        (npz(points=ROWS), FileFormatError, "found zip"),
    ],
)
def test_bad_arrays(write, content, error, message):
    with pytest.raises(error, match=message):
        read_points(write("p.npy", content))


def test_archives_that_are_none(write):
    whole = npz(points=ROWS)
    middle = len(npy(ROWS)) - 20  # inside the numbers: only the checksum can tell
    spoilt = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    for content in (spoilt, whole[: len(whole) // 2], b"PK", npy(ROWS), b"x" * 100):
        with pytest.raises(FileFormatError, match=r"expected a \.npz archive"):
            read_points(write("p.npz", content))


@pytest.mark.parametrize("name", ["../points.npy", "/points.npy", "points.txt"])
def test_archives_with_foreign_members_are_refused(write, name):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(name, npy(ROWS))
    with pytest.raises(FileFormatError, match=r"no plain \.npy"):
        read_points(write("p.npz", stream.getvalue()))


def test_archives_that_swell_are_refused_before_unpacking(write):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", b"\0" * (80 * 1024**2))
    with pytest.raises(FileFormatError, match="expected to unpack to at most 200 times"):
        read_points(write("p.npz", stream.getvalue()))


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".vtp"])
def test_meshes_give_each_vertex_once(write, mesh, suffix):
    points = read_points(write("m" + suffix, encode_mesh(mesh, suffix, "LPS", "mm")))
    assert points.shape == mesh.vertices.shape
    expected = mesh.vertices[np.lexsort(mesh.vertices.T.round(2))]
    assert np.allclose(points[np.lexsort(points.T.round(2))], expected, atol=1e-4 * np.ptp(mesh.vertices))


def test_a_cloud_in_a_mesh_format_is_read(write):
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property double {a}\n" for a in "xyz")
    assert np.array_equal(read_points(write("p.ply", header + "end_header\n" + text(" "))), ROWS)
    assert np.array_equal(
        read_points(write("p.obj", "".join("v " + line + "\n" for line in text(" ").split("\n")[:3]))), ROWS
    )


def test_where_there_is_no_file(tmp_path):
    missing = tmp_path / "a\nb.xyz"
    with pytest.raises(InputError, match=r"a\\nb\.xyz': there is no such file") as caught:
        read_points(missing)
    assert "\n" not in str(caught.value)
    (tmp_path / "folder.xyz").mkdir()
    with pytest.raises(InputError, match="found a folder"):
        read_points(tmp_path / "folder.xyz")
    (tmp_path / "empty.xyz").touch()
    with pytest.raises(FileFormatError, match="the file is empty"):
        read_points(tmp_path / "empty.xyz")
    os.mkfifo(tmp_path / "pipe.xyz")
    with pytest.raises(InputError, match="device or a pipe"):
        read_points(tmp_path / "pipe.xyz")
    with pytest.raises(InputError, match="cannot be read"):
        read_points(tmp_path / "empty.xyz" / "below.xyz")
    (tmp_path / "p.dat").write_text("0 0 0")
    with pytest.raises(FileFormatError, match=r"suffix '\.dat'; expected \.xyz"):
        read_points(tmp_path / "p.dat")
    with pytest.raises(QuadriformError, match="cannot be read"):
        read_points("nul\0.xyz")


@pytest.mark.parametrize("read", [read_points, load, read_mesh, read_model, read_moving_model])
def test_a_file_that_is_missing_has_no_wrong_suffix(tmp_path, read):
    with pytest.raises(InputError, match="there is no such file"):
        read(tmp_path / "scan0001")


def test_a_path_with_anything_in_it_is_read(tmp_path):
    path = tmp_path / "Herz groß 心 \n.xyz"
    path.write_text(text(" "))
    assert np.array_equal(read_points(path), ROWS)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_a_file_cut_anywhere_is_refused(write, suffix):
    whole = npy(ROWS) if suffix == ".npy" else npz(points=ROWS)
    for length in range(1, len(whole), 7):
        with pytest.raises(FileFormatError):
            read_points(write("cut" + suffix, whole[:length]))


def test_real_points(shared):
    frame = shared / "data/human_lv_guidepoints/frames/GPFile_000.txt"
    points = read_points(frame)
    assert len(points) == len(frame.read_text(encoding="utf-8").splitlines()) - 1
    assert points[0].tolist() == [-42.09469, -25.37305, -29.46908]
    assert read_points(shared / "data/organs/VH_F_left_ventricle_mm.ply").shape == (4913, 3)


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".npy", ".npz"])
def test_written_points_come_back_to_the_last_bit(tmp_path, rng, suffix):
    points = np.vstack([ROWS, rng.normal(size=(50, 3)) * 10.0 ** rng.integers(-300, 29, (50, 3))])
    write_points(points, tmp_path / f"p{suffix}")
    assert read_points(tmp_path / f"p{suffix}").tobytes() == points.tobytes()


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv"])
def test_written_text_cut_anywhere_is_refused(write, tmp_path, suffix):
    """In the middle of the last number too."""
    write_points(ROWS, tmp_path / f"p{suffix}")
    whole = (tmp_path / f"p{suffix}").read_bytes()
    for length in range(1, len(whole)):
        with pytest.raises((FileFormatError, PointsError)):  # a header alone is a table without points
            read_points(write("cut" + suffix, whole[:length]))


@pytest.mark.parametrize("number", ["%.6f", "%.18e"])
@pytest.mark.parametrize("count", ["", "9\n", "x y z\n"])
def test_a_table_of_others_cut_within_its_last_row_is_refused(write, rng, number, count):
    """With as many digits in each row, as `numpy.savetxt` writes them; the line end alone may be missing."""
    points = rng.normal(size=(9, 3)) * 30
    rows = [" ".join(number % value for value in row) for row in points]
    whole = count + "\n".join(rows)
    for lost in range(1, len(rows[-1])):
        with pytest.raises(FileFormatError):
            read_points(write("cut.txt", whole[:-lost]))
    np.testing.assert_allclose(read_points(write("whole.txt", whole)), points, atol=1e-6)


def test_a_last_number_of_fewer_digits_is_no_cut_where_that_is_usual(write):
    """The lines end, a comment follows, or each number has the digits that it needs."""
    points = [[1.0, 2.0, 3.25], [4.0, 5.0, 6.75], [7.0, 8.0, 9.5]]
    rows = "1 2 3.25\n4 5 6.75\n7 8 9.5"
    for content in (rows + "\n", rows + "\n# end", rows.replace("6.75", "6.750")):
        assert read_points(write("p.xyz", content)).tolist() == points


def test_the_count_is_a_comment_to_others(tmp_path):
    write_points(ROWS, tmp_path / "p.xyz")
    assert (tmp_path / "p.xyz").read_bytes().startswith(b"# points: 3\n")
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "p.xyz"), ROWS)


def test_a_csv_is_a_table_and_nothing_else(tmp_path):
    write_points(ROWS, tmp_path / "p.csv")
    assert (tmp_path / "p.csv").read_text().splitlines()[:2] == [
        "x,y,z,rows",
        ",".join(map(repr, ROWS[0].tolist())) + ",3",
    ]
    np.testing.assert_array_equal(np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)["y"], ROWS[:, 1])


def test_points_that_cannot_be_written(tmp_path):
    with pytest.raises(PointsError):
        write_points([[1, 2, np.nan]], tmp_path / "p.xyz")
    with pytest.raises(FileFormatError):
        write_points(ROWS, tmp_path / "p.ply")
    assert not list(tmp_path.iterdir())
