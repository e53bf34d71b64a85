"""Guide points: what the file says, in groups; real points lie in the planes of their slices."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import FileFormatError, InputError, OptionError, PointsError
from quadriform.files.guide_points import read_guide_point_frames, read_guide_points, read_slice_planes

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

    @pytest.mark.parametrize("name, frame", [("GPFile_012.txt", 12), ("GPFile.txt", 0), ("p1_GPFile_3.txt", 3)])
    def test_the_frame_is_that_of_the_name(self, tmp_path, name, frame):
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
            ("1\t2\t3\tAPEX_POINT\t7\t1.0", "expected 7 fields between tabs, found 6"),
            ("1 2 3 APEX_POINT 7 1.0 0", "expected 7 fields between tabs, found 1"),
            ("1\ttwo\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found 'two'"),
            ("1\tnan\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found 'nan'"),
            ("1\t1_0\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found '1_0'"),
            ("1\t1,5\t3\tAPEX_POINT\t7\t1.0\t0", "expected a finite number, found '1,5'"),
            ("1\t2\t3\tAPEX_POINT\t7.5\t1.0\t0", "expected a whole number, found '7.5'"),
            ("1\t2\t3\tAPEX_POINT\t7\t-1\t0", "expected a weight of 0 or more, found '-1'"),
            ("1\t2\t3\t\t7\t1\t0", "expected a contour type"),
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
            (b"x,y,z\n1,2,3\n", "line 1: expected the header x | y"),
            (HEADER.encode(), "no points under the header"),
            (b"\n \n", "line 1: expected the header"),
            (b"", "empty"),
        ],
    )
    def test_another_file_is_refused(self, tmp_path, content, said):
        (tmp_path / "GPFile_000.txt").write_bytes(content)
        with pytest.raises(FileFormatError) as caught:
            read_guide_points(tmp_path / "GPFile_000.txt")
        assert said in str(caught.value)


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

    def test_missing_frames_are_named(self, tmp_path):
        for n in (0, 1, 4, 6):
            write(tmp_path / f"GPFile_{n:03d}.txt")
        with pytest.raises(InputError, match=r"between 0 and 6: GPFile_002.txt, GPFile_003.txt, GPFile_005.txt$"):
            read_guide_point_frames(tmp_path)

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
            (LINE.format(1, 1), "slice 1 is there twice"),
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

    def test_slices_of_the_short_axis_are_parallel(self, shared):
        planes = read_slice_planes(shared / "data" / "human_lv_guidepoints" / "SliceInfoFile.txt")
        steps = [(planes[n + 1].origin - planes[n].origin) @ planes[1].normal for n in range(1, 6)]
        assert_allclose(np.abs(steps), 17.7, atol=0.01)
