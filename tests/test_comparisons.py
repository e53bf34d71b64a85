"""The comparisons' own arithmetic, with a clock that does as it is told; nothing here depends on time."""

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def harness(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("comparing.harness")


class Clock:
    """Stands still but for what the sides take."""

    now = 0.0

    def __call__(self):
        return self.now

    def side(self, name, takes, log):
        left = iter(takes)

        def run():
            self.now += next(left)
            log.append(name)
            return f"{name}{len(log)}"

        return run


def test_sides_run_in_turn_and_medians_are_theirs(harness):
    clock, log = Clock(), []
    sides = {"a": clock.side("a", [1, 9, 2], log), "b": clock.side("b", [30, 10, 20], log)}
    laps = harness.in_turn(sides, 3, clock)
    assert log == ["a", "b", "a", "b", "a", "b"]
    assert laps["a"].times == (1, 9, 2) and laps["a"].median == 2
    assert laps["b"].times == (30, 10, 20) and laps["b"].median == 20
    assert (laps["a"].result, laps["b"].result) == ("a5", "b6")


def test_the_ratio_is_our_median_over_that_of_the_baseline(harness):
    ours, baseline = harness.Lap((1.0, 3.0, 2.0), None), harness.Lap((8.0, 8.0, 1.0), None)
    row = harness.against("comparison", harness.Goal(0.3, 0.2), ours, baseline, "them")
    assert row.value == 0.25
    assert row.cells() == ("comparison", "<= 0.3 x", "<= 0.2 x", "0.25 x", "2 s", "them 8 s", "reached")


@pytest.mark.parametrize(
    ("value", "required", "further", "at_least", "outcome"),
    [
        (0.9, 1.0, 0.5, False, "reached"),
        (1.0, 1.0, 0.5, False, "reached"),
        (0.5, 1.0, 0.5, False, "further goal reached"),
        (1.1, 1.0, 0.5, False, "not reached"),
        (1.7, 1.6, 1.9, True, "reached"),
        (1.5, 1.6, 1.9, True, "not reached"),
        (2.0, 1.6, 1.9, True, "further goal reached"),
        (7.0, None, None, False, "no goal"),
        (7.0, None, 1.0, False, "further goal not reached"),
    ],
)
def test_rows_are_judged_by_their_goal(harness, value, required, further, at_least, outcome):
    assert harness.Row("comparison", harness.Goal(required, further, at_least=at_least), value).outcome == outcome


def test_losses_are_the_rows_that_missed_or_did_not_run(harness):
    goal = harness.Goal(1.0)
    rows = [
        harness.Row("won", goal, 0.5),
        harness.Row("lost", goal, 1.5),
        harness.Row("absent", goal, None, baseline="no wheel"),
        harness.Row("only shown", harness.Goal(None), 9.0),
    ]
    assert harness.losses(row.cells() for row in rows) == [
        "- lost: 1.5 x, required <= 1 x.",
        "- absent: not compared; no wheel.",
    ]


def test_rows_that_were_measured_again_take_their_places(harness):
    header = "\n".join(["## Results", "", "| comparison | outcome |", "| --- | --- |"])
    rows = "| one | not reached |\n| two |  |\n\n## Goals that are not reached\n\n- one\n\n| no | table |\n"
    text = f"# Comparisons\n\n{header}\n{rows}"
    earlier = harness.table_of(text, "Results")
    assert earlier == [("one", "not reached"), ("two", "")]
    assert harness.table_of(text, "Rate") == []
    later = harness.replaced(earlier, [("three", "reached"), ("one", "reached")])
    assert later == [("one", "reached"), ("two", ""), ("three", "reached")]
