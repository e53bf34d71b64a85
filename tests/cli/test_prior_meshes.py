"""`quadriform prior` of meshes whose vertices correspond."""

import numpy as np
import pytest
from priors_made import meshes, wall

import quadriform as qf
from quadriform.files import write_mesh


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "meshes").mkdir()
    for number, mesh in enumerate(meshes()):
        write_mesh(mesh, tmp_path / "meshes" / f"{number}.ply", "LPS", "mm")
    return tmp_path / "meshes"


def test_a_folder_of_meshes_gives_the_prior_of_python(terminal, folder):
    assert terminal("prior", folder, "-o", "lv.prior.npz").code == 0
    found, expected = qf.load("lv.prior.npz"), qf.learn_prior(meshes())
    np.testing.assert_allclose(found.variances, expected.variances, rtol=1e-6)
    assert found.n_models == 8 and list(found.surfaces) == ["surface"] and (found.space, found.unit) == ("LPS", "mm")


def test_files_of_surfaces_are_in_a_folder_for_each_member(terminal, tmp_path):
    for number, mesh in enumerate(meshes()):
        (tmp_path / "hearts" / str(number)).mkdir(parents=True)
        for name, one in wall(mesh).items():  # both ways of naming
            write_mesh(one, tmp_path / "hearts" / str(number) / (f"{name}.ply" if number else f"surface-{name}.ply"))
    assert terminal("prior", "hearts", "-o", "lv.prior.npz", "--box", "4,4,4").code == 0
    found = qf.load("lv.prior.npz")
    assert list(found.surfaces) == ["endo", "epi"] and found.box.control_points.shape[:3] == (4, 4, 4)


@pytest.mark.parametrize("what", ("vertices", "triangles"))
def test_a_mesh_without_correspondence_is_named(terminal, folder, what):
    mesh = meshes()[5]
    other = qf.Mesh(mesh.vertices[:-1], mesh.faces[(mesh.faces < len(mesh.vertices) - 1).all(axis=1)])
    changed = other if what == "vertices" else qf.Mesh(mesh.vertices, mesh.faces[::-1])
    write_mesh(changed, folder / "5.ply", "LPS", "mm", force=True)
    result = terminal("prior", folder, "-o", "lv.prior.npz")
    assert result.code == 4 and "5.ply" in result.err and "0.ply" in result.err and "correspond" in result.err


def test_a_member_with_other_surfaces_or_another_unit_is_named(terminal, folder):
    write_mesh(meshes()[7], folder / "7.ply", "LPS", "m", force=True)
    assert "7.ply" in terminal("prior", folder, "-o", "lv.prior.npz").err
    (folder / "8").mkdir()
    write_mesh(meshes()[7], folder / "8" / "endo.ply")
    result = terminal("prior", folder, "-o", "lv.prior.npz")
    assert "expected the surfaces surface" in result.err and "found endo" in result.err


def test_two_files_of_one_surface_are_refused(terminal, tmp_path):
    (tmp_path / "hearts" / "0").mkdir(parents=True)
    for name in ("endo.ply", "surface-endo.ply"):
        write_mesh(meshes()[0], tmp_path / "hearts" / "0" / name)
    assert "another" in terminal("prior", "hearts", "-o", "lv.prior.npz").err
