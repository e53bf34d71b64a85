"""Subjects of every kind: a moving label image, files for each wall, one frame, contours; marks that do not fit."""

from dataclasses import replace

import nibabel
import numpy as np
import pytest

from quadriform.cohort.layout import Layout, ensure_layout, read_layout
from quadriform.cohort.manifest import read_manifest
from quadriform.cohort.subject import Task, work
from quadriform.cohort.subject_files import inspect_files
from quadriform.errors import FileFormatError, InputError
from quadriform.files import load, write_mesh
from quadriform.heart.synthetic import SyntheticVentricle

HEART = SyntheticVentricle()
FAST = {"box": (3, 3, 3), "robust": False, "strength": 1e-5}


def layout(**values):
    default = Layout(1, "", 2, ("surface",), (3, 3, 3), "unknown", "unknown", 1, 1)
    return replace(default, **values)


@pytest.fixture
def one(tmp_path):
    """Do the one subject of a list."""

    def of_row(cells, header="id,input,surface", shared=None, options=FAST):
        path = tmp_path / "list.csv"
        path.write_text(f"{header}\n{cells}\n", encoding="utf-8")
        listed = read_manifest(path, options)
        row = next(listed.rows())
        return work(Task(row, tmp_path, tmp_path / "out", shared or layout()))

    return of_row


def test_a_moving_label_image_becomes_a_model_of_both_walls(one, tmp_path):
    """Two concentric balls of labels that shrink."""
    grid = np.stack(np.meshgrid(*[np.arange(24)] * 3, indexing="ij"), axis=-1) - 11.5
    radius = np.linalg.norm(grid, axis=-1)
    frames = [(radius < r).astype(np.uint8) + (radius < r + 3) for r in (7.0, 5.0)]
    image = nibabel.Nifti1Image(np.stack(frames, axis=-1).astype(np.uint8), np.diag([1.5, 1.5, 1.5, 1]))
    image.header.set_xyzt_units("mm", "sec")
    nibabel.save(image, tmp_path / "labels.nii.gz")
    shared = layout(surfaces=("epi", "endo"), space="LPS", unit="mm")
    found = one("a,labels.nii.gz,epi=label:1+2;endo=label:2", shared=shared)
    assert found.failure is None
    moving = load(tmp_path / "out" / "subjects" / "a" / "model.json")
    assert (moving.space, moving.unit, list(moving.surfaces)) == ("LPS", "mm", ["epi", "endo"])
    volumes = {(m.quantity, m.frame): (m.value, m.unit) for m in found.measures}
    assert volumes["volume endo", 0][0] == pytest.approx(4 / 3 * np.pi * 10.5**3, rel=0.05)
    assert volumes["volume endo", 0][1] == "mm^3"
    share = volumes["volume endo", 1][0] / volumes["volume endo", 0][0]
    assert volumes["ejection fraction", None][0] == pytest.approx(100 * (1 - share), abs=0.5)
    assert found.parameters.superquadrics.shape == (2, 2, 11)


def test_a_header_that_contradicts_itself_is_read_as_the_row_says(one, tmp_path):
    grid = np.stack(np.meshgrid(*[np.arange(20)] * 3, indexing="ij"), axis=-1) - 9.5
    image = nibabel.Nifti1Image((np.linalg.norm(grid, axis=-1) < 7).astype(np.uint8), np.diag([2.0, 2, 2, 1]))
    image.header.set_zooms((1, 1, 1))
    image.header["qform_code"] = 0
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "torn.nii.gz")
    refused = one("a,torn.nii.gz,", shared=layout(space="LPS", unit="mm"))
    assert refused.failure.kind == "AffineError" and "--affine sform" in refused.failure.error
    for affine, space, edge in (("sform", "LPS", 2), ("pixdim", "unknown", 1)):
        found = one(f"a,torn.nii.gz,,{affine}", "id,input,surface,affine", layout(space=space, unit="mm"))
        assert found.failure is None
        volume = next(m.value for m in found.measures if m.quantity == "volume surface")
        assert volume == pytest.approx(4 / 3 * np.pi * (7 * edge) ** 3, rel=0.05)
        assert inspect_files(next(read_manifest(tmp_path / "list.csv", FAST).rows()), tmp_path).space == space


def test_files_for_each_wall(one, tmp_path):
    for name in ("endo", "epi"):
        for frame in range(2):
            np.save(tmp_path / f"{name}{frame}.npy", HEART.surface_points(name, 0.4 * frame, 60))
    found = one("a,,epi=epi*.npy;endo=endo*.npy", shared=layout(surfaces=("epi", "endo")))
    assert found.failure is None and found.parameters.control_points.shape == (2, 3, 3, 3, 3)
    for name in ("endo", "epi"):
        np.save(tmp_path / f"{name}4.npy", HEART.surface_points(name, 0.2, 60))
    later = one("a,,epi=epi*.npy;endo=endo*.npy", shared=layout(surfaces=("epi", "endo"), frames=3))
    assert later.parameters.time.tolist() == [0, 1, 4]
    (tmp_path / "epi1.npy").unlink()
    again = one("a,,epi=epi*.npy;endo=endo*.npy", shared=layout(surfaces=("epi", "endo")))
    assert again.failure.kind == "InputError" and "as many files" in again.failure.error
    assert (tmp_path / "out" / "subjects" / "a" / "model.json").exists()  # files that are gone take no model along


def test_one_frame_is_fitted_and_marks_are_kept(one, tmp_path):
    mesh = HEART.model(0.0).mesh("endo", 4)
    write_mesh(mesh, tmp_path / "a.ply", "RAS", "mm")
    found = one("a,a.ply,", shared=layout(space="LPS", unit="mm"))
    assert found.failure is None and found.parameters.time.tolist() == [0]
    model = load(tmp_path / "out" / "subjects" / "a" / "model.json")
    assert model.space == "LPS"
    assert np.abs(model.distance(mesh.vertices * [-1, -1, 1])).max() < 2  # brought to the frame of the cohort
    metres = one("a,a.ply,", shared=layout(space="LPS", unit="m"))
    assert metres.failure.kind == "InputError" and "lengths in mm; expected m" in metres.failure.error


@pytest.mark.parametrize("by_wall", [False, True])
def test_columns_of_arrays_are_named_by_the_row(one, tmp_path, by_wall):
    """An array with three more columns is read as `columns` of the row says, z before y before x."""
    points = HEART.surface_points("endo", 0.0, 60)
    np.save(tmp_path / "a.npy", np.column_stack([points[:, ::-1], np.ones((60, 3))]))
    cells = "a,,surface=a.npy" if by_wall else "a,a.npy,"
    found = one(f'{cells},"z,y,x,r,g,b"', header="id,input,surface,columns")
    assert found.failure is None
    model = load(tmp_path / "out" / "subjects" / "a" / "model.json")
    assert np.abs(model.distance(points)).max() < 2
    assert one(cells).failure.kind == "ColumnsError"
    listed = tmp_path / "list.csv"
    listed.write_text(f'id,input,surface,columns\n{cells},"z,y,x,r,g,b"\n', encoding="utf-8")
    assert inspect_files(next(read_manifest(listed, {}).rows()), tmp_path).unit == "unknown"


@pytest.mark.parametrize(
    ("shared", "words"),
    [
        ({"surfaces": ("endo",)}, "expected endo in"),
        ({"box": (4, 4, 4)}, "expected (4, 4, 4)"),
        ({"frames": 1}, "in 1 frames at most"),
    ],
)
def test_what_does_not_fit_into_the_store_fails(one, tmp_path, shared, words):
    for frame in range(2):
        np.save(tmp_path / f"{frame}.npy", HEART.surface_points("endo", 0.4 * frame, 24))
    found = one("a,*.npy,", shared=layout(**shared))
    assert found.failure.kind == "InputError" and words in found.failure.error


def test_an_unforeseen_error_is_a_failure_too(one, tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", HEART.surface_points("endo", 0, 24))
    monkeypatch.setattr("quadriform.cohort.subject.fit", lambda *_, **__: 1 / 0)
    found = one("a,a.npy,")
    assert found.failure.kind == "ZeroDivisionError" and found.failure.error.startswith("internal error")


def test_headers_are_read_before_the_voxels(tmp_path):
    for frame in range(3):
        np.save(tmp_path / f"{frame}.npy", np.zeros((1, 3)))
    path = tmp_path / "list.csv"
    path.write_text("id,input\na,*.npy\nb,missing.npy\n", encoding="utf-8")
    listed = read_manifest(path, {})
    rows = list(listed.rows())
    assert inspect_files(rows[0], tmp_path).frames == 3
    with pytest.raises(InputError, match="no such file"):
        inspect_files(rows[1], tmp_path)
    assert ensure_layout(tmp_path, listed, None, 1).frames == 3


def test_a_damaged_layout_is_refused(tmp_path):
    (tmp_path / "cohort.json").write_text('{"format": "quadriform-cohort", "version": 9}', encoding="utf-8")
    with pytest.raises(FileFormatError, match="version 1"):
        read_layout(tmp_path)


@pytest.mark.parametrize(("subjects", "parts"), [(1, 1), (10, 3), (1000, 2), (50_000, 1000), (97, 1)])
def test_parts_cover_every_block_once(subjects, parts):
    block = max(1, min(100, -(-subjects // parts)))
    shared = layout(subjects=subjects, block=block)
    blocks = [each for part in range(1, parts + 1) for each in shared.blocks_of(part, parts)]
    assert blocks == list(range(shared.blocks))
    assert sum(len(shared.members(each)) for each in blocks) == subjects


def test_surfaces_must_have_the_same_frames(one, tmp_path):
    """Frame 2 of one wall is missing, frame 3 of the other: the walls would be paired across time."""
    for name in ("endo_1", "endo_3", "epi_1", "epi_2"):
        np.savetxt(tmp_path / f"{name}.xyz", np.eye(3))
    found = one("a,,endo=endo_*.xyz;epi=epi_*.xyz", shared=layout(surfaces=("endo", "epi")))
    assert found.failure.kind == "InputError"
    assert "the frames of epi are numbered [1, 2], those of endo [1, 3]" in found.failure.error
