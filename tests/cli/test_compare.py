"""`compare`."""

import json

import numpy as np
import pytest

from quadriform.files import save
from quadriform.files.meshes import write_mesh
from quadriform.shapes import comparison
from quadriform.shapes.comparison import dice, surface_distances
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import NOT_RECORDED
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric

INNER, OUTER = (Superquadric(semi_axes=axes, translation=(5, -7, 100)) for axes in ((20, 16, 12), (23, 19, 15)))


def model(superquadric, unit="mm", name="surface"):
    return DeformableModel({name: superquadric}, ControlBox.around(superquadric), "LPS", unit)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """a.json, b.npz, the two in one box, a mesh of each kind of mark, one open."""
    monkeypatch.setattr(comparison, "SAMPLES", 1000)  # quicker, and the same on both sides of each test
    monkeypatch.setattr(comparison, "RESOLUTION", 16)
    save(model(INNER), tmp_path / "a.json")
    save(model(OUTER), tmp_path / "b.npz")
    both = DeformableModel({"epi": OUTER, "endo": INNER}, ControlBox.around(OUTER), "LPS", "mm")
    save(both, tmp_path / "both.json")
    save(model(INNER, unit="m"), tmp_path / "metres.json")
    mesh = model(OUTER).mesh(resolution=16)
    write_mesh(mesh, tmp_path / "b.vtp", "LPS", "mm")
    write_mesh(type(mesh)(mesh.vertices * [-1, -1, 1], mesh.faces), tmp_path / "ras.ply", "RAS", "mm")
    write_mesh(mesh, tmp_path / "unknown.stl")
    write_mesh(type(mesh)(mesh.vertices, mesh.faces[9:]), tmp_path / "open.obj", "LPS", "mm")


def compared(terminal, *words):
    result = terminal("compare", *words, "--json")
    assert result.code == 0, result.err
    return json.loads(result.out)


def test_numbers_are_those_of_the_library(terminal, files):
    record = compared(terminal, "a.json", "b.npz")
    there, back = surface_distances(model(INNER), model(OUTER))
    assert record["a_to_b"] == vars(there) and record["b_to_a"] == vars(back)
    assert record["hausdorff"] == max(there.largest, back.largest)
    assert record["dice"] == dice(model(INNER), model(OUTER))
    assert record["volume_a"] == pytest.approx(INNER.volume(), rel=1e-4)
    assert record["volume_b"] == pytest.approx(OUTER.volume(), rel=1e-4)
    assert record["parameters"]["semi_axes"] == [3, 3, 3]
    assert (record["space"], record["unit"]) == ("LPS", "mm")


def test_the_table_shows_the_same(terminal, files):
    record, shown = compared(terminal, "a.json", "b.npz"), terminal("compare", "a.json", "b.npz")
    assert shown.code == 0 and shown.err == f"note: {NOT_RECORDED}\n"  # these models were made by hand
    for value in (record["a_to_b"]["rms"], record["hausdorff"], record["dice"], record["volume_b"]):
        assert f"{value:.4g}" in shown.out
    for word in ("distance B to A, 95 %", "mm^3", "semi axes, B - A", "rotation"):
        assert word in shown.out


def test_a_mesh_stands_for_its_model(terminal, files):
    by_model, by_mesh = compared(terminal, "a.json", "b.npz"), compared(terminal, "a.json", "b.vtp")
    assert by_mesh["parameters"] is None
    assert by_mesh["a_to_b"] == by_model["a_to_b"] and by_mesh["dice"] == by_model["dice"]


def test_a_surface_is_chosen_by_name(terminal, files):
    itself = compared(terminal, "both.json", "a.json", "--surface", "endo")
    assert itself["hausdorff"] < 1e-9 and itself["dice"] == 1
    assert itself["parameters"]["control_points_rms"] > 1
    other = compared(terminal, "a.json", "both.json", "--surface", "epi")
    assert other["hausdorff"] == compared(terminal, "a.json", "b.npz")["hausdorff"]


def test_what_is_unknown_or_open_is_noted(terminal, files):
    result = terminal("compare", "unknown.stl", "a.json", "--json")
    assert result.code == 0 and "unknown.stl: its space is unknown, taken as LPS" in result.err
    assert json.loads(result.out)["unit"] == "mm"
    result = terminal("compare", "a.json", "open.obj", "--json")
    record = json.loads(result.out)
    assert result.code == 0 and "open.obj: the surface is open" in result.err
    assert record["dice"] is None and record["volume_b"] is None and record["volume_a"] > 0
    assert "none" in terminal("compare", "a.json", "open.obj").out


@pytest.mark.parametrize("name", ["b.vtp", "b.npz"])
def test_what_lies_in_the_other_frame_is_brought_to_the_first_with_a_note(terminal, files, tmp_path, name):
    turned = "ras.ply" if name == "b.vtp" else "ras.json"
    save(model(OUTER).in_space("RAS"), tmp_path / "ras.json")
    save(model(INNER).in_space("RAS"), tmp_path / "inner-ras.json")
    result = terminal("compare", "a.json", turned, "--json")
    assert f"{turned}: brought from RAS to LPS" in result.err
    record, plain = json.loads(result.out), compared(terminal, "a.json", name)
    assert record["space"] == "LPS" and record["volume_b"] == pytest.approx(plain["volume_b"], rel=1e-5)
    assert record["hausdorff"] == pytest.approx(plain["hausdorff"], rel=1e-4)
    assert record["dice"] == pytest.approx(plain["dice"], abs=2e-3)
    if plain["parameters"]:
        np.testing.assert_allclose(record["parameters"]["translation"], 0, atol=1e-12)
    assert compared(terminal, "inner-ras.json", turned)["space"] == "RAS"


def test_refusals(terminal, files, cloud, tmp_path):
    box, basis = ControlBox.around(INNER), TimeBasis(np.arange(3.0), 3.0)
    moving = MovingModel({"surface": INNER}, box.origin, box.edges, basis, np.stack([box.control_points] * 3))
    save(moving, tmp_path / "moving.json")
    for words, code, message in [
        (("a.json", "metres.json"), 4, "'m'"),
        (("a.json", "moving.json"), 4, "moving model"),
        (("a.json", "missing.json"), 4, "no such file"),
        (("a.json", cloud), 4, "suffix"),
        (("both.json", "a.json"), 2, "--surface"),
        (("both.json", "a.json", "--surface", "rv"), 2, "'endo'"),
        (("a.json", "b.npz", "--surface", "rv"), 2, "--surface='rv'"),
        (("a.json",), 2, "Missing argument"),
    ]:
        result = terminal("compare", *words)
        assert (result.code, result.out) == (code, "")
        assert message in result.err and len(result.err.splitlines()) == 1
