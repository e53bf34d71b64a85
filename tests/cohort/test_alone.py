"""The files of a subject give the same model, status, warnings and notes in a cohort as alone."""

import json
from concurrent.futures import ThreadPoolExecutor

import nibabel
import numpy as np
import pytest
from cohort_made import needs

import quadriform as qf
from quadriform.cli.main import main
from quadriform.cohort import executors
from quadriform.cohort.layout import Layout
from quadriform.cohort.manifest import read_manifest
from quadriform.cohort.subject import Task, work
from quadriform.cohort.subject_files import inspect_files
from quadriform.files import write_mesh
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.record import with_deviation

pytestmark = pytest.mark.usefixtures("blank_figures", "remembered_fits")
HEART = SyntheticVentricle()
OPTIONS = {"box": (3, 3, 3)}
LABELS = ("epi=label:1+2", "endo=label:2")
HEARTS = ("endo=label:2", "epi=label:1+2")
SPACING, CENTRE = np.array([2.0, 2.0, 4.0]), np.array([30.0, 30.0, 40.0])
"""Of the voxels of ventricles, and of their ellipsoids from the corner of the first voxel."""
CAVITY = np.array([18.0, 17.0, 32.0])
"""Semi-axes of a cavity."""
FACE = 54.0
"""Height of the upper face of the last slice in the world, where the centre of the first voxel is at 0."""


@pytest.fixture
def documents(tmp_path, monkeypatch):
    """The contents of the model files that a cohort of one subject and the subcommand `alone` write."""
    monkeypatch.chdir(tmp_path)

    def both(alone, inputs, *words, surface="", heart=""):
        path = tmp_path / "list.csv"
        path.write_text(f"id,input,surface,heart\na,{';'.join(inputs)},{surface},{heart}\n", encoding="utf-8")
        row = next(read_manifest(path, OPTIONS).rows())
        about = inspect_files(row, tmp_path)
        layout = Layout(1, "", about.frames, about.surfaces, (3, 3, 3), about.space, about.unit, 1, 1)
        assert work(Task(row, tmp_path, tmp_path / "out", layout)).failure is None
        assert main([alone, *inputs, "--box", "3,3,3", *words, "-o", "alone"]) == 0
        return [
            json.loads((tmp_path / folder / "model.json").read_text(encoding="utf-8"))
            for folder in ("out/subjects/a", "alone")
        ]

    return both


def assert_same(found, alone):
    """Equal but for the title, and the surface that a file is named for."""
    for document in (found, alone):
        del document["title"]
        document["sources"] = {each["sha256"] for each in document["sources"]}
    assert {name for name in alone if found.get(name) != alone[name]} == set() and found.keys() == alone.keys()


def saved(labels, path, spacing=(1.5, 1.5, 4.0)):
    image = nibabel.Nifti1Image(labels.astype(np.uint8), np.diag([*spacing, 1]))
    image.header.set_xyzt_units("mm", "sec")
    nibabel.save(image, path)


def ventricle(scale):
    """Labels of a cavity (2) and a wall (1), ellipsoids that end with the image at FACE, in voxels of 2 x 2 x 4 mm."""
    at = np.moveaxis(np.indices((30, 30, 14)), 0, -1) * SPACING + 0.5 * SPACING - CENTRE
    inside = [((at / axes) ** 2).sum(axis=-1) < 1 for axes in (scale * (CAVITY + 6), scale * CAVITY)]
    return sum(inside).astype(np.uint8)


def below_face(scale):
    """Volume in ml of this cavity, by integration of the areas of its sections."""
    (a, b, c), height = scale * CAVITY, 56 - CENTRE[2]
    return np.pi * a * b * (height - height**3 / (3 * c**2) + 2 * c / 3) / 1000


def balls(outer=8.0, wall=3.0):
    """Labels of a ball (2) and a wall around it (1), in voxels of 1.5 x 1.5 x 4."""
    i, j, k = np.indices((24, 24, 10))
    radius = np.sqrt((i - 11.5) ** 2 + (j - 11.5) ** 2 + (4 / 1.5 * (k - 4.5)) ** 2)
    return (radius < outer).astype(np.uint8) + (radius < outer - wall)


@pytest.mark.parametrize("surfaces", [(), LABELS])
def test_a_label_image_is_fitted_with_the_noise_of_its_voxels(documents, tmp_path, surfaces):
    saved(balls(), tmp_path / "labels.nii.gz")
    words = [word for each in surfaces for word in ("--surface", each)]
    assert_same(*documents("fit", ["labels.nii.gz"], *words, surface=";".join(surfaces)))


@pytest.mark.parametrize("alone", ["fit", "track"])
def test_ventricles_of_label_images_end_at_their_base(documents, tmp_path, alone):
    frames = [ventricle(1.0), ventricle(0.8)]
    saved(frames[0] if alone == "fit" else np.stack(frames, axis=-1), tmp_path / "labels.nii.gz", SPACING)
    words = [word for each in HEARTS for word in ("--heart", each)]
    found, same = documents(alone, ["labels.nii.gz"], *words, heart=";".join(HEARTS))
    first = same["landmarks"][0] if alone == "track" else same["landmarks"]
    assert first["base"]["point"][2] == FACE
    assert_same(found, same)


@needs("zarr", "pyarrow")
def test_volumes_and_ejection_fraction_count_below_the_base(tmp_path, monkeypatch, capsys):
    """In the table of measures and on the page, as known in closed form; with other labels `--resume` keeps nothing."""
    from pyarrow import parquet

    saved(np.stack([ventricle(1.0), ventricle(0.8)], axis=-1), tmp_path / "labels.nii.gz", SPACING)
    (tmp_path / "list.csv").write_text("id,input\na,labels.nii.gz\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(executors, "processes", lambda count: executors.from_executor(ThreadPoolExecutor(1), 1))
    words = ["cohort", "list.csv", "-o", "out", "--set", "box=3,3,3"]
    both = [word for each in HEARTS for word in ("--heart", each)]
    assert main([*words, *both]) == 0
    table = parquet.read_table(tmp_path / "out" / "metrics").to_pylist()
    values = {row["quantity"]: row["value"] for row in table if row["frame"] is None}
    full, empty = below_face(1.0), below_face(0.8)
    assert values["end-diastolic volume"] == pytest.approx(full, rel=0.03)
    assert values["end-systolic volume"] == pytest.approx(empty, rel=0.03)
    assert values["ejection fraction"] == pytest.approx(100 * (1 - empty / full), abs=1.5)
    page = (tmp_path / "out" / "cohort.html").read_text(encoding="utf-8")
    for name in ("end-diastolic volume", "ejection fraction"):
        assert f"{with_deviation(values[name], values[f'{name} sd'])}</td>" in page
    capsys.readouterr()
    for heart, counted in ((both, "kept"), (("--heart", "endo=label:7"), "failed")):
        assert main([*words, *heart, "--resume", "--json"]) == (7 if counted == "failed" else 0)
        assert json.loads(capsys.readouterr().out)[counted] == 1


def test_a_mesh_is_fitted_with_its_body(documents, tmp_path):
    write_mesh(HEART.model(0.0).mesh("endo", 4), tmp_path / "a.ply", "RAS", "mm")
    assert_same(*documents("fit", ["a.ply"]))


def test_points_are_fitted_with_their_normals_and_unit(documents, tmp_path):
    points = HEART.surface_points("endo", 0.0, 150)
    normals = HEART.model(0.0).foot_points(points, "endo").normals
    rows = "\n".join(",".join(map(repr, row)) for row in np.column_stack([points / 10, normals]).tolist())
    (tmp_path / "a.csv").write_text(f"x [cm],y [cm],z [cm],nx,ny,nz\n{rows}\n", encoding="utf-8")
    assert_same(*documents("fit", ["a.csv"]))


def test_contours_of_one_frame_end_at_their_base(tmp_path):
    """As points of `fit` with the plane of their mitral points; `quadriform fit` takes no contours."""
    clouds = {name: HEART.surface_points(name, 0.0, 60) for name in ("endo", "epi")}
    groups = {f"SAX_LV_{name.upper()}CARDIAL": points for name, points in clouds.items()}
    rows = [
        "\t".join([*map(repr, point), kind, "0", "1.0", "0"])
        for kind, points in {**groups, "MITRAL_VALVE": HEART.mitral_points(0.0)}.items()
        for point in points.tolist()
    ]
    header = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame"
    (tmp_path / "GPFile_000.txt").write_text("\n".join([header, *rows]), encoding="utf-8")
    path = tmp_path / "list.csv"
    path.write_text("id,input\na,GPFile_000.txt\n", encoding="utf-8")
    row = next(read_manifest(path, OPTIONS).rows())
    layout = Layout(1, "", 1, ("endo", "epi"), (3, 3, 3), "LPS", "mm", 1, 1)
    assert work(Task(row, tmp_path, tmp_path / "out", layout)).failure is None
    model = qf.load(tmp_path / "out" / "subjects" / "a" / "model.json")
    base = model.landmarks.base
    assert np.abs(base.heights(HEART.mitral_points(0.0))).max() < 1e-6
    alone = qf.fit(clouds, base=(base.point, base.direction), box=(3, 3, 3)).model
    assert np.array_equal(model.box.control_points, alone.box.control_points)
    assert model.warnings == alone.warnings


def test_a_moving_label_image_is_tracked_with_the_noise_of_its_voxels(documents, tmp_path):
    frames = [balls(outer) for outer in (8.0, 7.0, 7.5)]
    saved(np.stack(frames, axis=-1), tmp_path / "labels.nii.gz")
    words = [word for each in LABELS for word in ("--surface", each)]
    assert_same(*documents("track", ["labels.nii.gz"], *words, surface=";".join(LABELS)))


def test_files_of_frames_are_tracked_at_the_times_of_their_numbers(documents, tmp_path):
    names = []
    for number in (0, 1, 3):
        names.append(f"a_{number}.nii.gz")
        saved(balls(8.0 - number / 3), tmp_path / names[-1])
    words = [word for each in LABELS for word in ("--surface", each)]
    assert_same(*documents("track", names, *words, surface=";".join(LABELS)))
