"""`qf.fit` of files does what `quadriform fit` does: one rule for what a file holds, one function that fits."""

import contextlib
import json
import shutil
from pathlib import Path

import nibabel
import numpy as np
import pytest
from matplotlib.figure import Figure
from shapes_made import lumpy
from shapes_meshes import box_mesh

import quadriform as qf
from quadriform.cli.main import main
from quadriform.errors import FileFormatError, InputError, MaskError, OptionError, PointsError, WarningKind
from quadriform.files import sha256_of, write_mesh
from quadriform.files.save_and_load import content_of
from quadriform.imaging.file_points import kind_of, parse_labels, parse_threshold
from quadriform.shapes.mesh import Mesh

pytestmark = pytest.mark.usefixtures("remembered_fits")
QUICK = {"box": (3, 3, 3), "strength": 1e-4}
WORDS = ("--box", "3,3,3", "--strength", "1e-4")


def blank(figure, stream, format, **how):
    stream.write("<svg></svg>" if format == "svg" else b"")


@pytest.fixture
def files(made, tmp_path, monkeypatch):
    """A folder with one file of each kind; few samples of a mesh and blank charts, as neither matters here."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("quadriform.shapes.mesh_points.SAMPLES", 400)
    monkeypatch.setattr(Figure, "savefig", blank)
    return tmp_path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    with contextlib.chdir(tmp_path_factory.mktemp("made")):
        write_files()
        return Path.cwd()


def write_files():
    points = lumpy(300)
    np.savetxt("points.xyz", points, fmt="%.17g")
    np.savez("points.npz", points=points)
    write_mesh(box_mesh(), "block.STL".lower(), "LPS", "mm")
    Path("block.stl").rename("BLOCK.STL")
    write_mesh(box_mesh(), "block.ply", "RAS", "mm")
    grid = np.stack(np.meshgrid(*[np.arange(12)] * 3, indexing="ij"), axis=-1)
    ball = (((grid - 5.5) ** 2).sum(axis=-1) < 20).astype(np.uint8)
    image = nibabel.Nifti1Image(ball, np.diag([2, 2, 2, 1.0]))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, "ball.nii.gz")
    model = qf.fit(points, **QUICK).model
    qf.save(model, "model.npz")
    qf.save(model, "model.json")


KINDS = {
    "points.xyz": "points",
    "points.npz": "points",
    "BLOCK.STL": "mesh",
    "block.ply": "mesh",
    "ball.nii.gz": "image",
    "model.npz": "model",
    "model.json": "model",
}


def test_one_rule_decides_the_content_of_a_file(files, capsys):
    for name, kind in KINDS.items():
        assert kind_of(files / name) == kind
        assert kind == "image" or content_of(files / name) == kind
        capsys.readouterr()
        assert main(["info", name, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["kind"] == kind
    assert content_of("report.html") is None
    assert content_of("damaged.npz") == "points"


def test_python_and_the_terminal_fit_a_file_alike(files, blank_figures, capsys):
    for name in ("points.xyz", "BLOCK.STL", "ball.nii.gz"):
        assert main(["fit", name, "-o", "out", *WORDS, "--force"]) == 0
        one, two = qf.load("out/model.json"), qf.fit(name, **QUICK).model
        assert np.array_equal(one.box.control_points, two.box.control_points), name
        assert (one.space, one.unit, one.input_sha256) == (two.space, two.unit, two.input_sha256)
        assert one.record == two.record
        assert two.input_sha256 == sha256_of(name)


def test_models_and_other_files_are_refused_alike(files, capsys):
    (files / "text.html").write_text("hello")
    for name, word in (("model.npz", "found a model"), ("model.json", "found a model"), ("text.html", "suffix")):
        with pytest.raises(FileFormatError, match=word):
            qf.fit(name)
        assert main(["fit", name, "-o", "out"]) == 4
        assert word in capsys.readouterr().err
    with pytest.raises(InputError, match="no such file"):
        qf.fit("missing.ply")


def test_python_and_the_terminal_refuse_an_image_in_the_same_words(files, capsys):
    values = np.full((9, 9, 9), 7, np.uint8)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), "full.nii")
    with pytest.raises(MaskError, match=r"^'full.nii': the mask is full") as refused:
        qf.fit({"endo": "full.nii"})
    assert main(["fit", "full.nii", "-o", "out"]) == 4
    assert capsys.readouterr().err == f"quadriform: {refused.value}\n"


def test_several_files_by_name(files):
    block = box_mesh()
    write_mesh(Mesh(block.vertices * 0.5 + [2, 5, 7], block.faces), "inner.ply", "RAS", "mm")
    found = qf.fit({"outer": "block.ply", "inner": files / "inner.ply"}, **QUICK)
    assert list(found.model.surfaces) == ["outer", "inner"]
    assert (found.model.space, found.model.unit) == ("RAS", "mm")
    assert [file.surface for file in found.model.record.sources] == ["outer", "inner"]
    assert sum("spread evenly" in note for note in found.notes) == 2
    with pytest.raises(InputError, match="differ in space or unit"):
        qf.fit({"outer": "BLOCK.STL", "inner": "inner.ply"}, **QUICK)
    with pytest.raises(OptionError, match="files for all surfaces or for none"):
        qf.fit({"outer": "block.ply", "inner": block.vertices})


def test_weights_go_with_points(files):
    with pytest.raises(OptionError, match="weights"):
        qf.fit("points.xyz", weights=np.ones(300))


def test_a_folder_is_fitted_without_the_models_in_it(files, capsys):
    (files / "in").mkdir()
    for name in ("points.npz", "model.npz", "model.json"):
        (files / name).rename(files / "in" / name)
    assert main(["fit", "in", "-o", "out", *WORDS]) == 0
    assert [path.name for path in (files / "out").iterdir() if path.is_dir()] == ["points"]


def test_lost_digits_of_a_sampled_mesh_are_those_of_its_vertices(files):
    block = box_mesh((1.0, 2.0, 3.0))
    far = Mesh((block.vertices + 1e6 / 3).astype(np.float32).astype(np.float64), block.faces)
    write_mesh(far, "far.vtp")
    assert WarningKind.PRECISION_LOSS in qf.fit("far.vtp", **QUICK).warnings


@pytest.mark.parametrize("name", ["GPFile_000.txt", "contours.txt"])
def test_contours_of_several_surfaces_are_not_points_of_one(tmp_path, name):
    """Contours of both walls, and of two times, would be one cloud."""
    header = "x\ty\tz\tcontour type\tsliceID\tweight\ttime frame\n"
    rows = (f"{k}\t{k * k}\t1\tSAX_LV_{wall}CARDIAL\t0\t1.0\t0\n" for k in range(20) for wall in ("ENDO", "EPI"))
    (tmp_path / name).write_text(header + "".join(rows))
    with pytest.raises(InputError, match="holds contours of several surfaces"):
        qf.fit(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "value"),
    [("otsu", "otsu"), ("-12.5", -12.5), ("1e3", 1000.0), ("p99", (1, 99)), ("50%p99.9", (0.5, 99.9))],
)
def test_a_threshold_as_text_is_a_value_otsu_or_a_fraction_of_a_percentile(text, value):
    assert parse_threshold(text) == value


@pytest.mark.parametrize("text", ["", "mean", "50%", "otsu2", "p"])
def test_another_threshold_is_refused(text):
    with pytest.raises(OptionError, match=r"--threshold='.*': expected a number, otsu"):
        parse_threshold(text)


@pytest.mark.parametrize(("text", "labels"), [("1", (1,)), ("1,2,4", (1, 2, 4)), ("blood, left 2", ("blood, left 2",))])
def test_labels_as_text_are_numbers_or_one_name(text, labels):
    assert parse_labels(text) == labels


def test_where_only_arrays_are_taken_a_path_or_an_image_is_answered_by_what_makes_points_of_it(files):
    image = qf.read_volume("ball.nii.gz")
    for call in (
        lambda given: qf.fit_superquadric(given),
        lambda given: qf.refine(qf.Superquadric(), {"a": given}),
        lambda given: qf.track([given, given]),
        lambda given: qf.track([{"a": Path(given)}] * 2) if isinstance(given, str) else qf.fit(given),
    ):
        with pytest.raises(PointsError, match=r"found a path; only fit reads files: take read_points\(path\)"):
            call("points.xyz")
        with pytest.raises(PointsError, match=r"found an image; take points_from_image\(image\)"):
            call(image)
    assert len(qf.read_points("points.xyz")) == 300 and len(qf.points_from_image(image).points) > 100
