"""A model that `fit` or `track` warned of is never used without the same warnings: on screen, in files, on pages."""

import csv
import json
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from shapes_made import even_directions
from undrawn import draw_nothing

import quadriform as qf
from quadriform.cli.main import main
from quadriform.files.metadata import parse_record
from quadriform.shapes import comparison
from quadriform.shapes.record import NOT_RECORDED

pytestmark = pytest.mark.usefixtures("blank_figures")
AXES = {"endo": np.array([25.0, 24, 40]), "epi": np.array([35.0, 34, 50])}


FAR = 300 * even_directions(40)
"""Outliers, more than a quarter of the points."""


def cup(name, size, n=160):
    """The lower half of an ellipsoid: nobody measured the rest."""
    points = even_directions(n) * AXES[name]
    return points[points[:, 2] < 0] * ([size, size, size] if name == "endo" else [1, 1, 1])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with the results of `fit` for two phases and of `track` for both; no charts are drawn."""
    folder = tmp_path_factory.mktemp("warned")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        draw_nothing(patch)
        for phase, size in (("ed", 1.0), ("es", 0.7)):
            for name in AXES:
                np.savetxt(f"{phase}_{name}.xyz", cup(name, size))
            words = [f"--surface={name}={phase}_{name}.xyz" for name in AXES]
            assert main(["fit", *words, "-o", phase, "--box=3,3,3", "--strength=1e-4", "--json"]) == 0
            np.savetxt(f"frame_{phase}.xyz", np.vstack([cup("endo", size), FAR]))
        assert main(["track", "frame_ed.xyz", "frame_es.xyz", "-o", "cycle", "--box=3,3,3", "--strength=1e-6"]) == 0
    return folder


@pytest.fixture
def call(made, terminal, monkeypatch, tmp_path):
    """The terminal in the folder with the results; what it writes goes to `out`."""
    monkeypatch.chdir(made)
    monkeypatch.setattr(comparison, "SAMPLES", 500)  # quicker
    monkeypatch.setattr(comparison, "RESOLUTION", 8)
    return terminal


def warnings_of(folder, name):
    found = json.loads((folder / name / "model.json").read_text(encoding="utf-8"))
    assert found["status"] == "warned" and found["warnings"]
    return found["warnings"]


USES = {
    "info": ["info", "ed/model.json"],
    "measure": ["measure", "ed/model.json"],
    "compare": ["compare", "ed/model.json", "ed_endo.ply", "--surface=endo"],
    "compare with itself": ["compare", "ed/model.json", "ed/model.json", "--surface=epi"],
    "export": ["export", "ed/model.json", "--to=ply,stl,obj,vtp", "-o", "OUT"],
    "deform": ["deform", "ed/model.json", "ed_endo.xyz", "-o", "OUT.xyz"],
    "deform back": ["deform", "ed/model.json", "ed_endo.xyz", "-o", "OUT.xyz", "--inverse"],
    "report": ["report", "ed/model.json", "-o", "OUT.html"],
    "info of a cycle": ["info", "cycle/model.json"],
    "measure of a cycle": ["measure", "cycle/model.json"],
    "export of a cycle": ["export", "cycle/model.json", "--to=stl", "-o", "OUT"],
    "report of a cycle": ["report", "cycle/model.json", "-o", "OUT.html"],
}


@pytest.fixture
def words(request, made, tmp_path):
    if not (made / "ed_endo.ply").exists():
        qf.save(qf.load(made / "ed" / "model.json").mesh("endo"), made / "ed_endo.ply")
    return [word.replace("OUT", str(tmp_path / "out")) for word in USES[request.param]]


@pytest.mark.parametrize("words", USES, indirect=True, ids=lambda name: name)
def test_every_use_repeats_the_warnings(call, made, words):
    source = "cycle" if "cycle/model.json" in words else "ed"
    found = call(*words)
    assert found.code == 0
    for kind, text in warnings_of(made, source).items():
        assert f"warning: from the fit: {kind}: {text}\n" in found.err
    if words[0] in ("info", "measure", "compare"):
        assert "warned" in found.out and all(kind in found.out for kind in warnings_of(made, source))


@pytest.mark.parametrize("words", [name for name in USES if "report" not in name], indirect=True, ids=lambda name: name)
def test_json_has_status_warnings_and_notes(call, made, words):
    source = "cycle" if "cycle/model.json" in words else "ed"
    found = json.loads(call(*words, "--json").out)
    assert found["status"] == "warned" and isinstance(found["notes"], list)
    assert found["warnings"].items() >= warnings_of(made, source).items()


@pytest.mark.parametrize("words", USES, indirect=True, ids=lambda name: name)
def test_strict_refuses_and_writes_nothing(call, tmp_path, words):
    found = call(*words, "--strict=warned")
    assert found.code == 3
    assert "refused for its warnings: " in found.err and "model.json" in found.err
    assert not list(tmp_path.glob("out*"))


def test_two_phases_are_distinguished(call, made):
    """Two files of one ventricle: an ejection fraction is as doubtful as the worse of them."""
    found = call("measure", "ed/model.json", "es/model.json", "--json")
    text = json.loads(found.out)["warnings"]["PARTIAL_COVERAGE"]
    for number, phase in enumerate(("ed", "es")):
        assert f"frame {number}: {warnings_of(made, phase)['PARTIAL_COVERAGE']}" in text
    assert call("measure", "ed/model.json", "es/model.json", "--strict=warned").code == 3


def test_each_number_of_a_table_has_the_status_beside_it(call, made, tmp_path):
    assert call("measure", "cycle/model.json", "-o", tmp_path / "m.csv").code == 0
    with open(tmp_path / "m.csv", newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["status"] for row in rows} == {"warned"}
    for kind, text in warnings_of(made, "cycle").items():
        assert all(f"from the fit: {kind}: {text}" in row["warnings"] for row in rows)
    assert call("measure", "cycle/model.json", "-o", tmp_path / "m.json").code == 0
    whole = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    assert whole["warnings"].items() >= warnings_of(made, "cycle").items()


def test_the_table_of_frames_has_the_status_too(made):
    with open(made / "cycle" / "frames.csv", newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    expected = "; ".join(f"{kind}: {text}" for kind, text in warnings_of(made, "cycle").items())
    assert [(row["status"], row["warnings"]) for row in rows] == [("warned", expected)] * 2


@pytest.mark.parametrize("name", ["ed", "cycle"])
def test_pages_show_them_before_any_picture(call, made, tmp_path, name):
    assert call("report", f"{name}/model.json", "-o", tmp_path / "page.html").code == 0
    for page in (tmp_path / "page.html", made / name / "report.html"):
        text = unescape(page.read_text(encoding="utf-8"))
        assert '<div class="summary warned">' in text
        for kind, sentence in warnings_of(made, name).items():
            assert text.index(f"<strong>{kind}</strong>: {sentence}") < text.index("<canvas")


def test_meshes_say_the_status(call, made, tmp_path):
    assert call("export", "ed/model.json", "--to=ply,stl,obj,vtp", "-o", tmp_path / "out").code == 0
    for path in (*(tmp_path / "out").iterdir(), made / "ed" / "surface-endo.ply"):
        found = json.loads(call("info", path, "--json").out)
        assert found["status"] == "warned", path
    assert b"WARNINGS=PARTIAL_COVERAGE" in (tmp_path / "out" / "surface-epi.ply").read_bytes()[:400]


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "vtp"])
def test_meshes_alone_repeat_the_warnings(call, made, tmp_path, suffix):
    out = tmp_path / "meshes"
    assert call("export", "ed/model.json", f"--to={suffix}", "-o", out).code == 0
    one, two = sorted(out.iterdir())
    for words in (["info", one], ["compare", one, two]):
        found = call(*words, "--json")
        assert "PARTIAL_COVERAGE: the mesh is the surface of a model whose fit was warned of" in found.err
        assert json.loads(found.out)["status"] == "warned" and "PARTIAL_COVERAGE" in json.loads(found.out)["warnings"]
        assert call(*words, "--strict").code == 0
        refused = call(*words, "--strict=warned")
        assert refused.code == 3 and "refused for its warnings: " in refused.err


@pytest.mark.parametrize(
    ("head", "status", "kinds"),
    [
        (b"SPACE=LPS UNIT=mm", None, []),
        (b"STATUS=ok", "ok", []),
        (b"STATUS=unknown", "unknown", []),
        (b"STATUS=warned WARNINGS=OUTLIERS,POOR_FIT", "warned", ["OUTLIERS", "POOR_FIT"]),
        (b"STATUS=unreliable WARNINGS=FOLDING,OF_ANOTHER_VERSION", "unreliable", ["FOLDING"]),
        (b"STATUS=warned WARNINGS=OF_ANOTHER_VERSION", "unknown", []),
        (b"STATUS=warned", "unknown", []),
        (b"STATUS=ok WARNINGS=FOLDING", "unknown", []),
    ],
)
def test_marks_of_a_mesh_are_a_record(head, status, kinds):
    found = parse_record(b"comment " + head + b"\n")
    assert (found and found.status) == status and list(found.warnings if found else []) == kinds


def test_the_input_is_named_without_its_folders(made):
    found = json.loads((made / "ed" / "model.json").read_text(encoding="utf-8"))
    assert found["title"] == "ed_endo.xyz, ed_epi.xyz"
    assert [(source["name"], source["surface"]) for source in found["sources"]] == [
        ("ed_endo.xyz", "endo"),
        ("ed_epi.xyz", "epi"),
    ]
    assert set(found["coverage"]) == {"endo", "epi"}
    cycle = json.loads((made / "cycle" / "model.json").read_text(encoding="utf-8"))
    assert [(source["name"], source["frame"]) for source in cycle["sources"]] == [
        ("frame_ed.xyz", 0),
        ("frame_es.xyz", 1),
    ]
    assert str(made) not in (made / "ed" / "model.json").read_text(encoding="utf-8")


def test_a_file_of_an_older_version_says_that_it_does_not_know(call, made, tmp_path):
    old = Path(__file__).parents[1] / "files" / "old" / "model_v1.json"
    found = call("info", old, "--json")
    assert json.loads(found.out)["status"] == "unknown" and NOT_RECORDED in found.err
    found = call("measure", old, "--json")
    assert json.loads(found.out)["notes"] == [NOT_RECORDED] and f"note: {NOT_RECORDED}" in found.err


def test_a_hostile_title_runs_nothing_and_draws_nothing(call, made, tmp_path):
    model = qf.load(made / "ed" / "model.json")
    title = '</title><script>alert("1")</script>\x1b[31m'
    qf.save(replace(model, record=replace(model.record, title=title)), tmp_path / "m.json")
    assert call("report", tmp_path / "m.json", "-o", tmp_path / "page.html").code == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text and "&lt;script&gt;alert" in text
    found = call("info", tmp_path / "m.json")
    assert "\x1b" not in found.out + found.err
