"""Status, warnings and sources go to a file and back; older files have none; what is wrong is refused by its path."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapes_made import made

import quadriform as qf
from quadriform.errors import FileFormatError, OptionError, WarningKind
from quadriform.files.models import VERSION
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import Estimate, InputFile, ModelRecord
from quadriform.shapes.splines import TimeBasis

OLD = Path(__file__).parent / "old"
RECORD = ModelRecord(
    status="warned",
    warnings={WarningKind.POOR_FIT: 'the RMS "distance" is 7.5 %; <b>é</b>', WarningKind.FOLDING: "a fold"},
    notes=("taken as a label image", "of two components one was kept"),
    title='patient <script>alert("1")</script>.nii.gz',
    sources=(InputFile("shape.nii.gz", "0f" * 32, "shape", 3, "sampled by area"), InputFile("b.ply")),
    coverage={"shape": 0.75},
)
LATER = replace(
    RECORD,
    status="unreliable",
    supported={"shape": 0.5, "epi": 1.0},
    extends_beyond={"epi": 12.5},
    estimates={"volume": Estimate(20.9, "ml", 0.8, 1.5), "shape": Estimate(1.0, "1")},
)
NAMES = ("shape", "epi")
"""The first is also the word for an array in packed files."""


def still(record):
    return qf.DeformableModel(dict.fromkeys(NAMES, made()), ControlBox.around(made()), "LPS", "mm", "ab" * 32, record)


def moving(record):
    box = ControlBox.around(made())
    control = np.stack([box.control_points + k for k in range(3)])
    basis = TimeBasis(np.arange(3.0), 4.0)
    surfaces = dict.fromkeys(NAMES, made())
    return MovingModel(surfaces, box.origin, box.edges, basis, control, "LPS", "mm", "ab" * 32, record=record)


@pytest.mark.parametrize("record", [ModelRecord(), RECORD, LATER], ids=["none", "warned", "reserved fields"])
@pytest.mark.parametrize(("make", "suffix"), [(still, ".json"), (still, ".npz"), (moving, ".json")])
def test_there_and_back(tmp_path, make, suffix, record):
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    qf.save(make(record), first)
    back = qf.load(first)
    assert back.record == record
    qf.save(back, second)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("make", [still, moving])
def test_the_record_travels_with_the_model(make):
    model = make(RECORD)
    assert (model.status, model.warnings, model.notes) == ("warned", RECORD.warnings, RECORD.notes)
    for moved in (model.in_space("RAS"), model.transformed(2.0, np.ones(3))):
        assert moved.record == RECORD
    if isinstance(model, MovingModel):
        assert model.at(0.5).record == RECORD


@pytest.mark.parametrize("name", ["model_v1.json", "model_v1.npz", "moving_v2.json"])
def test_files_of_older_versions_have_an_unknown_status(tmp_path, name):
    """These files were written by the versions in their names."""
    old = qf.load(OLD / name)
    assert old.record == ModelRecord() and old.status == "unknown"
    assert (old.space, old.unit, old.input_sha256) == ("LPS", "mm", "0f" * 32)
    control = old.control_points[0] if isinstance(old, MovingModel) else old.box.control_points
    assert control[0, 0].tolist() == [[-2.75, -1.75, -0.75], [-2.75, -1.75, 1.25]]
    assert old.surfaces["surface"].semi_axes.tolist() == [3, 2, 1]
    if isinstance(old, MovingModel):
        assert old.frame_times.tolist() == [0, 1.5]
    qf.save(old, tmp_path / name)
    assert qf.load(tmp_path / name).record == ModelRecord()


def document(tmp_path, make=still):
    qf.save(make(LATER), tmp_path / "m.json")
    return json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))


def test_the_fields_are_at_the_top_of_the_document(tmp_path):
    found = document(tmp_path)
    assert found["version"] == VERSION and found["status"] == "unreliable"
    assert found["warnings"] == {str(kind): text for kind, text in RECORD.warnings.items()}
    assert found["notes"] == list(RECORD.notes) and found["title"] == RECORD.title
    assert found["sources"][0]["name"] == "shape.nii.gz" and found["coverage"] == {"shape": 0.75}
    qf.save(still(ModelRecord()), tmp_path / "plain.json")
    plain = json.loads((tmp_path / "plain.json").read_text(encoding="utf-8"))
    assert [plain[name] for name in ("supported", "extends_beyond", "estimates")] == [None] * 3


def test_reserved_fields_may_be_missing(tmp_path):
    found = document(tmp_path)
    for name in ("supported", "extends_beyond", "estimates"):
        del found[name]
    (tmp_path / "m.json").write_text(json.dumps(found))
    assert qf.load(tmp_path / "m.json").record == replace(LATER, supported={}, extends_beyond={}, estimates={})


LONE = "half \ud800"
BAD = [
    ("status", "good", "field status: expected one of 'ok'"),
    ("status", "ok", "field status: expected a status other than ok or unknown exactly where there are warnings"),
    ("warnings", {}, "field status: expected a status other"),
    ("warnings", ["POOR_FIT"], "field warnings: expected an object"),
    ("warnings", {"SOMETHING_NEW": "x"}, "field warnings.SOMETHING_NEW: expected a kind .* needs a newer quadriform"),
    ("warnings", {"POOR_FIT": 3}, "field warnings.POOR_FIT: expected a text"),
    ("warnings", {"POOR_FIT": LONE}, "field warnings.POOR_FIT: expected a text without halves"),
    ("warnings", {"POOR_FIT": "\x1b[2J"}, "field warnings.POOR_FIT: expected a text on one line"),
    ("warnings", {LONE: "x"}, r"field warnings.half \\ud800: expected a kind"),
    ("warnings", ..., "field warnings: expected a value, found none"),
    ("notes", "one", "field notes: expected a list"),
    ("notes", ["a", 1], r"field notes\[1\]: expected a text"),
    ("notes", ["a\nb"], r"field notes\[0\]: expected a text on one line"),
    ("title", None, "field title: expected a text"),
    ("title", LONE, "field title: expected a text without halves"),
    ("title", "a\u2028b", "field title: expected a text on one line"),
    ("sources", {}, "field sources: expected a list"),
    ("sources", [1], r"field sources\[0\]: expected an object"),
    ("sources", [{"name": "a"}], r"field sources\[0\].surface: expected a value"),
    ("sources", [{"path": "/home/x"}], r"field sources\[0\].path: expected only the fields name"),
    ("coverage", {"shape": 1.01}, "field coverage.shape: expected a number from 0 to 1"),
    ("coverage", {"shape": True}, "field coverage.shape: expected a finite number"),
    ("coverage", {"other": 0.5}, "field coverage.other: expected the name of a surface"),
    ("coverage", [0.5], "field coverage: expected an object"),
    ("supported", {"shape": -0.1}, "field supported.shape: expected a number from 0 to 1"),
    ("supported", {"shape": 1.01}, "field supported.shape: expected a number from 0 to 1"),
    ("extends_beyond", {"shape": -1.0}, "field extends_beyond.shape: expected a number of 0 or more"),
    ("extends_beyond", 3, "field extends_beyond: expected an object"),
    ("estimates", {"volume": 3.0}, "field estimates.volume: expected an object"),
    ("estimates", {"volume": {"value": "3", "unit": "ml"}}, "field estimates.volume.value: expected a finite"),
    ("estimates", {"volume": {"value": 3, "unit": "ml", "mean": 1}}, "field estimates.volume.mean: expected only"),
]


@pytest.mark.parametrize("make", [still, moving])
@pytest.mark.parametrize(("name", "value", "message"), BAD, ids=[f"{n}={v!a}"[:40] for n, v, _ in BAD])
def test_a_damaged_record_is_refused_by_its_path(tmp_path, make, name, value, message):
    found = document(tmp_path, make)
    found[name] = value
    if value is ...:
        del found[name]
    (tmp_path / "m.json").write_text(json.dumps(found))
    with pytest.raises(FileFormatError, match=message):
        qf.load(tmp_path / "m.json")


@pytest.mark.parametrize("change", [{"sha256": "0f"}, {"surface": "other"}, {"frame": -1}, {"frame": 1.5}, {"note": 1}])
def test_a_damaged_source_is_refused_by_its_path(tmp_path, change):
    found = document(tmp_path)
    found["sources"][0] |= change
    (tmp_path / "m.json").write_text(json.dumps(found))
    with pytest.raises(FileFormatError, match=rf"field sources\[0\]\.{next(iter(change))}: expected"):
        qf.load(tmp_path / "m.json")


def test_a_later_version_is_refused_as_such(tmp_path):
    found = document(tmp_path) | {"version": VERSION + 1, "warnings": {"SOMETHING_NEW": "x"}}
    (tmp_path / "m.json").write_text(json.dumps(found))
    with pytest.raises(FileFormatError, match=f"expected version 1 to {VERSION}; a later one needs a newer"):
        qf.load(tmp_path / "m.json")


def test_texts_of_a_record_are_plain_whatever_they_were_made_of(tmp_path):
    """A file name on Linux is any bytes; a model of it must still be written, and read again."""
    record = ModelRecord(title="a\udcffb\x1b[31m\n", sources=(InputFile("a\udcffb"),), notes=("c\td",))
    assert record.title == r"a\udcffb\x1b[31m\n" and record.sources[0].name == r"a\udcffb"
    qf.save(still(record), tmp_path / "m.json")
    assert qf.load(tmp_path / "m.json").record == record


def test_names_of_surfaces_that_no_file_can_hold_are_refused(tmp_path):
    for suffix in ("json", "npz"):
        with pytest.raises(OptionError, match="halves of surrogate pairs"):
            qf.save(replace(still(RECORD), surfaces={LONE: made()}), tmp_path / f"m.{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_a_model_that_lost_a_surface_loses_what_is_known_of_it(tmp_path, suffix):
    one = replace(still(LATER), surfaces={"epi": made()})
    qf.save(one, tmp_path / f"m.{suffix}")
    back = qf.load(tmp_path / f"m.{suffix}").record
    assert (back.coverage, back.supported, back.extends_beyond) == ({}, {"epi": 1.0}, {"epi": 12.5})
    assert [source.name for source in back.sources] == ["b.ply"] and back.warnings == LATER.warnings


@pytest.mark.parametrize(
    "wrong",
    [
        {"coverage": {"shape": 1.01}},
        {"supported": {"shape": 1.01}},
        {"coverage": {"shape": np.nan}},
        {"supported": {"shape": -0.1}},
        {"extends_beyond": {"shape": np.inf}},
    ],
)
def test_shares_and_lengths_that_cannot_be_are_refused(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        ModelRecord(**wrong)


def test_a_kind_of_warning_or_a_hash_that_cannot_be_is_refused():
    with pytest.raises(OptionError, match="'SOMETHING_NEW' is unknown"):
        ModelRecord("warned", {"SOMETHING_NEW": "x"})
    with pytest.raises(OptionError, match="64 hexadecimal digits"):
        InputFile("a", sha256="0f")
    assert ModelRecord("warned", {"FOLDING": "x"}).warnings == {WarningKind.FOLDING: "x"}


def test_a_status_that_the_warnings_contradict_is_no_record():
    with pytest.raises(OptionError, match="status='ok'"):
        ModelRecord(status="ok", warnings=RECORD.warnings)
    with pytest.raises(OptionError, match="status='warned'"):
        ModelRecord(status="warned")
    with pytest.raises(OptionError, match="status='fine'"):
        ModelRecord(status="fine")
