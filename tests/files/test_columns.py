"""Which columns are x, y and z: names decide, in tables, arrays and data frames; what nobody can tell is refused."""

import io

import numpy as np
import pytest

import quadriform as qf
from quadriform.columns import chosen_columns, columns_of
from quadriform.errors import ColumnsError, FileFormatError, OptionError, PointsError
from quadriform.files.points import read_point_set
from quadriform.point_sets import point_set

ROWS = np.array([[1.0, 2.0, 30.0], [-4.5, 5.25, 6.0], [0.125, 7.0, -8.0], [9.0, 10.0, 11.5]])
FIELDS = "field.point.x,field.point.y,field.point.z"
"""As rostopic names them."""
NORMALS = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0.6, -0.8], [0, 0, -1.0]])


def lines(*columns, separator=","):
    return "".join(separator.join(map(str, row)) + "\n" for row in np.column_stack(columns).tolist())


@pytest.fixture
def write(tmp_path):
    def write(content, name="p.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


NAMES = {
    "Z [mm],Y [mm],X [mm]": ("zyx", "mm"),
    "axis-0,axis-1,axis-2": ("zyx", "unknown"),
    "z,x,y": ("zxy", "unknown"),
    "X,Z,Y": ("xzy", "unknown"),
    "y_mm,z_mm,x_mm": ("yzx", "mm"),
    "pos_z,pos_y,pos_x": ("zyx", "unknown"),
    "Position Z,Position Y,Position X": ("zyx", "unknown"),
    "Points:2,Points:1,Points:0": ("zyx", "unknown"),
    "Points_0,Points_2,Points_1": ("xzy", "unknown"),
    "Z (m),Y (m),X (m)": ("zyx", "m"),
    "z/mm,y/mm,x/mm": ("zyx", "mm"),
    "z in mm,y in mm,x in mm": ("zyx", "mm"),
    '"z","y","x"': ("zyx", "unknown"),
    "z [\u00b5m],y [um],x [\u03bcm]": ("zyx", "um"),
    "z [nm],y [nm],x [nm]": ("zyx", "nm"),
    "z (px),y (px),x (px)": ("zyx", "unknown"),
    "zcoord,ycoord,xcoord": ("zyx", "unknown"),
    "POINT_Z,POINT_Y,POINT_X": ("zyx", "unknown"),
}


@pytest.mark.parametrize("header", NAMES)
@pytest.mark.parametrize("more", ["", "intensity", "index"])
def test_names_decide_whatever_their_order(write, header, more):
    order, unit = NAMES[header]
    columns = [ROWS[:, "xyz".index(axis)] for axis in order]
    if more == "intensity":
        header, columns = f"{header},{more}", [*columns, np.arange(4)]
    elif more == "index":
        header, columns = f",{header}", [np.arange(4), *columns]
    found = read_point_set(write(header + "\n" + lines(*columns)))
    assert np.array_equal(found.points, ROWS) and found.unit == unit


def test_a_comment_after_the_first_row_names_nothing(write):
    found = read_point_set(write(lines(ROWS, separator=" ") + "# z y x\n", "p.txt"))
    np.testing.assert_array_equal(found.points, ROWS)


@pytest.mark.parametrize(
    ("comment", "order", "unit"),
    [
        ("# z y x", "zyx", "unknown"),
        ("# z,y,x", "zyx", "unknown"),
        ("// Z Y X", "zyx", "unknown"),
        ("//X Z Y", "xzy", "unknown"),
        ("% z y x", "zyx", "unknown"),
        ("# columns: z y x", "zyx", "unknown"),
        ("# z y x [mm]", "zyx", "mm"),
        ("# z [m] y [m] x [m]", "zyx", "m"),
        ("# scanned by hand\n# z y x\n# unit: mm", "zyx", "mm"),
        ("# x y z", "xyz", "unknown"),
        ("# points in the order x y z", "xyz", "unknown"),
        ("# made at 10:15", "xyz", "unknown"),
    ],
)
def test_a_comment_before_the_rows_names_them_too(write, comment, order, unit):
    columns = [ROWS[:, "xyz".index(axis)] for axis in order]
    found = read_point_set(write(comment + "\n" + lines(*columns, separator=" "), "p.txt"))
    assert np.array_equal(found.points, ROWS) and found.unit == unit


@pytest.mark.parametrize(
    "header",
    [
        "X,Y,Z,R,G,B,Nx,Ny,Nz",
        "x,y,z,red,green,blue,normal_x,normal_y,normal_z",
        "Points:0,Points:1,Points:2,r,g,b,Normals:0,Normals:1,Normals:2",
        "# x y z r g b nx ny nz",
        "//X Y Z R G B Nx Ny Nz",
    ],
)
def test_normals_are_found_among_other_columns(write, header):
    colours = np.full((4, 3), 200)
    separator = "," if "," in header else " "
    found = read_point_set(write(header + "\n" + lines(ROWS, colours, 3 * NORMALS, separator=separator)))
    assert np.array_equal(found.points, ROWS)
    np.testing.assert_allclose(found.normals, NORMALS, atol=1e-15)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b,c\n" + lines(ROWS), "expected columns named x, y and z, found 'a', 'b', 'c'.*--columns"),
        ("x,y,slice\n" + lines(ROWS), "found 'x', 'y', 'slice'"),
        ("R,A,S\n" + lines(ROWS), "found 'R', 'A', 'S'"),
        ("lon,lat,height\n" + lines(ROWS), "found 'lon', 'lat', 'height'"),
        ("centroid-0,centroid-1,centroid-2\n" + lines(ROWS), "found 'centroid-0'"),
        ("axis-0,axis-1,axis-2,axis-3\n" + lines(ROWS, ROWS[:, :1]), "found 'axis-0'"),
        ("x,X,y,z\n" + lines(ROWS, ROWS[:, :1]), "two columns, 'x' and 'X', could be x"),
        ("pos_x,x_pos,y,z\n" + lines(ROWS, ROWS[:, :1]), "could be x"),
        ("x [mm],y [m],z [mm]\n" + lines(ROWS), "one unit for x, y and z, found x in mm, y in m, z in mm"),
        ("x,y,z [mm]\n" + lines(ROWS), "x in no unit, y in no unit, z in mm"),
        ("# unit: m\nx [mm],y [mm],z [mm]\n" + lines(ROWS), "one unit of length, found m and mm"),
        ("# zyx\n" + lines(ROWS), "comment 'zyx' may say that the columns are not x, y, z"),
        ("# rows of z y x, in voxels\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        ("# coordinates (z,y,x) in voxels\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        ("# points [Z/Y/X]\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        ("# order: z-y-x\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        ("# indices k, j, i\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        ("# slice row column\n" + lines(ROWS), "may say that the columns are not x, y, z"),
        (",0,1,2\n" + lines(np.arange(4), ROWS), "the row , 0, 1, 2 may be .*--columns 0,1,2"),
        ("0,1,2\n" + lines(ROWS.astype(int)), "the row 0, 1, 2 may be a point .*of a point.* --columns x,y,z"),
        ("x,y,z,x,y,z\n" + lines(ROWS, ROWS), "two columns, 'x' and 'x', could be x; give them different names"),
        ("# z y x\n# x y z\n" + lines(ROWS), "two comments name the columns differently"),
        ("0,1,2\n" + lines(ROWS), "the row 0, 1, 2 may be a point or the numbers of the columns"),
        (lines(ROWS, NORMALS), "found 6 columns without names; the last three look like unit normals.*x,y,z,nx,ny,nz"),
        (lines(ROWS, np.full((4, 3), 9.5), NORMALS), "--columns x,y,z,_,_,_,nx,ny,nz"),
        (lines(np.arange(4.0), ROWS), "the first looks like a running number: .*--columns index,x,y,z"),
        (lines(ROWS, np.ones(4)), "found 4 columns without names; name them"),
        ("1 2 3 wall\n4 5 6 wall\n", "found 4 columns without names; name them"),
        ("1,2\n3,4\n", "found 2"),
    ],
)
def test_what_is_not_clear_is_refused_with_its_cause(write, content, message):
    with pytest.raises(ColumnsError, match=message) as caught:
        qf.read_points(write(content))
    assert "decimal" not in str(caught.value)


def test_decimal_commas_are_named_only_where_they_may_be(write):
    with pytest.raises(ColumnsError, match=r"found 6 columns without names.*decimal commas are not read"):
        qf.read_points(write("1,5,2,5,3,5\n4,5,2,5,3,7\n"))


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        (lines(ROWS), "x,y,z"),
        (lines(ROWS, NORMALS), "x,y,z"),
        (lines(ROWS, NORMALS), "x,y,z,nx,ny,nz"),
        (lines(np.arange(4), ROWS), "_,x,y,z"),
        (lines(ROWS[:, ::-1]), "z,y,x"),
        (lines(ROWS[:, ::-1]), ["z", "y", "x"]),
        (lines(ROWS[:, ::-1]), (2, 1, 0)),
        ("# zyx\n" + lines(ROWS[:, ::-1]), "z,y,x"),
        ("0,1,2\n" + lines(ROWS), "0,1,2"),
        (",0,1,2\n" + lines(np.arange(4), ROWS), "0,1,2"),
        ("# S,A,R\n" + lines(ROWS[:, ::-1]), "R,A,S"),
        ("%time,field.point.z,field.point.y,field.point.x\n" + lines(np.arange(4), ROWS[:, ::-1]), FIELDS),
        ("S,A,R\n" + lines(ROWS[:, ::-1]), "R,A,S"),
        ("S,A,R\n" + lines(ROWS[:, ::-1]), "r, a, s"),
        ("z,y,x\n" + lines(ROWS[:, ::-1]), "x,y,z"),
        ("# z y x\n" + lines(ROWS[:, ::-1]), "x,y,z"),
        ("x,y,z,X2,Y2,Z2\n" + lines(-ROWS, ROWS), "X2,Y2,Z2"),
    ],
)
def test_the_caller_may_say_which_they_are(write, content, columns):
    assert np.array_equal(qf.read_points(write(content), columns=columns), ROWS)


@pytest.mark.parametrize(
    ("names", "width", "columns", "message"),
    [
        (None, 3, "x,y,z,w", "names 4 columns, found 3"),
        (None, 3, "a,b,c", "expected names for them from left to right"),
        (None, 3, "1,2,3", "expected names for them from left to right"),
        (None, 3, "", "expected names for them"),
        (None, 3, (0, 1), "expected three columns, or six with the normals, found 2"),
        (None, 3, (0, 1, 3), "3 is not there"),
        (None, 3, (0, 1, 1), "takes a column twice"),
        (["a", "b", "c"], 3, "x,y,z", "'x' is not there; found 3 columns: 'a', 'b', 'c'"),
        (["a", "a", "c"], 3, "a,c,c", "'a' is twice"),
        (["a", "b", "c"], 3, "a,b", "expected three columns"),
    ],
)
def test_columns_that_are_not_there(names, width, columns, message):
    with pytest.raises(OptionError, match=message):
        chosen_columns(columns, names, width, "table")


def test_a_first_row_of_0_1_2_is_a_point_where_the_caller_says_so(write):
    assert len(qf.read_points(write("0,1,2\n" + lines(ROWS.astype(int))), columns="x,y,z")) == 5
    with pytest.raises(ColumnsError, match="numbers of the columns"):
        qf.read_points(write(",0,1,2\n" + lines(np.arange(4), ROWS)), columns="index,x,y,z")


def test_plain_letters_come_before_others():
    assert columns_of(["center_x", "x", "y", "z", "center_z"], "table").points == (1, 2, 3)


def test_lengths_in_other_units_become_millimetres_for_a_model(write):
    found = read_point_set(write("x [um],y [um],z [um]\n" + lines(1000 * ROWS)))
    assert found.unit == "um" and np.array_equal(found.points, 1000 * ROWS)
    metric = found.in_metric_unit()
    assert metric.unit == "mm" and metric.notes == ("lengths in um became mm",)
    np.testing.assert_allclose(metric.points, ROWS, rtol=1e-15)


# --- arrays ------------------------------------------------------------------------------------------------------


def saved(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def records(kind="f8", order="zyx", more=()):
    array = np.zeros(4, dtype=[(axis, kind) for axis in order] + list(more))
    for axis in order:
        array[axis] = ROWS[:, "xyz".index(axis)]
    return array


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", ">f4", "f2"])
def test_fields_of_an_array_are_columns(write, kind):
    array = records(kind, more=[("id", "i4"), ("label", "U5"), ("normal", "f4", (3,))])
    array["normal"] = NORMALS
    for found in (point_set(array), read_point_set(write(saved(array), "p.npy"))):
        assert np.array_equal(found.points, ROWS)
        np.testing.assert_allclose(found.normals, NORMALS, atol=1e-7)
        assert found.number_type in (None, np.dtype(kind), np.dtype(kind).newbyteorder("="))


def test_a_field_of_three_numbers_is_a_point():
    array = np.zeros(4, dtype=[("t", "f8"), ("xyz", "f8", (3,))])
    array["xyz"] = ROWS
    assert np.array_equal(point_set(array).points, ROWS)


@pytest.mark.parametrize(
    ("array", "error", "message"),
    [
        (np.zeros((4, 6)), ColumnsError, "columns have no names; name them"),
        (np.hstack([ROWS, NORMALS]), ColumnsError, "the last three look like unit normals"),
        (np.zeros(4, dtype=[("a", "f8"), ("b", "f8"), ("c", "f8")]), ColumnsError, "found 'a', 'b', 'c'"),
        (records().reshape(2, 2), PointsError, "one row of records"),
        (np.zeros(4, dtype=[("x", "U3"), ("y", "f8"), ("z", "f8")]), PointsError, "real numbers"),
    ],
)
def test_arrays_whose_columns_are_not_clear(write, array, error, message):
    for call in (lambda: point_set(array), lambda: read_point_set(write(saved(array), "p.npy"))):
        with pytest.raises(error, match=message):
            call()


def test_columns_of_an_array_are_named_from_left_to_right(write):
    array = np.hstack([ROWS[:, ::-1], 2 * NORMALS])
    for found in (
        point_set(array, columns="z,y,x,nx,ny,nz"),
        point_set(array, columns=(2, 1, 0, 3, 4, 5)),
        read_point_set(write(saved(array), "p.npy"), "z,y,x,nx,ny,nz"),
    ):
        assert np.array_equal(found.points, ROWS)
        np.testing.assert_allclose(found.normals, NORMALS, atol=1e-15)


# --- data frames -------------------------------------------------------------------------------------------------


def test_data_frames_go_by_the_names_of_their_columns():
    frames = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = frames.DataFrame({"label": list("abcd"), "z [m]": ROWS[:, 2], "y [m]": ROWS[:, 1], "x [m]": ROWS[:, 0]})
    found = point_set(frame)
    assert np.array_equal(found.points, ROWS) and found.unit == "m"
    assert np.array_equal(point_set(frames.DataFrame(ROWS)).points, ROWS)
    assert point_set(frame.rename(columns=lambda n: n[0]).astype({"x": "f4", "y": "f4", "z": "f4"})).number_type == "f4"
    with pytest.raises(ColumnsError, match="found 'a', 'b', 'c'"):
        point_set(frames.DataFrame(ROWS, columns=list("abc")))
    with pytest.raises(PointsError, match="real numbers in column 'x'"):
        point_set(frames.DataFrame({"x": list("abcd"), "y": ROWS[:, 1], "z": ROWS[:, 2]}))


def test_a_mesh_has_columns_of_its_own(tmp_path):
    qf.save(qf.Superquadric().mesh(4), tmp_path / "m.ply")
    with pytest.raises(OptionError, match="goes with tables and arrays"):
        qf.read_points(tmp_path / "m.ply", columns="x,y,z")


def test_the_small_inputs_that_failed(shared):
    tables = shared / "cases" / "tables"
    if not tables.exists():
        pytest.skip(f"the small inputs are not at {tables}")
    wanted = qf.read_points(tables / "pts_count.txt")
    for name, columns in (
        ("header_mm_zyx.csv", None),
        ("napari3.csv", None),
        ("savetxt_xyzi.txt", None),
        ("struct.npy", None),
        ("modelnet_normals.txt", "x,y,z,nx,ny,nz"),
        ("n6.npy", (0, 1, 2)),
    ):
        np.testing.assert_allclose(qf.read_points(tables / name, columns=columns), wanted, atol=2e-6)
    for name in ("modelnet_normals.txt", "n6.npy"):
        with pytest.raises((ColumnsError, FileFormatError), match="--columns"):
            qf.read_points(tables / name)
