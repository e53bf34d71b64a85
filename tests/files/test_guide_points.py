"""Guide points: what the file says, in groups; real points lie in the planes of their slices."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import FileFormatError, InputError, OptionError, PointsError
from quadriform.files.guide_points import is_guide_points, read_guide_point_frames, read_guide_points
from quadriform.files.slice_planes import read_slice_planes

HEADER = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame\n"
ROWS = [
    "1\t2\t3\tLAX_LV_ENDOCARDIAL\t7\t1.0\t4",
    "4\t5\t6\tSAX_LV_ENDOCARDIAL\t2\t0.5\t4",
    "-7.5\t8e1\t9\tMITRAL_VALVE\t7\t1.0\t1.0",
    "1\t1\t1\tSAX_LV_ENDOCARDIAL\t3\t1.0\t4",
    "2\t2\t2\tSAX_RV_SEPTUM\t3\t1.0\t4",
]


def write(path, rows=ROWS, header=HEADER):
    path.write_text(header + "".join(row + "\n" for row in rows))
    return path


class TestOneFile:
    def test_points_come_by_contour_in_the_order_of_the_file(self, tmp_path):
        found = read_guide_points(write(tmp_path / "GPFile_004.txt"))
        assert set(found.points) == {"LAX_LV_ENDOCARDIAL", "SAX_LV_ENDOCARDIAL", "MITRAL_VALVE", "SAX_RV_SEPTUM"}
        assert_array_equal(found.points["SAX_LV_ENDOCARDIAL"], [[4, 5, 6], [1, 1, 1]])
        assert_array_equal(found.slices["SAX_LV_ENDOCARDIAL"], [2, 3])
        assert found.slices["SAX_LV_ENDOCARDIAL"].dtype == np.int64
        assert_array_equal(found.weights["SAX_LV_ENDOCARDIAL"], [0.5, 1])

    def test_a_surface_is_both_kinds_of_slices_and_the_left_ventricle_alone(self, tmp_path):
        points, slices = read_guide_points(write(tmp_path / "GPFile_004.txt")).surface("endo")
        assert_array_equal(points, [[4, 5, 6], [1, 1, 1], [1, 2, 3]])
        assert_array_equal(slices, [2, 3, 7])

    def test_marks_are_points_or_none(self, tmp_path):
        found = read_guide_points(write(tmp_path / "GPFile_004.txt"))
        assert_array_equal(found.mitral, [[-7.5, 80, 9]])
        assert found.apex.shape == found.rv_inserts.shape == (0, 3)

    @pytest.mark.parametrize("name, frame", [("GPFile_012.txt", 12), ("GPFile.txt", 4), ("p1_GPFile_3.txt", 3)])
    def test_the_frame_is_that_of_the_name_or_of_most_rows(self, tmp_path, name, frame):
        assert read_guide_points(write(tmp_path / name)).frame == frame

    def test_line_ends_marks_and_blank_lines_do_not_matter(self, tmp_path):
        path = tmp_path / "GPFile_000.txt"
        path.write_bytes(b"\xef\xbb\xbf" + (HEADER + "\n\n".join(ROWS)).replace("\n", "\r\n").encode())
        assert len(read_guide_points(path).surface("endo")[0]) == 3

    def test_a_surface_without_points(self, tmp_path):
        found = read_guide_points(write(tmp_path / "GPFile_004.txt"))
        with pytest.raises(PointsError, match=r"frame 4: no points of LV_EPICARDIAL; found .*MITRAL_VALVE"):
            found.surface("epi")
        with pytest.raises(OptionError, match="'endo', 'epi'"):
            found.surface("rv")

    @pytest.mark.parametrize(
        "row, said",
        [
            ("1\t2\t3\tAPEX_POINT\t7\t1.0", "expected 7 fields, found 6"),
            ("1,2,3,APEX_POINT,7,1.0,0", "expected 7 fields, found 1"),
            ("1\ttwo\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found 'two'"),
            ("1\tnan\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found 'nan'"),
            ("1\t1_0\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found '1_0'"),
            ("1\t1,5\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found '1,5'"),
            ("1\t2\t3\tAPEX_POINT\t7.5\t1.0\t0", "expected a whole number, found '7.5'"),
            ("1\t2\t3\tAPEX_POINT\t7\t-1\t0", "expected a weight of 0 or more, found '-1'"),
            ("1\t2\t3\t\t7\t1\t0", "expected a contour type"),
            ("1\t2\t3\t7\tAPEX_POINT\t1\t0", "expected a contour type, found '7'"),
            ("1\t2\t3\tAPEX_POINT\t7\t1\tsoon", "expected a whole number, found 'soon'"),
        ],
    )
    def test_a_bad_row_is_refused_with_its_line(self, tmp_path, row, said):
        path = write(tmp_path / "GPFile_004.txt", [*ROWS[:2], row, *ROWS[2:]])
        with pytest.raises(FileFormatError, match=f"GPFile_004.txt', line 4: {said}"):
            read_guide_points(path)

    @pytest.mark.parametrize(
        "content, said",
        [
            (b"\x89PNG\0\xff", "expected text in UTF-8, found PNG"),
            (b"x,y,z\n1,2,3\n", "line 1: expected the columns x | y | z | contour type"),
            (HEADER.replace("weight", "x").encode(), "line 1: expected the columns"),
            (HEADER.replace("frameID", "time").encode(), "line 1: expected the columns"),
            (HEADER.encode(), "no points in it"),
            (b"\n \n", "no points in it"),
            (b"", "empty"),
        ],
    )
    def test_another_file_is_refused(self, tmp_path, content, said):
        (tmp_path / "GPFile_000.txt").write_bytes(content)
        with pytest.raises(FileFormatError) as caught:
            read_guide_points(tmp_path / "GPFile_000.txt")
        assert said in str(caught.value)


class TestDialects:
    """What biv-me has written over the years, each giving the same points."""

    @pytest.mark.parametrize(
        "write_as",
        [
            lambda text: text.replace("frameID", "sliceID"),
            lambda text: text.replace("frameID", "slice").replace("time frame", "Time_Frame"),
            lambda text: text.split("\n", 1)[1],
            lambda text: text.replace("\t", "  "),
            lambda text: text.split("\n", 1)[1].replace("\t", " "),
            lambda text: text.replace("\n", "\r\n"),
            lambda text: "\n".join(line.rpartition("\t")[0] for line in text.splitlines()),
            lambda text: "\n".join("\t".join(line.split("\t")[::-1]) for line in text.splitlines()),
        ],
        ids=["sliceID", "slice", "no header", "blanks", "blanks, no header", "Windows", "no time", "columns reversed"],
    )
    def test_every_writing_gives_the_same_points(self, tmp_path, write_as):
        expected = read_guide_points(write(tmp_path / "GPFile_004.txt"))
        path = tmp_path / "GPFile_4.txt"
        path.write_bytes(write_as(HEADER + "\n".join(ROWS)).encode())
        found = read_guide_points(path)
        assert found.frame == 4 and found.points.keys() == expected.points.keys()
        for kind in expected.points:
            for name in ("points", "slices", "weights"):
                assert_array_equal(getattr(found, name)[kind], getattr(expected, name)[kind])

    def test_points_of_weight_zero_are_of_no_surface(self, tmp_path):
        rows = [ROWS[0], ROWS[1].replace("0.5", "0")]
        found = read_guide_points(write(tmp_path / "GPFile_0.txt", rows))
        assert_array_equal(found.surface("endo")[0], [[1, 2, 3]])
        with pytest.raises(PointsError, match="no points of LV_ENDOCARDIAL"):
            read_guide_points(write(tmp_path / "GPFile_1.txt", rows[1:])).surface("endo")

    def test_time_frames_of_one_file_are_kept_apart(self, tmp_path):
        """Contours of one slice at two times are two frames, whatever the file's name says."""
        rows = [f"{x}\t0\t0\tSAX_LV_ENDOCARDIAL\t3\t1.0\t{time}" for time in (12, 1) for x in range(3)]
        path = write(tmp_path / "GPFile_000.txt", [*rows, "9\t0\t0\tSAX_LV_ENDOCARDIAL\t4\t1.0\t1"])
        assert [found.frame for found in read_guide_point_frames(path)] == [1, 12]
        assert_array_equal(read_guide_points(path, frame=1).surface("endo")[0][:, 0], [0, 1, 2, 9])
        assert_array_equal(read_guide_points(path, frame=12).surface("endo")[0][:, 0], [0, 1, 2])
        with pytest.raises(InputError, match="holds the time frames 1, 12; choose one, or follow them all"):
            read_guide_points(path)
        with pytest.raises(InputError, match="there is no frame 2"):
            read_guide_points(path, frame=2)

    def test_images_that_have_numbers_of_their_own_are_kept_apart_by_time(self, tmp_path):
        """Where each image of a slice has another number no contour is there twice: the times decide."""
        rows = [f"{n}\t0\t0\tSAX_LV_ENDOCARDIAL\t{n}\t1\t{n % 2}" for n in range(10, 16)]
        found = read_guide_point_frames(write(tmp_path / "GPFile.txt", rows))
        assert [(each.frame, each.surface("endo")[1].tolist()) for each in found] == [
            (0, [10, 12, 14]),
            (1, [11, 13, 15]),
        ]

    def test_a_slice_whose_time_is_always_one_belongs_to_its_file(self, tmp_path):
        """As in the first person's files; without a number in the name most rows tell it."""
        rows = [f"{n}\t0\t0\tSAX_LV_ENDOCARDIAL\t{n}\t1\t{7 if n != 8 else '1.0'}" for n in range(5, 10)]
        for name, frame in (("GPFile_003.txt", 3), ("ed.txt", 7)):
            found = read_guide_points(write(tmp_path / name, rows))
            assert (found.frame, len(found.surface("endo")[0])) == (frame, 5)

    def test_several_frames_with_rows_of_an_unknown_time_are_refused(self, tmp_path):
        """Two such files put together: to which frame the rows of slice 8 belong nobody can tell."""
        rows = [f"{n}\t0\t0\tSAX_LV_ENDOCARDIAL\t{n}\t1\t{t if n != 8 else '1.0'}" for t in (0, 1) for n in (7, 8)]
        with pytest.raises(
            FileFormatError, match=r"written in 2 forms \(as 1 in the slices 7; as 1.0 in the slices 8\)"
        ):
            read_guide_point_frames(write(tmp_path / "GPFile.txt", rows))

    @pytest.mark.parametrize(
        ("name", "text", "expected"),
        [
            ("gpfile_proc.TXT", "", True),
            ("a.txt", HEADER, True),
            ("a.txt", "\n" + ROWS[0], True),
            ("a.txt", "1 2 3 LAX_LV_EPICARDIAL 1 1 0", True),
            ("a.txt", "1 2 3 4 5 6 7", False),
            ("a.txt", "x y z\n1 2 3", False),
            ("a.xyz", HEADER, False),
            ("missing.txt", None, False),
        ],
    )
    def test_files_are_known_by_name_or_content(self, tmp_path, name, text, expected):
        if text is not None:
            (tmp_path / name).write_text(text)
        assert is_guide_points(tmp_path / name) is expected


class TestFolder:
    def test_frames_come_in_the_order_of_their_numbers(self, tmp_path):
        for n in (10, 9, 8):
            write(tmp_path / f"GPFile_{n}.txt", [f"{n}\t0\t0\tAPEX_POINT\t1\t1\t0"])
        write(tmp_path / "notes.txt")
        assert [(found.frame, found.apex[0, 0]) for found in read_guide_point_frames(tmp_path)] == [
            (8, 8),
            (9, 9),
            (10, 10),
        ]

    def test_a_frame_without_a_file_is_not_in_the_list(self, tmp_path):
        for n in (12, 0, 6):
            write(tmp_path / f"GPFile_{n:03d}.txt")
        assert [found.frame for found in read_guide_point_frames(tmp_path)] == [0, 6, 12]

    def test_a_list_of_files_in_any_order(self, tmp_path):
        paths = [write(tmp_path / f"GPFile_{n}.txt") for n in (10, 9, 100)]
        assert [found.frame for found in read_guide_point_frames(paths)] == [9, 10, 100]
        (tmp_path / "again").mkdir()
        twice = write(tmp_path / "again" / "GPFile_9.txt")
        with pytest.raises(InputError, match=r"frame 9 is in two files, .*GPFile_9.txt' and .*again/GPFile_9.txt'"):
            read_guide_point_frames([*paths, twice])

    def test_a_frame_twice(self, tmp_path):
        for name in ("GPFile_1.txt", "GPFile_001.txt"):
            write(tmp_path / name)
        with pytest.raises(InputError, match=r"the same frame in several files: GPFile_001\.txt, GPFile_1\.txt"):
            read_guide_point_frames(tmp_path)

    def test_no_folder_and_no_files(self, tmp_path):
        with pytest.raises(InputError, match="no files GPFile"):
            read_guide_point_frames(tmp_path)
        with pytest.raises(InputError, match="expected a folder"):
            read_guide_point_frames(tmp_path / "none")


class TestSlicePlanes:
    LINE = (
        "a.dcm\tsliceID: \t{}\tImagePositionPatient\t1\t2\t3\tImageOrientationPatient\t0\t1\t0\t0\t0\t{}\t"
        "PixelSpacing\t1.5\t1.25\n"
    )

    def test_planes_come_by_slice(self, tmp_path):
        path = tmp_path / "SliceInfoFile.txt"
        path.write_text(self.LINE.format(4, 1) + self.LINE.format(2, -1))
        planes = read_slice_planes(path)
        assert list(planes) == [4, 2]
        assert_array_equal(planes[4].origin, [1, 2, 3])
        assert_array_equal(planes[4].rows, [0, 1, 0])
        assert_array_equal(planes[2].columns, [0, 0, -1])
        assert_array_equal(planes[4].normal, [1, 0, 0])
        assert_array_equal(planes[2].normal, [-1, 0, 0])
        assert_array_equal(planes[2].spacing, [1.5, 1.25])

    @pytest.mark.parametrize(
        "line, said",
        [
            (LINE.format("two", 1), "whole number, found 'two'"),
            (LINE.format(1, -1), "slice 1 lies in another plane than before"),
            (LINE.format(2, 1).replace("sliceID", "image"), "expected sliceID: or frameID:"),
            (LINE.format(2, 2), "no right angle"),
            (LINE.format(2, "nan"), "finite number, found 'nan'"),
            (LINE.format(2, 1).replace("ImagePositionPatient", "Place"), "expected ImagePositionPatient"),
            (LINE.format(2, 1).replace("\t1.25", ""), "expected 2 numbers after PixelSpacing"),
        ],
    )
    def test_a_bad_line_is_refused_with_its_number(self, tmp_path, line, said):
        path = tmp_path / "SliceInfoFile.txt"
        path.write_text(self.LINE.format(1, 1) + line)
        with pytest.raises(FileFormatError, match=f"line 2: .*{said}"):
            read_slice_planes(path)

    @pytest.mark.parametrize("name", ["sliceID:", "frameID:", "slice:", "FRAMEID:"])
    @pytest.mark.parametrize("between", ["\t", "  "])
    def test_every_writing_of_a_list_gives_the_same_planes(self, tmp_path, name, between):
        """The name of the number, blanks for tabs, Windows line ends, and each slice once for every frame."""
        path = tmp_path / "SliceInfoFile.txt"
        lines = [self.LINE.format(n, 1).replace("sliceID: \t", f"{name}\t") for n in (1, 2, 1, 2)]
        path.write_bytes("".join(lines).replace("\t", between).replace("\n", "\r\n").encode())
        planes = read_slice_planes(path)
        assert list(planes) == [1, 2] and planes[2].origin.tolist() == [1, 2, 3]

    def test_an_empty_list(self, tmp_path):
        (tmp_path / "SliceInfoFile.txt").write_text("\n")
        with pytest.raises(FileFormatError, match="no slices"):
            read_slice_planes(tmp_path / "SliceInfoFile.txt")


@pytest.fixture(scope="module")
def frames(shared):
    return read_guide_point_frames(shared / "data" / "human_lv_guidepoints" / "frames")


class TestRealFrames:
    def test_there_are_as_many_points_as_the_data_says(self, frames):
        assert [found.frame for found in frames] == list(range(25))
        counts = [len(found.surface("endo")[0]) + len(found.surface("epi")[0]) for found in frames]
        assert (min(counts), max(counts)) == (576, 867)
        assert {len(found.mitral) for found in frames} == {6}
        assert {len(found.apex) for found in frames} == {1}
        assert all(len(found.rv_inserts) % 2 == 0 for found in frames)

    def test_each_point_lies_in_the_plane_of_its_slice(self, frames, shared):
        """So the column frameID is the slice."""
        planes = read_slice_planes(shared / "data" / "human_lv_guidepoints" / "SliceInfoFile.txt")
        for found in frames:
            for kind, points in found.points.items():
                normals = np.array([planes[n].normal for n in found.slices[kind]])
                origins = np.array([planes[n].origin for n in found.slices[kind]])
                assert_allclose(((points - origins) * normals).sum(axis=1), 0, atol=1e-4)

    def test_the_second_person_is_read_from_the_original_files(self, shared):
        """sliceID in one, no header in the other; each point in its plane; end diastole before end systole."""
        folder = shared / "data" / "human_lv_guidepoints_2"
        frames, planes = read_guide_point_frames(folder), read_slice_planes(folder / "SliceInfoFile.txt")
        assert [found.frame for found in frames] == [0, 12]
        assert [sum(len(found.surface(name)[0]) for name in ("endo", "epi")) for found in frames] == [5311, 4059]
        for found in frames:
            points, slices = found.surface("endo")
            heights = [(point - planes[n].origin) @ planes[n].normal for point, n in zip(points, slices)]
            assert np.abs(heights).max() < 1.5  # orientations have three digits, 200 mm from the corner of the image

    def test_slices_of_the_short_axis_are_parallel(self, shared):
        planes = read_slice_planes(shared / "data" / "human_lv_guidepoints" / "SliceInfoFile.txt")
        steps = [(planes[n + 1].origin - planes[n].origin) @ planes[1].normal for n in range(1, 6)]
        assert_allclose(np.abs(steps), 17.7, atol=0.01)
