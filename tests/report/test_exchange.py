"""The same surface in other libraries: no vertex moves, and the unit and the frame go along."""

import sys

import numpy as np
import pytest

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.heart.synthetic import SyntheticVentricle

MODEL = SyntheticVentricle().model(0.3)
BOTH = pytest.mark.parametrize("convert", [qf.to_trimesh, qf.to_pyvista], ids=["trimesh", "pyvista"])


@pytest.fixture
def pyvista():
    return pytest.importorskip("pyvista", reason="pyvista (extra viz) is not installed")


def test_trimesh_has_the_same_vertices_and_volume():
    mesh, shell = MODEL.mesh("endo", 8), qf.to_trimesh(MODEL, "endo", resolution=8)
    assert np.array_equal(shell.vertices, mesh.vertices) and np.array_equal(shell.faces, mesh.faces)
    assert shell.is_watertight and np.isclose(shell.volume, mesh.volume(), rtol=1e-12)
    assert (shell.units, shell.metadata["space"], shell.metadata["status"]) == ("mm", "LPS", "unknown")


def test_a_mesh_goes_over_as_it_is_and_claims_no_unit():
    mesh = MODEL.mesh("epi", 4)
    shell = qf.to_trimesh(mesh)
    assert np.array_equal(shell.vertices, mesh.vertices)
    assert shell.units is None and shell.metadata["space"] == "unknown"


def test_writing_into_the_copy_leaves_the_mesh_alone():
    mesh = MODEL.mesh("epi", 4)
    before = mesh.vertices.copy()
    qf.to_trimesh(mesh).vertices[:] = 0.0
    assert np.array_equal(mesh.vertices, before)


def test_pyvista_has_the_same_vertices_and_volume(pyvista):
    mesh, shell = MODEL.mesh("endo", 8), qf.to_pyvista(MODEL, "endo", resolution=8)
    assert np.array_equal(shell.points, mesh.vertices) and np.array_equal(shell.regular_faces, mesh.faces)
    assert shell.points.dtype == np.float64 and shell.is_manifold
    assert np.isclose(shell.volume, mesh.volume(), rtol=1e-9)
    assert [str(shell.field_data[key][0]) for key in ("SPACE", "UNIT")] == ["LPS", "mm"]


def test_writing_into_the_pyvista_copy_leaves_the_mesh_alone(pyvista):
    mesh = MODEL.mesh("epi", 4)
    before = mesh.vertices.copy()
    qf.to_pyvista(mesh).points[:] = 0.0
    assert np.array_equal(mesh.vertices, before)


@BOTH
def test_of_several_surfaces_one_must_be_named(convert):
    with pytest.raises(OptionError, match="'epi', 'endo'"):
        convert(MODEL)
    with pytest.raises(OptionError, match="unknown"):
        convert(MODEL, "lumen")
    with pytest.raises(OptionError, match="found str"):
        convert("model.json")


def test_without_pyvista_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(OptionError, match=r"pip install 'quadriform\[viz\]'"):
        qf.to_pyvista(MODEL, "endo")
