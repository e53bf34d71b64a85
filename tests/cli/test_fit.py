"""`quadriform fit`: what it writes and says, for one input and for many."""

import json

import numpy as np
import pytest
from remembered import FOUND
from shapes_made import lumpy, made
from shapes_meshes import box_mesh

import quadriform
from quadriform.files import load, read_model, read_points, sha256_of
from quadriform.files.meshes import read_space_and_unit, write_mesh
from quadriform.shapes.mesh import Mesh

pytestmark = pytest.mark.usefixtures("blank_figures")
QUICK = ("--method", "paper", "--iterations", "4", "--strength", "1e-6")
BRIEF = (*QUICK, "--iterations", "1", "--box", "3,3,3")
"""Where a model is wanted, whatever it looks like."""


@pytest.fixture
def lump(tmp_path):
    """A file of 150 points of a lumpy body."""
    np.savetxt(tmp_path / "lump.xyz", lumpy(150), fmt="%.17g")
    return "lump.xyz"


def files_in(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_points_become_a_model_a_surface_and_a_table(terminal, cloud, tmp_path):
    result = terminal("fit", cloud, "-o", "out", *QUICK)
    assert result.code == 0
    assert files_in(tmp_path / "out") == ["model.json", "report.html", "surface.ply"]
    model = read_model("out/model.json")
    assert (model.space, model.unit, model.input_sha256) == ("unknown", "unknown", sha256_of(cloud))
    assert load("out/surface.ply").volume() == pytest.approx(model.mesh().volume(), rel=1e-5)
    for word in (
        "points",
        "400",
        "386",
        "compression ratio",
        "error RMS",
        "error 95 %",
        "error max",
        "superquadric alone",
        "noise",
        "strength",
        "min det J",
    ):
        assert word in result.out
    assert "\x1b" not in result.out + result.err


def test_json_reports_what_the_model_really_does(terminal, cloud, ellipsoid):
    result = terminal("fit", cloud, "-o", "out", "--json", *QUICK)
    record = json.loads(result.out)
    distances = np.abs(read_model("out/model.json").distance(ellipsoid))
    assert record["error"]["rms"] == pytest.approx(np.sqrt((distances**2).mean()), rel=1e-6, abs=1e-9)
    assert record["error"]["max"] == pytest.approx(distances.max(), rel=1e-6, abs=1e-9)
    assert record["error"]["p95"] == pytest.approx(np.percentile(distances, 95), rel=1e-6, abs=1e-9)
    assert record["compression_ratio"] == pytest.approx(3 * 400 / 386, rel=1e-12)
    assert record["parameters"] == 386
    assert record["points"] == 400
    assert record["outputs"] == ["out/model.json", "out/surface.ply", "out/report.html"]


def test_the_default_folder_is_named_after_the_input(terminal, cloud, tmp_path):
    assert terminal("fit", cloud, *BRIEF).code == 0
    assert files_in(tmp_path) == [
        "cloud-model/model.json",
        "cloud-model/report.html",
        "cloud-model/surface.ply",
        "cloud.xyz",
    ]


def test_options_reach_the_fit(terminal, cloud):
    words = ("--box", "3,4,5", "--regularity", "svd", "--strength", "20", "--matching", "model-to-data")
    assert terminal("fit", cloud, "-o", "out", *QUICK, *words, "--kind", "ellipsoid").code == 0
    assert read_model("out/model.json").box.control_points.shape == (3, 4, 5, 3)
    record = json.loads(terminal("fit", cloud, "-o", "two", "--method", "paper", "--iterations", "2", "--json").out)
    assert record["iterations"] <= 2
    stopped = ("fit", cloud, "-o", "three", "--method", "paper", "--tolerance", "0.5", "--json")
    assert json.loads(terminal(*stopped).out)["iterations"] == 1


def test_the_default_method_its_options_and_what_it_reports(terminal, lump):
    """JSON holds what Python returns; outliers are counted; the box is certified."""
    points = read_points(lump)
    np.savetxt("mixed.xyz", np.concatenate([points, [[90.0, 10, 0], [-20, 80, 5]]]), fmt="%.17g")
    words = ("--box", "3,3,3", "--regularity", "springs", "--strength", "1e-6")
    result = terminal("fit", "mixed.xyz", "-o", "out", "--json", *words)
    assert result.code == 0 and "OUTLIERS" in result.err
    record, model = json.loads(result.out), read_model("out/model.json")
    found = quadriform.fit(read_points("mixed.xyz"), box=(3, 3, 3), regularity="springs", strength=1e-6)
    assert record["noise"] == pytest.approx(found.noise, rel=1e-9)
    assert record["strength"] == 1e-6 and record["known_noise"] == "nothing" and record["noise"] < 2
    assert record["inliers"] == (found.inliers >= 0.5).sum() <= 150
    assert record["min_jacobian"] == pytest.approx(model.min_jacobian(), rel=1e-9) and record["min_jacobian"] > 0
    table = terminal("fit", "mixed.xyz", "-o", "two", "--no-robust", *words).out
    assert "inliers" not in table and "min det J" in table
    assert read_model("two/model.json").distance(points).std() > model.distance(points).std()


def test_the_noise_that_is_stated_is_used_and_shown(terminal, lump, nifti, body):
    """A number on the terminal is that of Python; masks bring their own, which a number replaces."""
    words = ("--box", "3,3,3", "--json")
    stated = json.loads(terminal("fit", lump, "-o", "stated", *words, "--noise", "2").out)
    assert stated["noise"] == quadriform.fit(read_points(lump), box=(3, 3, 3), noise=2.0).noise
    assert stated["noise"] >= 2 and stated["known_noise"] == "2, by --noise"
    mask = nifti("mask.nii", (body == 1)[::2, ::2].astype(np.uint8))
    own = json.loads(terminal("fit", mask, "-o", "mask", *words).out)
    assert own["known_noise"] == "up to 0.866 mm along the edges of voxels"  # 3 mm over the root of 12
    assert "0.5 mm, by --noise" in terminal("fit", mask, "-o", "again", "--box", "3,3,3", "--noise", "0.5").out


@pytest.mark.parametrize("text", ["-1", "0", "inf", "nan", "1_0", "much", "0.5,0.5", ""])
def test_noise_that_is_none_is_refused(terminal, cloud, text):
    result = terminal("fit", cloud, "-o", "out", f"--noise={text}")
    assert result.code == 2 and f"option --noise={text!r}: expected a standard deviation above 0" in result.err
    assert len(result.err.splitlines()) == 1


def test_the_method_of_the_paper_has_no_option_noise(terminal, cloud):
    result = terminal("fit", cloud, "-o", "out", "--noise", "1", "--method", "paper")
    assert result.code == 2 and "noise is not one of method='paper'" in result.err


def test_a_box_that_reaches_an_error(terminal, lump):
    record = json.loads(terminal("fit", lump, "-o", "out", "--json", "--box", "auto", "--max-error", "2").out)
    assert record["error"]["rms"] < 2
    assert read_model("out/model.json").box.control_points.shape == (3, 3, 3, 3)


def test_a_sensor_and_a_support_are_given_in_the_frame_of_the_points(terminal, lump):
    points = read_points(lump)
    np.save("above.npy", points[points[:, 2] > 0])
    words = ("fit", "above.npy", "--box", "3,3,3", "--viewpoint", "0,0,900", "--support", "0,0,-50/0,0,1")
    terminal(*words, "-o", "out")
    options = {"viewpoint": (0, 0, 900), "support": ((0, 0, -50), (0, 0, 1))}
    found = quadriform.fit(points[points[:, 2] > 0], box=(3, 3, 3), **options)
    np.testing.assert_allclose(read_model("out/model.json").box.control_points, found.model.box.control_points)


def test_a_base_is_a_plane_or_a_file_with_a_loop(terminal, lump):
    """Where the data ends on purpose no coverage is asked for; both words for the base give the same model."""
    points = read_points(lump)
    np.save("cut.npy", points[points[:, 2] < 8])
    np.savetxt("loop.xyz", [[30.0, 0, 8], [0, 30, 8], [-30, 0, 8], [0, -30, 8]])
    words = ("fit", "cut.npy", "--box", "3,3,3")
    assert "PARTIAL_COVERAGE" in terminal(*words, "-o", "open").err
    assert "PARTIAL_COVERAGE" not in terminal(*words, "-o", "plane", "--base", "0,0,8/0,0,2").err
    assert "PARTIAL_COVERAGE" not in terminal(*words, "-o", "loop", "--base", "loop.xyz").err
    plane, loop = (read_model(f"{name}/model.json").box.control_points for name in ("plane", "loop"))
    np.testing.assert_allclose(plane, loop, atol=1e-6)


def test_twice_the_same_bytes(terminal, cloud, tmp_path):
    for out in ("a", "b"):
        FOUND.clear()
        terminal("fit", cloud, "-o", out, *BRIEF)
    for name in ("model.json", "surface.ply", "report.html"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_existing_results_need_force(terminal, cloud, tmp_path):
    terminal("fit", cloud, "-o", "out", *QUICK)
    before = (tmp_path / "out/model.json").read_bytes()
    refused = terminal("fit", cloud, "-o", "out", "--box", "3,3,3", *QUICK)
    assert refused.code == 5
    assert "exists already" in refused.err
    assert (tmp_path / "out/model.json").read_bytes() == before
    assert terminal("fit", cloud, "-o", "out", "--force", "--box", "3,3,3", *QUICK).code == 0
    assert (tmp_path / "out/model.json").read_bytes() != before


def test_results_are_replaced_as_a_whole(terminal, cloud, tmp_path):
    """No surface of an earlier model stays beside the new one; what is no result stays."""
    points = read_points(cloud)
    np.save("inner.npy", points.mean(axis=0) + 0.7 * (points - points.mean(axis=0)))
    words = ("--surface", f"epi={cloud}", "--surface", "endo=inner.npy", "-o", "out", *BRIEF)
    assert terminal("fit", *words).code == 0
    for name in ("notes.txt", "surface-mine.ply"):
        (tmp_path / "out" / name).write_bytes(b"mine")
    assert terminal("fit", cloud, "-o", "out", *BRIEF).code == 5
    assert terminal("fit", cloud, "-o", "out", "--force", *BRIEF).code == 0
    written = ["model.json", "notes.txt", "report.html", "surface-mine.ply", "surface.ply"]
    assert files_in(tmp_path / "out") == written
    assert (tmp_path / "out/surface-mine.ply").read_bytes() == b"mine"


def test_results_may_lie_beside_their_input(terminal, cloud, tmp_path):
    """The folder in which somebody works; the second time only with force, and the input stays."""
    before = cloud.read_bytes()
    assert terminal("fit", cloud, "-o", ".", *BRIEF).code == 0
    assert terminal("fit", cloud, "-o", ".", *BRIEF).code == 5
    assert terminal("fit", cloud, "-o", ".", "--force", *BRIEF).code == 0
    assert files_in(tmp_path) == ["cloud.xyz", "model.json", "report.html", "surface.ply"]
    assert cloud.read_bytes() == before


def test_one_broken_input_does_not_stop_the_others(terminal, cloud, tmp_path):
    (tmp_path / "broken.xyz").write_text("1 2\n")
    (tmp_path / "flat.xyz").write_text("".join(f"{i} {i * i} 0\n" for i in range(30)))
    result = terminal("fit", "broken.xyz", cloud, "flat.xyz", "-o", "out", "--json", *BRIEF)
    assert result.code == 4
    assert files_in(tmp_path / "out") == ["cloud/model.json", "cloud/report.html", "cloud/surface.ply"]
    records = json.loads(result.out)
    assert [record["status"] == "failed" for record in records] == [True, False, True]
    assert "line 1" in records[0]["message"]
    assert "coplanar" in records[2]["message"]
    assert sum(line.startswith("quadriform: ") for line in result.err.splitlines()) == 2


def test_the_worst_exit_code_counts_even_where_the_fault_is_ours(terminal, cloud, tmp_path, monkeypatch):
    from quadriform.cli import fit_run

    (tmp_path / "broken.xyz").write_text("1 2\n")
    monkeypatch.setattr(fit_run, "fit_sources", lambda *_args, **_options: 1 / 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    result = terminal("fit", "broken.xyz", cloud, "broken2.xyz", "-o", "out")
    assert result.code == 70
    assert "broken.xyz" in result.err
    assert "failed (70)" in result.out
    assert "failed (4)" in result.out


def test_a_folder_gives_a_model_for_each_file_it_knows(terminal, cloud, tmp_path):
    (tmp_path / "in").mkdir()
    cloud.rename(tmp_path / "in/a.xyz")
    (tmp_path / "in/readme.md").write_text("not points")
    result = terminal("fit", "in", "-o", "out", *BRIEF)
    assert result.code == 0
    assert files_in(tmp_path / "out") == ["a/model.json", "a/report.html", "a/surface.ply"]
    assert "1 inputs" in result.out


def test_two_inputs_of_one_name_are_refused_before_the_work(terminal, cloud, tmp_path):
    (tmp_path / "cloud.csv").write_text("1,2,3\n")
    result = terminal("fit", cloud, "cloud.csv", "-o", "out")
    assert result.code == 2
    assert "both write" in result.err


def test_two_surfaces_share_one_box(terminal, cloud, ellipsoid, tmp_path):
    np.save(tmp_path / "inner.npy", (ellipsoid - ellipsoid.mean(axis=0)) * 0.7 + ellipsoid.mean(axis=0))
    result = terminal("fit", "--surface", f"epi={cloud}", "--surface", "endo=inner.npy", "-o", "out", "--json", *QUICK)
    assert result.code == 0
    model = read_model("out/model.json")
    assert list(model.surfaces) == ["epi", "endo"]
    assert model.input_sha256 == sha256_of(cloud, "inner.npy")
    assert files_in(tmp_path / "out") == ["model.json", "report.html", "surface-endo.ply", "surface-epi.ply"]
    record = json.loads(result.out)
    assert record["parameters"] == 397
    assert record["points"] == 800


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--surface", "endo"), "NAME=FILE"),
        (("--surface", "a/b=cloud.xyz"), "expected a name of letters"),
        (("--surface", "a=cloud.xyz", "--surface", "a=cloud.xyz"), "each name once"),
        (("cloud.xyz", "--surface", "a=cloud2.xyz"), "belongs to no"),
        (("cloud.xyz", "cloud.xyz", "--surface", "a=1"), "exactly one INPUT"),
        ((), "at least one INPUT"),
    ],
)
def test_malformed_surfaces(terminal, cloud, words, message):
    result = terminal("fit", *words)
    assert result.code == 2
    assert message in result.err


def test_strict_refuses_warnings_and_writes_nothing(terminal, ellipsoid, tmp_path):
    np.save(tmp_path / "half.npy", ellipsoid[ellipsoid[:, 2] > 104])
    warned = terminal("fit", "half.npy", "-o", "a", *BRIEF)
    assert warned.code == 0
    assert "warning: PARTIAL_COVERAGE" in warned.err
    refused = terminal("fit", "half.npy", "-o", "b", "--strict=warned", *BRIEF)
    assert refused.code == 3
    assert "'half.npy': refused for its warnings: PARTIAL_COVERAGE" in refused.err
    assert not (tmp_path / "b").exists()


# --- images ------------------------------------------------------------------------------------------------------


def test_a_mask_becomes_a_model_in_the_world(terminal, nifti, body, affine):
    path = nifti("mask.nii.gz", (body == 1).astype(np.uint8))
    result = terminal("fit", path, "-o", "out", "--json", *QUICK)
    record = json.loads(result.out)
    assert result.code == 0
    assert (record["space"], record["unit"]) == ("LPS", "mm")
    assert "label image, the object is label 1" in result.err
    assert record["error"]["rms"] < 1.0  # half a voxel
    model = read_model("out/model.json")
    centre = (affine @ [14, 13, 9, 1])[:3] * [-1, -1, 1]
    assert np.linalg.norm(model.mesh().vertices.mean(axis=0) - centre) < 1.0
    assert model.volume() == pytest.approx((body == 1).sum() * 12.0, rel=0.05)
    assert read_space_and_unit("out/surface.ply") == ("LPS", "mm")


def test_in_ras_only_the_signs_of_x_and_y_differ(terminal, nifti, body):
    path = nifti("mask.nii.gz", (body == 1).astype(np.uint8))
    assert terminal("fit", path, "-o", "lps", *BRIEF).code == 0
    done = terminal("fit", path, "-o", "ras", "--space", "RAS", "--json", *BRIEF)
    assert done.code == 0 and json.loads(done.out)["space"] == "RAS"
    there, here = read_model("ras/model.json"), read_model("lps/model.json")
    assert there.space == "RAS" and there.input_sha256 == here.input_sha256
    for name in ("origin", "edges", "control_points"):
        assert np.array_equal(getattr(there.box, name), getattr(here.box, name) * [-1, -1, 1])
    assert np.array_equal(there.superquadric().rotation, here.superquadric().rotation * [[-1], [-1], [1]])
    assert read_space_and_unit("ras/surface.ply") == ("RAS", "mm")
    np.testing.assert_allclose(
        np.sort(load("ras/surface.ply").vertices, axis=0),
        np.sort(load("lps/surface.ply").vertices * [-1, -1, 1], axis=0),
        atol=1e-4,
    )


def test_a_mesh_keeps_its_frame_unless_another_is_asked_for(terminal, ellipsoid, tmp_path):
    from scipy.spatial import ConvexHull

    hull = ConvexHull(ellipsoid)
    write_mesh(Mesh(ellipsoid, hull.simplices.astype(np.int64)), tmp_path / "ras.vtp", "RAS", "mm")
    for out, words in (("same", ()), ("lps", ("--space", "LPS"))):
        assert terminal("fit", "ras.vtp", "-o", out, *words, *BRIEF).code == 0
    same, lps = read_model("same/model.json"), read_model("lps/model.json")
    assert (same.space, lps.space) == ("RAS", "LPS")
    assert np.array_equal(lps.superquadric().translation, same.superquadric().translation * [-1, -1, 1])


def test_a_frame_that_is_not_known_cannot_be_changed(terminal, cloud, tmp_path, monkeypatch):
    from quadriform.cli import fit_run

    monkeypatch.setattr(fit_run, "fit_sources", lambda *_args, **_options: pytest.fail("worked before refusing"))
    assert_refused(terminal("fit", cloud, "-o", "out", "--space", "RAS"), 4, "frame of the world is unknown", "cloud")
    refused = terminal("fit", cloud, "-o", "out", "--space", "LAS")
    assert refused.code == 2 and "--space='LAS'" in refused.err
    assert not (tmp_path / "out").exists()


def test_labels_are_chosen_or_taken_together_with_a_note(terminal, nifti, body):
    path = nifti("labels.nii", body)
    assert "labels 1, 2 together" in terminal("fit", path, "-o", "all", *BRIEF).err
    assert terminal("fit", path, "--label", "1", "-o", "one", *BRIEF).err == ""
    assert terminal("fit", path, "--label", "2", "-o", "two", *BRIEF).code == 0
    assert read_model("two/model.json").volume() < 0.1 * read_model("one/model.json").volume()


def test_labels_as_surfaces(terminal, nifti, body):
    path = nifti("labels.nii", body)
    result = terminal("fit", path, "--surface", "a=1", "--surface", "b=2", "-o", "out", *BRIEF)
    assert result.code == 0
    assert list(read_model("out/model.json").surfaces) == ["a", "b"]


def test_otsu_is_noted_where_no_threshold_is_given(terminal, nifti, body, rng):
    path = nifti("grey.nii.gz", (body == 1) * 1000.0 + rng.normal(size=body.shape))
    assert "Otsu" in terminal("fit", path, "-o", "out", *BRIEF).err


def test_region_border_and_frame(terminal, nifti, body):
    path = nifti("cine.nii", np.stack([body == 1, body == 2], axis=-1).astype(np.uint8))
    assert terminal("fit", path).code == 4
    words = ("--frame", "0", "--region", "0:32,0:26,0:9", *BRIEF)
    opened = terminal("fit", path, *words, "-o", "open", "--border", "open", "--json")
    closed = terminal("fit", path, *words, "-o", "closed", "--border", "close", "--json")
    assert "BORDER_CUT" in opened.err
    assert "BORDER_CUT" in closed.err
    assert json.loads(closed.out)["points"] > json.loads(opened.out)["points"]


# --- what is refused ---------------------------------------------------------------------------------------------

BAD_TEXT = {
    "nan.xyz": ("1 2 3\n1 nan 3\n", 4, "not finite"),
    "few.xyz": ("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n", 4, "expected at least 11"),
    "flat.xyz": ("".join(f"{i} {i * i} 0\n" for i in range(30)), 4, "coplanar"),
    "line.xyz": ("".join(f"{i} {i} {i}\n" for i in range(30)), 4, "collinear"),
    "ragged.csv": ("1,2,3\n1,2\n", 4, "line 2"),
    "comma.csv": ("1,5;2;3\n", 4, "decimal commas"),
    "empty.xyz": ("", 4, "empty"),
    "wrong.ply": ("1 2 3\n", 4, "PLY header"),
    "wrong.npy": ("1 2 3\n", 4, "npy"),
    "wrong.nii": ("1 2 3\n", 4, "NIfTI"),
    "what.dat": ("1 2 3\n", 4, "suffix"),
}


def assert_refused(result, code, message, name):
    assert result.code == code
    assert result.out == ""
    lines = result.err.splitlines()
    assert len([line for line in lines if not line.startswith("note: ")]) == 1
    assert lines[-1].startswith("quadriform: ")
    assert message in lines[-1]
    assert name in lines[-1]


@pytest.mark.parametrize("name", BAD_TEXT)
def test_bad_files_give_one_line_and_nothing_else(terminal, tmp_path, name):
    content, code, message = BAD_TEXT[name]
    (tmp_path / name).write_text(content)
    assert_refused(terminal("fit", name, "-o", "out"), code, message, name)
    assert files_in(tmp_path) == [name]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((5, 5, 5), np.uint8), "mask is empty"),
        (np.ones((5, 5, 5), np.uint8), "mask is full"),
        (np.pad(np.ones((1, 1, 1), np.uint8), 2), "one voxel"),
        (np.pad(np.ones((1, 4, 4), np.uint8), 2), "one slice"),
        (np.full((5, 5, 5), np.nan), "finite|NaN|not a number"),
        (np.zeros((5, 5, 5, 2), np.uint8), "four-dimensional"),
    ],
)
def test_bad_images_give_one_line_and_nothing_else(terminal, nifti, tmp_path, values, message):
    nifti("bad.nii", values)
    result = terminal("fit", "bad.nii", "-o", "out")
    assert_refused(result, 4, next((m for m in message.split("|") if m in result.err), message), "bad.nii")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("where", ["missing.xyz", "missing.nii", "missing.ply", "folder", "cloud.xyz/below.xyz"])
def test_inputs_that_are_not_there(terminal, cloud, tmp_path, where):
    (tmp_path / "folder").mkdir()
    assert_refused(terminal("fit", where, "-o", "out"), 4, "", where)


@pytest.mark.parametrize("out", ["cloud.xyz", "cloud.xyz/out", "/proc/out", "x" * 300])
def test_outputs_that_cannot_be_written_are_refused_before_the_work(terminal, cloud, tmp_path, out, monkeypatch):
    from quadriform.cli import fit_run

    monkeypatch.setattr(fit_run, "read_source", lambda *_args: pytest.fail("computed before checking the output"))
    before = cloud.read_bytes()
    assert_refused(terminal("fit", cloud, "-o", out), 5, "", out)
    assert cloud.read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ("--box", "5,5"),
        ("--box", "5,5,x"),
        ("--box", "1,5,5"),
        ("--kind", "cube"),
        ("--box", "large"),
        ("--box", "auto"),
        ("--max-error", "1"),
        ("--max-error", "small"),
        ("--regularity", "magic"),
        ("--regularity", "svd"),
        ("--method", "paper", "--regularity", "bending"),
        ("--matching", "data-to-model"),
        ("--method", "paper", "--matching", "magic"),
        ("--method", "paper", "--no-robust"),
        ("--method", "paper", "--base", "0,0,0/0,0,1"),
        ("--base", "0,0,0"),
        ("--base", "0,0,0/0,0"),
        ("--base", "0,0,0/0,0,0"),
        ("--viewpoint", "0,0"),
        ("--viewpoint", "above"),
        ("--support", "0,0,-90"),
        ("--support", "0,0,-90/0,0,0"),
        ("--method", "paper", "--viewpoint", "0,0,900"),
        ("--method", "magic"),
        ("--strength", "strong"),
        ("--strength", "nan"),
        ("--iterations", "3"),
        ("--method", "paper", "--iterations", "-1"),
        ("--method", "paper", "--iterations", "x"),
        ("--label", "1", "--threshold", "3"),
        ("--label", "one"),
        ("--label", "1"),
        ("--threshold", "3"),
        ("--frame", "0"),
        ("--closing", "1"),
        ("--fill-holes",),
        ("--border", "close"),
        ("--threshold", "high"),
        ("--region", "1:2"),
        ("--seed", "1,2"),
        ("--colour",),
    ],
)
def test_wrong_options_are_usage_errors(terminal, cloud, tmp_path, words):
    result = terminal("fit", cloud, "-o", "out", *words)
    assert result.code == 2
    assert len(result.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_name_with_anything_in_it(terminal, cloud, tmp_path):
    name = "Herz groß [bold]心.xyz"
    cloud.rename(tmp_path / name)
    result = terminal("fit", name, "-o", "out ä", *BRIEF)
    assert result.code == 0
    assert "[bold]" in result.out
    assert len(read_points(name)) == 400


def test_a_real_image(terminal, shared):
    heart = shared / "data/spect_mpi/nifti/mpi_rest_1.nii.gz"
    words = ("--region", "17:53,12:52,10:34", "--threshold", "50%p99.9", "--json", *QUICK)
    result = terminal("fit", heart, "-o", "out", *words)
    record = json.loads(result.out)
    assert result.code == 0
    assert record["space"] == "LPS"
    assert record["error"]["rms"] < record["superquadric_rms"]


def test_a_mesh_of_few_vertices_is_sampled_by_area_and_that_is_recorded(terminal, tmp_path, monkeypatch):
    monkeypatch.setattr("quadriform.shapes.mesh_points.SAMPLES", 500)
    block = box_mesh()
    for suffix in (".stl", ".ply", ".obj", ".vtp"):
        write_mesh(block, tmp_path / f"block{suffix}", "LPS", "mm")
    result = terminal("fit", "block.stl", "-o", "out", "--json", *BRIEF)
    record = json.loads(result.out)
    assert result.code == 0 and record["points"] == 500
    assert "spread evenly over the area of 12 triangles" in record["notes"][0]
    assert "spread evenly" in " ".join(terminal("fit", "block.ply", "-o", "paper", *BRIEF).out.split())
    assert read_points("block.stl").shape == (8, 3)


def test_a_mesh_of_dense_vertices_is_fitted_as_its_vertices(terminal, tmp_path, ellipsoid):
    mesh = made().mesh(8)
    write_mesh(mesh, tmp_path / "dense.vtp")
    np.savetxt("dense.xyz", mesh.vertices, fmt="%.17g")
    for name in ("dense.vtp", "dense.xyz"):
        assert terminal("fit", name, "-o", name[-3:], *BRIEF).code == 0
    one, two = (read_model(f"{name}/model.json") for name in ("vtp", "xyz"))
    assert np.array_equal(one.box.control_points, two.box.control_points)
