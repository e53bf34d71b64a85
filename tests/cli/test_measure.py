"""`measure`."""

import csv
import json

import numpy as np
import pytest

from quadriform.files import save
from quadriform.heart.measure import measure
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.splines import TimeBasis

HEART = SyntheticVentricle()
TIMES = (0.0, 0.5)


@pytest.fixture
def beating(tmp_path):
    """Two models and the mitral points of both."""
    models = HEART.models(TIMES)
    for number, (model, time) in enumerate(zip(models, TIMES)):
        save(model, tmp_path / f"{number}.json")
        np.savetxt(tmp_path / f"valve{number}.xyz", HEART.mitral_points(time), fmt="%.17g")
    return models


def test_numbers_are_those_of_the_library(terminal, beating):
    words = ["0.json", "1.json", "--base", "valve0.xyz", "--base", "valve1.xyz", "--json", "-o", "m.csv"]
    result = terminal("measure", *words)
    assert result.code == 0
    assert "warning: UNANCHORED" in result.err
    expected = measure(beating, base=[HEART.mitral_points(time) for time in TIMES])
    record = json.loads(result.out)
    assert [row["value"] for row in record["measures"]] == [row.value for row in expected.rows]
    with open("m.csv", newline="") as stream:
        assert [float(row["value"]) for row in csv.DictReader(stream)] == [row.value for row in expected.rows]


def test_the_table_says_the_base_and_what_was_not_observed(terminal, beating):
    point, direction = HEART.base_plane()
    result = terminal("measure", "0.json", "1.json", "--base=" + ",".join(map(str, [*point, *direction])))
    assert result.code == 0
    assert "below a fixed plane" in result.out
    assert "not observed" in result.out
    assert "not observed" not in terminal("measure", "0.json", "1.json", "--tracked").out


@pytest.mark.parametrize("base", ["0.7", "valve0.xyz"])
def test_a_share_or_one_file_holds_for_all_frames(terminal, beating, base):
    result = terminal("measure", "0.json", "1.json", "--base", base, "--json")
    expected = measure(beating, base=0.7 if base == "0.7" else HEART.mitral_points(0.0))
    assert json.loads(result.out)["measures"][0]["value"] == expected.rows[0].value


def test_a_moving_model_brings_its_frames_and_times(terminal, beating, tmp_path):
    boxes = [model.box for model in beating]
    points = np.stack([box.control_points for box in boxes])
    moving = MovingModel(
        beating[0].surfaces,
        boxes[0].origin,
        boxes[0].edges,
        TimeBasis(np.array([3.0, 40.0]), 80.0),
        points,
        "LPS",
        "mm",
    )
    save(moving, tmp_path / "moving.json")
    record = json.loads(terminal("measure", "moving.json", "--json").out)
    assert record["times"] == [3.0, 40.0]
    found = {row["quantity"]: row["value"] for row in record["measures"]}
    assert found["ejection fraction"] == pytest.approx(measure(beating)["ejection fraction"])


def test_insertions_anchor_the_segments(terminal, beating):
    beside = HEART.positions(HEART.surface("epi").surface(np.eye(3)), 0.0)[:2]
    points = [f"--rv-insertion={x},{y},{z}" for x, y, z in beside]
    result = terminal("measure", "0.json", "1.json", *points, "--json")
    assert result.code == 0
    assert "UNANCHORED" not in result.err
    assert any(row["quantity"].startswith("segment 17") for row in json.loads(result.out)["measures"])


def test_one_model_is_enough_for_volumes_and_wall(terminal, beating, tmp_path):
    result = terminal("measure", "0.json")
    assert result.code == 0
    assert "warning: ONE_FRAME" in result.err
    assert terminal("measure", "0.json", "--strict", "-o", "m.csv").code == 3
    assert not (tmp_path / "m.csv").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["0.json", "1.json", "--ed", "5"], 2, "there is no such frame"),
        (["0.json", "1.json", "--rv-insertion", "1,2"], 2, "expected 3 numbers between commas"),
        (["0.json", "1.json", "--base", "1,2,3,4,x,6"], 2, "expected 6 numbers between commas"),
        (["0.json", "1.json", "--base", "valve9.xyz"], 4, "valve9.xyz"),
        (["0.json", "-o", "m.txt"], 4, "cannot have the suffix"),
        (["0.json", "-o", "0.json"], 5, "is the input itself"),
    ],
)
def test_what_cannot_be_is_one_line(terminal, beating, words, code, said):
    result = terminal("measure", *words)
    assert (result.code, len(result.err.splitlines())) == (code, 1)
    assert said in result.err
