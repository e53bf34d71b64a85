"""Text meshes without a line end at their end: read where nothing can be missing, refused where a number may be cut."""

import numpy as np
import pytest

from quadriform.errors import FileFormatError
from quadriform.files.legacy_vtk import parse_legacy_vtk
from quadriform.files.obj import parse_obj
from quadriform.files.ply import parse_ply
from quadriform.shapes.superquadric import Superquadric

GRID = Superquadric(semi_axes=(30, 20, 12)).mesh(6)
ROWS = "\n".join("{:.3f} {:.3f} {:.3f}".format(*row) for row in GRID.vertices)
N, FACES = len(GRID.vertices), GRID.faces.tolist()
FACES = [face for face in FACES if N - 1 not in face] + [
    [*np.roll(face, 2 - face.index(N - 1))] for face in FACES if N - 1 in face
]


def lists(first, prefix=""):
    return "\n".join(prefix + " ".join(str(index + first) for index in face) for face in FACES)


PLY = f"ply\nformat ascii 1.0\nelement vertex {N}\nproperty float x\nproperty float y\nproperty float z\n"
VTK = f"# vtk DataFile Version {{}}\nof a test\nASCII\nDATASET POLYDATA\nPOINTS {N} float\n{ROWS}\n"
OBJ = "\n".join(f"v {row}" for row in ROWS.split("\n"))
TEXTS = {
    "PLY": (
        parse_ply,
        f"{PLY}element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n{ROWS}\n{lists(0, '3 ')}",
    ),
    "PLY of points": (parse_ply, f"{PLY}end_header\n{ROWS}"),
    "VTK": (parse_legacy_vtk, f"{VTK.format('3.0')}POLYGONS {len(FACES)} {4 * len(FACES)}\n{lists(0, '3 ')}"),
    "VTK of points": (parse_legacy_vtk, VTK.format("3.0").rstrip()),
    "VTK by offsets": (
        parse_legacy_vtk,
        f"{VTK.format('5.1')}POLYGONS {len(FACES) + 1} {3 * len(FACES)}\nOFFSETS vtktypeint64\n"
        + " ".join(str(3 * k) for k in range(len(FACES) + 1))
        + f"\nCONNECTIVITY vtktypeint64\n{lists(0)}",
    ),
    "OBJ": (parse_obj, f"{OBJ}\n{lists(1, 'f ')}"),
    "OBJ of points": (parse_obj, OBJ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_that_is_cut_within_its_last_number_is_refused_and_a_whole_one_is_read(name):
    parse, text = TEXTS[name]
    whole, without_end = parse(f"{text}\n".encode(), "a"), parse(text.encode(), "a")
    for found, known in zip(vars(without_end).values(), vars(whole).values(), strict=True):
        np.testing.assert_array_equal(found, known)
    last = text.split()[-1]
    for cut in range(1, len(last)):
        with pytest.raises(FileFormatError, match="it may be cut; add a line end if it is not"):
            parse(text[:-cut].encode(), "a")
        parse(text[:-cut].encode() + b"\n", "a")  # whoever adds a line end says that it is whole


def test_a_polygon_with_fewer_corners_than_all_others_may_be_cut_between_them():
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n" + 3 * "f 1 2 3 4\n"
    for end in ("f 1 2 3", "f 1 2 3 "):
        with pytest.raises(FileFormatError, match="line 8: the line has no end, and fewer corners than all others"):
            parse_obj((square + end).encode(), "a")
    assert parse_obj((square + "f 1 2 3\n").encode(), "a").lengths.tolist() == [4, 4, 4, 3]
    assert parse_obj((square + "f 1 2 3 # whole").encode(), "a").lengths.tolist() == [4, 4, 4, 3]


@pytest.mark.parametrize(
    "end", ["f 1//1 2//1 1//1", "f 9 8 7", "vn 0 0 1", "l 1", "f 9 8 7 # 1", "f 9 8 1 ", "f -1 -2 -9"]
)
def test_what_cannot_be_cut_within_an_index_is_read(end):
    points = "".join(f"v {k} {k * k} 0\n" for k in range(20))
    parse_obj((points + end).encode(), "a")
    with pytest.raises(FileFormatError, match="its last number 1, for there are indices up to 20"):
        parse_obj((points + "f 9 8 -1").encode(), "a")
