"""Columns, normals and units on the terminal; names of files that are not UTF-8."""

import json
import os
import sys

import numpy as np
import pytest
from shapes_made import lumpy

pytestmark = pytest.mark.usefixtures("blank_figures")
CLOUD = lumpy(80)
BRIEF = ("--method", "paper", "--iterations", "1")
"""Where the surface does not matter."""


@pytest.fixture
def six(tmp_path):
    np.savetxt(tmp_path / "six.txt", np.hstack([CLOUD[:, ::-1], CLOUD / np.linalg.norm(CLOUD, axis=1)[:, None]]))
    return tmp_path / "six.txt"


def fitted(terminal, path, tmp_path, *words):
    result = terminal("fit", path, "-o", tmp_path / "out", "--box", "2,2,2", "--json", "--force", *words)
    assert result.code == 0, result.err
    return json.loads(result.out)


def test_columns_without_names_are_named_by_the_caller(terminal, six, tmp_path):
    refused = terminal("fit", six, "-o", tmp_path / "out")
    assert refused.code == 4 and "look like unit normals" in refused.err and "--columns x,y,z,nx,ny,nz" in refused.err
    assert not (tmp_path / "out").exists()
    np.savetxt(tmp_path / "plain.xyz", CLOUD)
    plain = fitted(terminal, tmp_path / "plain.xyz", tmp_path)
    assert fitted(terminal, six, tmp_path, "--columns", "z,y,x")["error"] == plain["error"]
    assert fitted(terminal, six, tmp_path, "--columns", "z,y,x,nx,ny,nz")["points"] == 80
    assert terminal("fit", six, "-o", tmp_path / "o", "--columns", "a,b,c").code == 2
    assert terminal("info", six, "--columns", "z,y,x").code == 0


@pytest.mark.parametrize(
    ("header", "words", "unit"),
    [
        ("x [mm],y [mm],z [mm]", (), "mm"),
        ("x [m],y [m],z [m]", (), "m"),
        ("x [um],y [um],z [um]", (), "mm"),
        ("x,y,z", (), "unknown"),
        ("x,y,z", ("--unit", "mm"), "mm"),
        ("x,y,z", ("--unit", "cm"), "mm"),
        ("x [mm],y [mm],z [mm]", ("--unit", "mm"), "mm"),
    ],
)
def test_units_travel_to_the_model(terminal, tmp_path, header, words, unit):
    np.savetxt(tmp_path / "p.csv", CLOUD, delimiter=",", header=header, comments="")
    record = fitted(terminal, tmp_path / "p.csv", tmp_path, *words, *BRIEF)
    assert record["unit"] == unit
    assert json.loads((tmp_path / "out" / "model.json").read_text(encoding="utf-8"))["unit"] == unit
    scale = {"um": 1e-3, "cm": 10}.get("um" if "[um]" in header else words[-1] if words else "", 1)
    box = json.loads((tmp_path / "out" / "model.json").read_text(encoding="utf-8"))["box"]["control_points"]
    assert np.ptp(np.reshape(box, (-1, 3)), axis=0).max() == pytest.approx(scale * np.ptp(CLOUD, axis=0).max(), rel=1)


def test_units_that_contradict_each_other_are_refused(terminal, tmp_path):
    np.savetxt(tmp_path / "mm.csv", CLOUD, delimiter=",", header="x [mm],y [mm],z [mm]", comments="")
    np.savetxt(tmp_path / "m.csv", CLOUD / 2, delimiter=",", header="x [m],y [m],z [m]", comments="")
    result = terminal("fit", tmp_path / "mm.csv", "--unit", "m", "-o", tmp_path / "out")
    assert result.code == 4 and "--unit='m' contradicts the file, which has mm" in result.err
    files = [f"--surface=epi={tmp_path / 'mm.csv'}", f"--surface=endo={tmp_path / 'm.csv'}"]
    assert "differ in space or unit" in terminal("fit", *files, "-o", tmp_path / "out").err
    assert terminal("track", tmp_path / "mm.csv", tmp_path / "m.csv", "-o", tmp_path / "out").code == 4
    assert terminal("fit", tmp_path / "mm.csv", "--unit", "stone", "-o", tmp_path / "out").code == 2
    assert not (tmp_path / "out").exists()


def test_the_order_of_napari_is_reported(terminal, tmp_path):
    np.savetxt(tmp_path / "p.csv", CLOUD[:, ::-1], delimiter=",", header="axis-0,axis-1,axis-2", comments="")
    record = fitted(terminal, tmp_path / "p.csv", tmp_path, *BRIEF)
    assert any("taken as z, y, x" in note for note in record["notes"])


@pytest.mark.parametrize("name", ["p.xyz", "p.npy", "p.ply"])
def test_points_far_from_the_origin_are_warned_of_and_written(terminal, tmp_path, name):
    """Single precision at 5e6: reported from every reader; results can be written."""
    far = (20 * CLOUD / np.abs(CLOUD).max() + 5e6).astype(np.float32)
    if name == "p.npy":
        np.save(tmp_path / name, far)
    elif name == "p.xyz":
        np.savetxt(tmp_path / name, far)
    else:
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(far)}\n"
        header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
        (tmp_path / name).write_bytes(header.encode() + far.astype("<f4").tobytes())
    record = fitted(terminal, tmp_path / name, tmp_path, *BRIEF)
    assert "float32" in record["warnings"]["PRECISION_LOSS"]
    assert b"property double x" in (tmp_path / "out" / "surface.ply").read_bytes()[:300]
    assert "PRECISION_LOSS" in terminal("info", tmp_path / name).err


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has file names that are not UTF-8")
@pytest.mark.parametrize("command", ["fit", "track"])
def test_a_file_name_that_is_not_utf8(terminal, tmp_path, command):
    name = tmp_path / os.fsdecode(b"a\xff\xed\xa0\x80.xyz")
    np.savetxt(name, CLOUD)
    np.savetxt(tmp_path / "b.xyz", CLOUD)
    files = [name] if command == "fit" else [name, tmp_path / "b.xyz"]
    result = terminal(command, *files, "-o", tmp_path / "out", "--box", "2,2,2", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["points"] == 80 * len(files)
    assert (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_options_that_are_lengths_have_the_unit_of_the_file(terminal, tmp_path):
    """They were taken in millimetres, into which points in centimetres are converted."""
    below = CLOUD[CLOUD[:, 2] < np.quantile(CLOUD[:, 2], 0.9)]
    found = []
    for unit, factor in (("mm", 1.0), ("cm", 0.1)):
        path, other = tmp_path / f"{unit}_1.csv", tmp_path / f"{unit}_2.csv"
        names = ",".join(f"{axis} [{unit}]" for axis in "xyz")
        np.savetxt(path, factor * below, header=names, delimiter=",", comments="", fmt="%.17g")
        other.write_bytes(path.read_bytes())
        base, noise = f"0,0,{factor * below[:, 2].max():.15g}/0,0,1", repr(factor * 0.5)
        found.append(fitted(terminal, path, tmp_path, f"--base={base}", "--noise", noise))
        options = [
            "track",
            path,
            other,
            "-o",
            tmp_path / "cycle",
            "--noise",
            noise,
            "--box",
            "2,2,2",
            "--json",
            "--force",
        ]
        moving = terminal(*options)
        assert moving.code == 0, moving.err
        assert json.loads(moving.out)["known_noise"] == "0.5 mm, by --noise"
    one, two = found
    assert one["unit"] == two["unit"] == "mm" and one["known_noise"] == two["known_noise"] == "0.5 mm, by --noise"
    for name in ("noise", "supported", "strength"):
        assert two[name] == pytest.approx(one[name], rel=1e-6)
    assert two["estimates"]["volume"]["value"] == pytest.approx(one["estimates"]["volume"]["value"], rel=1e-6)
