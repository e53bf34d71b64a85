"""What a fit says of its model stays with the model, whatever is made of the fit afterwards."""

from dataclasses import replace

import numpy as np
import pytest
from clouds_made import noisy_egg, random_directions
from notes import note_of
from shapes_made import lumpy, two_walls

import quadriform as qf
from quadriform.errors import WarningKind, join_warnings
from quadriform.fitting.diagnostics import start_notes
from quadriform.fitting.refinement import large_clouds
from quadriform.shapes.record import InputFile, ModelRecord, together, worst

SMALL = {"box": (3, 3, 3)}
EGG = noisy_egg(200)
CAP = EGG[EGG[:, 2] > 0]


@pytest.fixture(scope="module")
def warned():
    return qf.fit(CAP, **SMALL)


def test_the_model_carries_the_warnings_of_its_fit(warned):
    assert warned.status == "warned" and "PARTIAL_COVERAGE" in warned.warnings
    assert warned.model.warnings == warned.warnings and warned.model.status == "warned"


def test_the_model_of_a_good_fit_is_ok():
    found = qf.fit(EGG, **SMALL)
    assert (found.status, found.model.status, found.model.warnings) == ("ok", "ok", {})


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_saved_and_loaded_it_still_does(tmp_path, warned, suffix):
    qf.save(warned.model, tmp_path / f"m.{suffix}")
    assert qf.load(tmp_path / f"m.{suffix}").warnings == warned.warnings


def test_a_changed_fit_changes_its_model(warned):
    more = {WarningKind.BORDER_CUT: "cut", **warned.warnings}
    named = replace(warned.model.record, title="egg", sources=(InputFile("egg.xyz"),))
    found = replace(warned, model=replace(warned.model, record=named), warnings=more, notes=("a note",))
    assert found.model.warnings == more and found.model.notes == ("a note",)
    assert found.model.record.title == "egg" and found.model.record.sources == (InputFile("egg.xyz"),)
    assert found.model.record.coverage == warned.model.record.coverage
    assert replace(found, warnings={}).model.status == "ok"


def test_coverage_is_that_of_each_surface(warned):
    half = warned.model.record.coverage["surface"]
    assert 0.3 < half < 0.7
    found = qf.fit(two_walls(300), **SMALL)
    assert found.model.record.coverage == {"endo": 1.0, "epi": 1.0}


def test_a_model_of_many_points_carries_the_warnings_of_all(monkeypatch):
    monkeypatch.setattr(large_clouds, "LARGE", replace(large_clouds.LARGE, many=150))
    few = np.vstack([EGG, EGG[:1] * 3])
    found = qf.fit(few, **SMALL)
    assert "200" in note_of(found, "OUTLIERS") and found.model.notes == found.notes


def test_every_method_and_refine_do_so():
    paper = qf.fit(CAP, method="paper", iterations=2, box=(3, 3, 3))
    assert paper.model.warnings == paper.warnings
    refined = qf.refine(paper.model.superquadric(), CAP, **SMALL)
    assert refined.model.warnings == refined.warnings != {}


@pytest.mark.parametrize("strategy", ["cycle", "previous", "alone"])
def test_models_of_a_cycle_carry_the_warnings_of_all_frames(tmp_path, strategy):
    frames = [lumpy(100, seed=t) * [1 - 0.05 * t, 1, 1] for t in range(3)]
    frames[1] = np.cbrt(np.random.default_rng(1).uniform(size=(100, 1))) * frames[1]  # filled: no surface
    found = qf.track(frames, strategy=strategy, box=(3, 3, 3), strength=1e-4)
    assert found.warnings and all("frame" in text for text in found.warnings.values())
    assert all(model.warnings == found.warnings for model in found.models)
    if found.moving is not None:
        qf.save(found.moving, tmp_path / "m.json")
        back = qf.load(tmp_path / "m.json")
        assert back.warnings == back.at(0.5).warnings == found.warnings


def octahedron():
    u = random_directions(300, 3)
    return u / np.abs(u).sum(axis=1, keepdims=True) * [3, 2, 1]


def test_a_start_at_its_bound_is_a_note():
    """Another order of the points can give another superquadric there, and so another model."""
    points = octahedron()
    assert "AT_BOUND" in qf.fit_superquadric(points).warnings
    found = qf.fit(points, **SMALL)
    assert "AT_BOUND" not in found.warnings
    assert any("starts from: AT_BOUND: exponents [2.0, 2.0]" in note for note in found.notes)
    assert found.model.notes == found.notes
    assert qf.fit(EGG, **SMALL).notes == ()


def test_a_start_that_the_model_does_not_have_is_no_note():
    start = qf.fit_superquadric(octahedron())
    box = qf.ControlBox.around(start.superquadric)
    others = {
        "itself": start.superquadric,
        "longer": replace(start.superquadric, semi_axes=start.superquadric.semi_axes * 1.01),
        "rounder": replace(start.superquadric, exponents=(1.0, 1.0)),
        "elsewhere": replace(start.superquadric, translation=start.superquadric.translation + 0.1),
    }
    found = {
        name: start_notes({"surface": start}, qf.DeformableModel({"surface": body}, box))
        for name, body in others.items()
    }
    assert [name for name, notes in found.items() if notes] == ["itself"]


def test_records_of_several_models_together():
    one = ModelRecord("warned", {WarningKind.FOLDING: "a fold"}, ("first",), coverage={"surface": 0.5})
    assert together({"A": one, "B": one}) == one
    both = together({"A": one, "B": ModelRecord("ok", notes=("second",))})
    assert (both.status, both.warnings) == ("warned", {WarningKind.FOLDING: "A: a fold"})
    assert both.notes == ("A: first", "B: second")
    twice = together({"A": one, "B": replace(one, warnings={WarningKind.FOLDING: "another"})})
    assert twice.warnings == {WarningKind.FOLDING: "A: a fold; B: another"}


@pytest.mark.parametrize(
    ("statuses", "expected"),
    [
        (("ok", "ok"), "ok"),
        (("ok", "unknown"), "unknown"),
        (("unknown", "warned"), "warned"),
        (("unreliable", "warned", "ok"), "unreliable"),
    ],
)
def test_the_worst_of_statuses(statuses, expected):
    assert worst(*statuses) == worst(*reversed(statuses)) == expected


def test_warnings_of_one_kind_are_joined_and_none_is_lost():
    one, other = {WarningKind.OUTLIERS: "11 points"}, {WarningKind.OUTLIERS: "1 points", WarningKind.FOLDING: "x"}
    joined = join_warnings(one, other, one)
    assert joined == {WarningKind.OUTLIERS: "11 points; 1 points", WarningKind.FOLDING: "x"}
    assert join_warnings(joined, other) == joined
