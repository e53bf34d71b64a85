"""`measure`."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from quadriform.files import save, write_mesh
from quadriform.heart.measure import measure
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.mesh import Mesh
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


def test_a_plane_is_taken_as_fit_shows_it(terminal, beating):
    """With a slash, as `fit --base` takes it and its table prints it, it was taken for the name of a file."""
    slash, commas = (
        json.loads(terminal("measure", "0.json", "1.json", "--base", base, "--json").out)["measures"]
        for base in ("3,-18,78/-0.6,-0.3,0.7", "3,-18,78,-0.6,-0.3,0.7")
    )
    assert slash == commas
    assert slash[0]["value"] == measure(beating, base=((3, -18, 78), (-0.6, -0.3, 0.7))).rows[0].value


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
    save(replace(moving, frame_times=[3.0, 15.0, 40.0, 41.5]), tmp_path / "moving.json", force=True)
    record = json.loads(terminal("measure", "moving.json", "--json").out)
    assert record["times"] == [3.0, 15.0, 40.0, 41.5]
    assert record["curves"]["cavity volume"][1] == pytest.approx(1e-3 * moving.at(15.0).volume("endo"), rel=1e-4)


def contours_written(folder, inserts=True, valve=8):
    """Guide points of both frames: the mitral ring, and where the right ventricle would meet the left."""
    folder.mkdir()
    for number, time in enumerate(TIMES):
        ways = HEART.positions(HEART.surface("epi").surface(np.eye(3)[:2]), time)
        groups = {"MITRAL_VALVE": HEART.mitral_points(time)[:valve], "RV_INSERT": ways if inserts else ways[:0]}
        rows = [
            f"{x!r}\t{y!r}\t{z!r}\t{kind}\t1\t1.0\t{number}"
            for kind, points in groups.items()
            for x, y, z in points.tolist()
        ]
        header = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame"
        (folder / f"GPFile_{number:03d}.txt").write_text("\n".join([header, *rows, "1\t2\t3\tAPEX_POINT\t1\t1.0\t0"]))
    return [folder / f"GPFile_{number:03d}.txt" for number in range(len(TIMES))]


@pytest.mark.parametrize("how", ["folder", "glob", "one by one"])
def test_contours_bring_each_frames_base_and_the_insertions_of_ed(terminal, beating, tmp_path, how):
    files = contours_written(tmp_path / "frames")
    words = {"folder": ["frames"], "glob": files, "one by one": [files[0], "--contours", files[1]]}[how]
    result = terminal("measure", "0.json", "1.json", "--json", "--contours", *words)
    assert result.code == 0 and "UNANCHORED" not in result.err
    inserts = HEART.positions(HEART.surface("epi").surface(np.eye(3)[:2]), 0.0)
    expected = measure(beating, base=[HEART.mitral_points(time) for time in TIMES], rv_inserts=inserts)
    assert [(row["quantity"], row["value"]) for row in json.loads(result.out)["measures"]] == [
        (row.quantity, row.value) for row in expected.rows
    ]


def test_contours_without_insertions_leave_the_segments_unanchored(terminal, beating, tmp_path):
    contours_written(tmp_path / "frames", inserts=False)
    result = terminal("measure", "0.json", "1.json", "--contours", "frames")
    assert result.code == 0 and "warning: UNANCHORED" in result.err
    beside = HEART.positions(HEART.surface("epi").surface(np.eye(3)), 0.0)[:2]
    points = [f"--rv-insertion={x},{y},{z}" for x, y, z in beside]
    assert "UNANCHORED" not in terminal("measure", "0.json", "1.json", "--contours", "frames", *points).err


def test_one_file_of_contours_is_the_plane_of_its_frame(terminal, beating, tmp_path):
    file = contours_written(tmp_path / "frames")[1]
    result = terminal("measure", "0.json", "1.json", "--base", file, "--json")
    expected = measure(beating, base=HEART.mitral_points(TIMES[1]))
    assert json.loads(result.out)["measures"][0]["value"] == expected.rows[0].value


def test_models_in_ras_take_contours_in_lps(terminal, beating, tmp_path):
    """Everything that is measured is the same, for a half-turn changes no measure."""
    contours_written(tmp_path / "frames")
    for number, model in enumerate(beating):
        save(model.in_space("RAS"), tmp_path / f"ras{number}.json")
    for words in (["--contours", "frames"], ["--base", "frames/GPFile_000.txt"]):
        here = terminal("measure", "0.json", "1.json", *words, "--json")
        there = terminal("measure", "ras0.json", "ras1.json", *words, "--json")
        assert there.err.count("brought from LPS to RAS") == 1
        for one, other in zip(json.loads(here.out)["measures"], json.loads(there.out)["measures"]):
            assert one["quantity"] == other["quantity"]
            assert other["value"] == pytest.approx(one["value"], rel=1e-6, abs=1e-9)


def test_a_marked_loop_is_brought_to_the_models(terminal, beating, tmp_path):
    ring = HEART.mitral_points(0.0)
    fan = Mesh(ring * [-1, -1, 1], np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)]))
    write_mesh(fan, tmp_path / "ring.vtp", "RAS", "mm")
    result = terminal("measure", "0.json", "1.json", "--base", "ring.vtp", "--json")
    expected = measure(beating, base=ring)
    assert json.loads(result.out)["measures"][0]["value"] == pytest.approx(expected.rows[0].value, rel=1e-12)


def test_models_are_taken_in_the_order_of_their_numbers(terminal, beating, tmp_path):
    """Frame 10 comes after frame 9, although a shell lists it before."""
    for number, model in zip((9, 10), beating):
        save(model, tmp_path / f"frame_{number}.json")
    expected = json.loads(terminal("measure", "0.json", "1.json", "--json").out)
    result = terminal("measure", "frame_10.json", "frame_9.json", "--json")
    assert json.loads(result.out) == expected
    assert "note: the models are taken in the order of the numbers in their names: frame_9.json, frame_10" in result.err


def test_contours_that_do_not_fit_are_named(terminal, beating, tmp_path):
    files = contours_written(tmp_path / "frames")
    contours_written(tmp_path / "without", valve=0)
    contours_written(tmp_path / "two", valve=2)
    for name in ("metres.json", "also.json"):
        save(replace(beating[0], unit="m"), tmp_path / name)
    save(beating[0].in_space("RAS"), tmp_path / "ras.json")
    for words, code, said in (
        (["0.json", "1.json", "--contours", files[0]], 2, "each of 2 frames, found 1"),
        (
            ["0.json", "1.json", "--contours", "without"],
            4,
            "'without', frame 0: expected 3 or more points MITRAL_VALVE",
        ),
        (["0.json", "1.json", "--contours", "two"], 4, "found 2"),
        (["0.json", "1.json", "--contours", "frames", "--base", "0.8"], 2, "exclude each other"),
        (["0.json", "1.json", "--contours", "."], 4, "no files GPFile_NNN.txt"),
        (["0.json", "1.json", "--contours", "nowhere.txt", "--contours", "x"], 4, "nowhere.txt"),
        (["metres.json", "metres.json", "--contours", "frames"], 4, "two files for one frame"),
        (["metres.json", "also.json", "--contours", "frames"], 4, "expected lengths in m"),
        (["0.json", "ras.json"], 2, "frame 1 has the surfaces"),
    ):
        result = terminal("measure", *words, "-o", "m.csv")
        assert (result.code, len(result.err.splitlines())) == (code, 1), result.err
        assert said in result.err
        assert not (tmp_path / "m.csv").exists()


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
    assert terminal("measure", "0.json", "--strict=warned", "-o", "m.csv").code == 3
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
