"""The subcommands beside fit, track, compare and measure: segment, deform, export, info."""

import json
from dataclasses import replace

import nibabel
import numpy as np
import pytest
from priors_made import meshes

from quadriform.files import load, read_points, save, sha256_of
from quadriform.files.meshes import read_space_and_unit, write_mesh
from quadriform.priors.learning import learn_prior
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric


@pytest.fixture
def model(tmp_path, rng):
    superquadric = Superquadric(semi_axes=(30, 20, 12), translation=(5, -7, 100))
    box = ControlBox.around(superquadric)
    moved = box.control_points + rng.normal(size=box.control_points.shape)
    made = DeformableModel({"surface": superquadric}, box.with_control_points(moved), "LPS", "mm")
    save(made, tmp_path / "model.json")
    return made


# --- segment -----------------------------------------------------------------------------------------------------


def test_a_mask_lies_where_its_image_lies(terminal, nifti, body, affine):
    path = nifti("labels.nii.gz", body)
    result = terminal("segment", path, "--label", "1", "-o", "mask.nii.gz", "--json")
    assert result.code == 0
    mask = nibabel.load("mask.nii.gz")
    assert np.array_equal(mask.affine, nibabel.load(path).affine)
    assert np.array_equal(np.asarray(mask.dataobj), body == 1)
    assert mask.get_data_dtype() == np.uint8
    assert json.loads(result.out)["voxels"] == (body == 1).sum()
    again = terminal("segment", "mask.nii.gz", "-o", "again.nii")
    assert again.code == 0
    assert np.array_equal(np.asarray(nibabel.load("again.nii").dataobj), body == 1)


def test_a_mask_has_one_transform_and_no_private_parts(terminal, tmp_path, body, affine):
    """Of two transforms that disagree the mask has the one that was used, so that others read it as we did."""
    image = nibabel.Nifti1Image(body.astype(np.float32) * 0.5, affine)
    image.set_sform(np.diag([-1.0, 1, 1, 1]), 2)
    image.set_qform(affine, 1)
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"a patient's name"))
    image.header["cal_max"] = 0.1
    nibabel.save(image, tmp_path / "in.nii")
    assert terminal("segment", "in.nii", "--threshold", "0.3", "-o", "out.nii").code == 0
    out = nibabel.load("out.nii")
    assert np.allclose(out.get_sform(), affine, atol=1e-5)
    assert np.allclose(out.get_qform(), affine, atol=1e-5)
    assert out.header["cal_max"] == 0
    assert b"patient" not in (tmp_path / "out.nii").read_bytes()
    assert set(np.unique(out.dataobj)) == {0, 1}


def test_one_frame_of_four_dimensions(terminal, nifti, body):
    path = nifti("cine.nii", np.stack([body == 2, body == 1], axis=-1).astype(np.uint8))
    assert terminal("segment", path, "--frame", "1", "-o", "out.nii.gz").code == 0
    assert np.array_equal(np.asarray(nibabel.load("out.nii.gz").dataobj), body == 1)


@pytest.mark.parametrize("threshold", ["otsu", "400", "50%p99.9", "50.5%p99"])
def test_thresholds(terminal, nifti, body, rng, threshold):
    path = nifti("grey.nii.gz", (body == 1) * 1000.0 + rng.normal(size=body.shape))
    assert terminal("segment", path, "--threshold", threshold, "-o", "mask.nii").code == 0
    assert np.array_equal(np.asarray(nibabel.load("mask.nii").dataobj), body == 1)


def test_what_is_taken_as_labels(terminal, nifti, body):
    steps = np.arange(body.size).reshape(body.shape) % 40
    for name, values, assumed in [
        ("whole", body.astype(np.float32), "labels 1, 2 together"),
        ("mask", (body == 1).astype(np.uint8) * 255, "label 255"),
        ("halves", body.astype(np.float32) / 2, "grey image"),
        ("many", (1000 * (body == 1) + steps).astype(np.int16), "grey image"),
    ]:
        result = terminal("segment", nifti(f"{name}.nii", values), "-o", f"{name}-mask.nii")
        assert result.code == 0
        assert assumed in result.err


def test_a_percentile_alone_is_the_threshold(terminal, nifti, body):
    path = nifti("grey.nii", np.arange(body.size, dtype=np.float32).reshape(body.shape))
    record = json.loads(terminal("segment", path, "--threshold", "p75", "-o", "mask.nii", "--json").out)
    assert record["threshold"] == pytest.approx(0.75 * (body.size - 1), rel=1e-9)


def test_seed_closing_holes_and_region(terminal, nifti, body):
    hollow = np.where(body == 1, 1, 0).astype(np.uint8) + (body == 2)
    hollow[12:16, 11:15, 8:11] = 0
    path = nifti("hollow.nii", hollow)

    def voxels(*words):
        return json.loads(terminal("segment", path, "-o", "mask.nii", "--force", "--json", *words).out)["voxels"]

    assert voxels() == (body == 1).sum() - 4 * 4 * 3
    assert voxels("--fill-holes") == voxels("--closing", "3") == (body == 1).sum()
    assert voxels("--seed", "29,21,3") == (body == 2).sum()
    assert voxels("--region", "27:32,19:26,1:7") == (body == 2).sum()
    assert "kept 1 of 2" in terminal("segment", path, "-o", "mask.nii", "--force").err


def test_segment_refuses(terminal, nifti, body, tmp_path):
    path = nifti("labels.nii", body)
    before = path.read_bytes()
    for words, code, message in [
        ((path, "-o", path), 5, "the input itself"),
        ((path, "-o", "a/b.nii"), 5, "does not exist"),
        ((path, "-o", "mask.png"), 2, ".nii or .nii.gz or .nrrd"),
        ((path, "-o", "mask.nii", "--label", "7"), 4, "no voxel has the label 7"),
        ((path, "-o", "mask.nii", "--seed", "0,0,0"), 4, "labels.nii"),
        ((path, "-o", "mask.nii", "--region", "0:99,0:2,0:2"), 2, "region"),
        ((path, "-o", "mask.nii", "--region", "0:14,0:26,0:18", "--label", "1", "--strict=warned"), 3, "BORDER_CUT"),
        (("missing.nii", "-o", "mask.nii"), 4, "no such file"),
    ]:
        result = terminal("segment", *words)
        assert result.code == code
        assert message in result.err.splitlines()[-1]
        assert result.out == ""
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["labels.nii"]


# --- deform ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".npy", ".npz"])
def test_deform_is_the_map_of_the_model_and_inverse_undoes_it(terminal, model, ellipsoid, tmp_path, suffix):
    inside = (ellipsoid - [5, -7, 100]) * 0.8 + [5, -7, 100]
    np.save(tmp_path / "in.npy", inside)
    assert terminal("deform", "model.json", "in.npy", "-o", f"out{suffix}").code == 0
    assert np.array_equal(read_points(f"out{suffix}"), model.deform(inside))
    assert terminal("deform", "model.json", f"out{suffix}", "-o", "back.npy", "--inverse", "--json").code == 0
    assert np.abs(read_points("back.npy") - inside).max() < 1e-9 * 100


def test_deform_carries_a_mesh(terminal, model, tmp_path):
    flat = model.superquadric().mesh(5)
    save(flat, tmp_path / "in.vtp")
    assert terminal("deform", "model.json", "in.vtp", "-o", "out.vtp").code == 0
    out = load("out.vtp")
    assert np.array_equal(out.faces, flat.faces)
    assert np.array_equal(out.vertices, model.deform(flat.vertices))
    assert b'Name="SPACE"' in (tmp_path / "out.vtp").read_bytes()


def test_deform_brings_a_mesh_of_the_other_frame_to_the_models(terminal, model, tmp_path):
    flat = model.superquadric().mesh(5)
    write_mesh(type(flat)(flat.vertices * [-1, -1, 1], flat.faces), tmp_path / "ras.vtp", "RAS", "mm")
    write_mesh(flat, tmp_path / "metres.vtp", "LPS", "m")
    done = terminal("deform", "model.json", "ras.vtp", "-o", "out.vtp")
    assert done.code == 0 and "ras.vtp: brought from RAS to LPS" in done.err
    assert read_space_and_unit("out.vtp") == ("LPS", "mm")
    assert np.array_equal(load("out.vtp").vertices, model.deform(flat.vertices))
    assert terminal("deform", "model.json", "ras.vtp", "-o", "back.vtp", "--space", "RAS").code == 0
    assert read_space_and_unit("back.vtp") == ("RAS", "mm")
    assert np.array_equal(load("back.vtp").vertices, model.deform(flat.vertices) * [-1, -1, 1])
    refused = terminal("deform", "model.json", "metres.vtp", "-o", "other.vtp")
    assert refused.code == 4 and "metres.vtp" in refused.err and "found m" in refused.err
    assert not (tmp_path / "other.vtp").exists()


def test_deform_refuses(terminal, model, cloud, tmp_path):
    for words, code, message in [
        (("model.json", cloud, "-o", cloud), 5, "the input itself"),
        (("model.json", cloud, "-o", "model.json"), 4, "suffix"),
        (("model.json", cloud, "-o", "out.ply"), 4, "suffix"),
        (("model.json", "missing.xyz", "-o", "out.xyz"), 4, "no such file"),
        (("model.json", cloud, "-o", "out.xyz", "--space", "world"), 2, "--space='world'"),
        ((cloud, cloud, "-o", "out.xyz"), 4, "a model cannot have the suffix"),
        (("model.json", cloud), 2, "output"),
    ]:
        result = terminal("deform", *words)
        assert result.code == code
        assert message in result.err
    (tmp_path / "far.xyz").write_text("1e6 1e6 1e6\n")
    result = terminal("deform", "model.json", "far.xyz", "-o", "out.xyz", "--inverse")
    assert result.code == 4
    assert "far.xyz" in result.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cloud.xyz", "far.xyz", "model.json"]


# --- export ------------------------------------------------------------------------------------------------------


def test_export_writes_every_format(terminal, model):
    result = terminal(
        "export", "model.json", "--to", "ply,stl, obj,VTP", "-o", "new/deep", "--resolution", "7", "--json"
    )
    assert result.code == 0
    names = [f"new/deep/surface.{kind}" for kind in ("ply", "stl", "obj", "vtp")]
    assert json.loads(result.out)["outputs"] == names
    for name in names:
        assert load(name).volume() == pytest.approx(model.mesh(resolution=7).volume(), rel=1e-5)


def test_export_names_the_surfaces(terminal, model, tmp_path):
    two = DeformableModel({"endo": model.superquadric(), "epi": model.superquadric()}, model.box)
    save(two, tmp_path / "two.npz")
    result = terminal("export", "two.npz", "--to", "ply", "-o", ".")
    assert result.out.split() == ["surface-endo.ply", "surface-epi.ply"]


def test_export_in_ras(terminal, model, tmp_path):
    assert terminal("export", "model.json", "--to", "ply,stl,obj,vtp", "-o", "ras", "--space", "RAS").code == 0
    wanted = model.mesh().vertices * [-1, -1, 1]
    for kind in ("ply", "stl", "obj", "vtp"):
        assert read_space_and_unit(f"ras/surface.{kind}") == ("RAS", "mm")
        near = load(f"ras/surface.{kind}")
        assert near.volume() == pytest.approx(model.mesh().volume(), rel=1e-5)
        np.testing.assert_allclose(
            [near.vertices.min(0), near.vertices.max(0)], [wanted.min(0), wanted.max(0)], atol=1e-4
        )
    save(replace(model, space="unknown"), tmp_path / "somewhere.json")
    refused = terminal("export", "somewhere.json", "--to", "ply", "-o", "none", "--space", "RAS")
    assert refused.code == 4 and "somewhere.json" in refused.err and "unknown" in refused.err
    assert terminal("export", "model.json", "--to", "ply", "-o", "none", "--space", "ras").code == 2
    assert not (tmp_path / "none").exists()


def test_labels_lie_in_the_same_voxels_whatever_the_frame(terminal, tmp_path, nifti, body):
    """Of a model in RAS, and of one in LPS that is asked for in RAS."""
    surface = Superquadric(semi_axes=(14, 10, 12), translation=(28, -24, -3))
    lps = DeformableModel({"surface": surface}, ControlBox.around(surface), "LPS", "mm")
    save(lps, tmp_path / "lps.json")
    save(lps.in_space("RAS"), tmp_path / "ras.json")
    words = ("--to", "nii", "--like", nifti("like.nii.gz", body), "-o")
    for file, out, more in (("lps", "a", ()), ("ras", "b", ()), ("lps", "c", ("--space", "RAS"))):
        assert terminal("export", f"{file}.json", *words, out, *more).code == 0
    found = [np.asarray(nibabel.load(f"{out}/labels.nii.gz").dataobj) for out in "abc"]
    assert found[0].sum() > 200
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_labels_lie_on_the_grid_of_the_transform_that_is_asked_for(terminal, model, body):
    image = nibabel.Nifti1Image(body, np.diag([-1.0, -1, 1, 1]))
    image.header.set_zooms((2, 2, 3))  # the sform says 1, and there is no qform to decide
    image.header["qform_code"] = 0
    image.header.set_xyzt_units("mm")
    nibabel.save(image, "torn.nii.gz")
    save(replace(load("model.json"), space="LPS", unit="mm"), "marked.json")
    words = ("export", "marked.json", "--to", "nii", "--like", "torn.nii.gz", "-o", "out")
    assert "--affine sform" in terminal(*words).err
    assert terminal(*words, "--affine", "sform").code == 0
    assert np.array_equal(nibabel.load("out/labels.nii.gz").affine, np.diag([-1.0, -1, 1, 1]))
    refused = terminal("export", "marked.json", "--to", "ply", "-o", "out2", "--affine", "sform")
    assert refused.code == 2 and "--like" in refused.err


def test_export_asks_for_all_its_files_before_the_work(terminal, model, tmp_path, monkeypatch):
    """The last of them exists already; the first is not even made."""
    from quadriform.cli import export

    (tmp_path / "surface.vtp").write_bytes(b"mine")
    monkeypatch.setattr(export, "_encode", lambda *_args: pytest.fail("worked before asking"))
    refused = terminal("export", "model.json", "--to", "ply,vtp", "-o", ".")
    assert refused.code == 5 and "surface.vtp': exists already" in refused.err
    assert not (tmp_path / "surface.ply").exists()


def test_export_refuses(terminal, model, tmp_path):
    (tmp_path / "surface.obj").write_text("mine")
    for words, code, message in [
        (("--to", "ply,pdf", "-o", "out"), 2, "--to='pdf'"),
        (("--to", "ply,obj", "-o", "."), 5, "exists already"),
        (("--to", "ply", "-o", "model.json"), 5, "folder"),
        (("--to", "ply", "-o", "out", "--resolution", "1"), 2, "resolution"),
        (("--to", "ply"), 2, "output"),
    ]:
        result = terminal("export", "model.json", *words)
        assert result.code == code
        assert message in result.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.json", "surface.obj"]
    assert (tmp_path / "surface.obj").read_text(encoding="utf-8") == "mine"
    assert terminal("export", "model.json", "--to", "obj", "-o", ".", "--force").code == 0


# --- info --------------------------------------------------------------------------------------------------------


def described(terminal, *words):
    result = terminal("info", *words, "--json")
    assert result.code == 0
    record = json.loads(result.out)
    table = terminal("info", *words)
    assert table.code == 0
    assert record["kind"] in table.out
    assert record["sha256"] == sha256_of(words[0])
    return record


def test_info_on_points(terminal, cloud, ellipsoid):
    record = described(terminal, cloud)
    assert (record["kind"], record["points"], record["unit"]) == ("points", 400, "unknown")
    assert record["extent"]["lowest"] == ellipsoid.min(axis=0).tolist()


def test_info_on_a_mesh_and_a_cloud_in_a_mesh_format(terminal, model, tmp_path):
    save(model, tmp_path / "m.stl")
    record = described(terminal, "m.stl")
    mesh = model.mesh()
    assert (record["kind"], record["vertices"], record["triangles"]) == ("mesh", len(mesh.vertices), len(mesh.faces))
    assert (record["space"], record["unit"]) == ("LPS", "mm")
    (tmp_path / "p.obj").write_text("v 0 0 0\nv 1 0 0\n")
    assert described(terminal, "p.obj")["points"] == 2


def test_info_on_an_image(terminal, nifti, body, affine):
    path = nifti("labels.nii.gz", body)
    record = described(terminal, path)
    assert record["voxels"] == list(body.shape)
    assert record["spacing"] == pytest.approx([2, 2, 3], rel=1e-6)
    assert (record["space"], record["unit"]) == ("LPS", "mm")
    corner = (affine @ [*(np.array(body.shape) - 1), 1])[:3] * [-1, -1, 1]
    low, high = np.array(record["extent"]["lowest"]), np.array(record["extent"]["highest"])
    assert ((low - 1e-4 <= corner) & (corner <= high + 1e-4)).all()


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_info_on_a_model(terminal, model, tmp_path, suffix):
    save(model, tmp_path / f"m{suffix}")
    record = described(terminal, f"m{suffix}")
    assert record["surfaces"] == {"surface": "ellipsoid"}
    assert record["parameters"] == 386
    assert record["control_points"] == [5, 5, 5]
    assert record["input_sha256"] == "unknown"


def test_a_prior_is_described_and_is_no_model(terminal):
    prior = learn_prior(meshes(), box=(3, 3, 3), unit="mm")
    save(prior, "lv.prior.npz")
    found = json.loads(terminal("info", "lv.prior.npz", "--json").out)
    assert (found["kind"], found["models"], found["modes"], found["unit"]) == ("prior", 8, 3, "mm")
    assert found["leave_one_out"] == prior.report.leave_one_out
    assert found["standard deviations"] == prior.deviations.tolist()
    for words in (("export", "lv.prior.npz", "--to", "ply", "-o", "out"), ("compare", "lv.prior.npz", "lv.prior.npz")):
        result = terminal(*words)
        assert result.code in (2, 4) and "found a prior" in result.err


def test_info_distinguishes_points_from_models_in_npz(terminal, tmp_path):
    np.savez(tmp_path / "p.npz", points=np.eye(3))
    assert described(terminal, "p.npz")["kind"] == "points"


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.json", "{}"), ("a.npz", "x"), ("a.ply", "ply\n"), ("a.nii", "x"), ("a.xyz", "x y\n"), ("a.pdf", "x")],
)
def test_info_refuses(terminal, tmp_path, name, content):
    (tmp_path / name).write_text(content)
    result = terminal("info", name)
    assert result.code == 4
    assert len(result.err.splitlines()) == 1
    assert name in result.err


def test_export_writes_wall_film_and_labels(terminal, tmp_path, nifti, body):
    h5py = pytest.importorskip("h5py")
    inner, outer = Superquadric(semi_axes=(10, 8, 12)), Superquadric(semi_axes=(15, 13, 20))
    save(DeformableModel({"epi": outer, "endo": inner}, ControlBox.around(outer), "LPS", "mm"), tmp_path / "two.json")
    like = nifti("like.nii.gz", body)
    words = ("export", "two.json", "--to", "vtu,vtkhdf,nii", "--like", like, "-o", "out", "--resolution", 4)
    assert terminal(*words).code == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"wall.vtu", "surfaces.vtkhdf", "labels.nii.gz"}
    assert terminal(*words[:4], "--like", like, "-o", "ras", "--resolution", 4, "--space", "RAS").code == 0
    assert read_space_and_unit("ras/wall.vtu") == ("RAS", "mm")
    with h5py.File("ras/surfaces.vtkhdf") as file:
        assert file["VTKHDF"].attrs["SPACE"] == b"RAS"
    assert nibabel.load("out/labels.nii.gz").shape == body.shape
    assert terminal(*words).code == 5
    refused = terminal("export", "two.json", "--to", "nii", "-o", "other")
    assert refused.code == 2 and "--like" in refused.err
    assert not (tmp_path / "other").exists()
