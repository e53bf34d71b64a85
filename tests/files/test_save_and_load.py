"""`save` and `load` choose by type and suffix."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from quadriform.errors import FileFormatError, InputError, OptionError, OutputError
from quadriform.files.reading import sha256_of
from quadriform.files.save_and_load import load, save
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_models(tmp_path, model, suffix):
    save(model, tmp_path / f"m{suffix}")
    back = load(str(tmp_path / f"m{suffix}"))
    assert isinstance(back, DeformableModel)
    assert np.array_equal(back.box.control_points, model.box.control_points)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".vtp"])
def test_meshes_and_the_surface_of_a_model(tmp_path, model, mesh, suffix):
    save(mesh, tmp_path / f"mesh{suffix}")
    save(model, tmp_path / f"model{suffix}")
    assert isinstance(load(tmp_path / f"mesh{suffix}"), Mesh)
    assert load(tmp_path / f"model{suffix}").volume() == pytest.approx(model.mesh().volume(), rel=1e-5)


def test_the_surface_of_a_model_keeps_its_frame(tmp_path, model):
    save(model, tmp_path / "m.ply")
    assert b"SPACE=LPS UNIT=mm" in (tmp_path / "m.ply").read_bytes()[:100]


def test_what_cannot_be_saved(tmp_path, model, mesh):
    with pytest.raises(OptionError, match="found ndarray"):
        save(np.zeros((3, 3)), tmp_path / "m.json")
    with pytest.raises(FileFormatError, match=r"'\.json'"):
        save(mesh, tmp_path / "m.json")
    with pytest.raises(FileFormatError, match=r"'\.pkl'"):
        save(model, tmp_path / "m.pkl")
    two = replace(model, surfaces={"endo": model.superquadric(), "epi": model.superquadric()})
    with pytest.raises(OptionError, match="'endo', 'epi'; choose one"):
        save(two, tmp_path / "m.ply")
    assert not list(tmp_path.iterdir())
    (tmp_path / "m.pkl").write_bytes(b"\x80\x04N.")
    with pytest.raises(FileFormatError, match=r"'\.pkl'"):
        load(tmp_path / "m.pkl")


def test_nothing_is_overwritten_unasked(tmp_path, model):
    path = tmp_path / "m.json"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        save(model, path)
    assert path.read_text(encoding="utf-8") == "mine"
    save(model, path, force=True)
    load(path)


def test_hash_of_one_file_and_of_several(tmp_path):
    (tmp_path / "a").write_bytes(b"one")
    (tmp_path / "b").write_bytes(b"two")
    assert sha256_of(tmp_path / "a") == hashlib.sha256(b"one").hexdigest()
    assert sha256_of(tmp_path / "a", tmp_path / "b") == hashlib.sha256(b"onetwo").hexdigest()
    with pytest.raises(InputError):
        sha256_of(tmp_path / "c")
