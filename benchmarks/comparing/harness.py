"""Times of two sides in turn, their medians, goals, and the rows of a table. Needs the standard library only."""

import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

HEADER = ("comparison", "goal", "further goal", "measured", "ours", "baseline", "result")
UNREACHED, SKIPPED = "not reached", "skipped"


class Missing(Exception):
    """A baseline or a data set is missing; the message says which and how to get it."""


@dataclass(frozen=True)
class Lap:
    """What one side took and made.

    Attributes:
        times: of each turn.
        result: of the last turn.
    """

    times: tuple[float, ...]
    result: Any

    @property
    def median(self) -> float:
        """Median over the turns."""
        return statistics.median(self.times)


def in_turn(
    sides: Mapping[str, Callable[[], Any]], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, Lap]:
    """Time the sides A B A B ..., so that a slow minute of the machine is slow for all of them.

    Args:
        sides: name -> what is timed.
        repeats: turns of each.
        clock: in seconds; `time.process_time` for CPU time.
    """
    times: dict[str, list[float]] = {name: [] for name in sides}
    results: dict[str, Any] = {}
    for _ in range(repeats):
        for name, side in sides.items():
            results.pop(name, None)  # a side pays for its own memory only
            start = clock()
            results[name] = side()
            times[name].append(clock() - start)
    return {name: Lap(tuple(times[name]), results[name]) for name in sides}


@dataclass(frozen=True)
class Goal:
    """The bound that a comparison must reach, and a further one; None where there is none.

    Attributes:
        required: the bound.
        further: the further one.
        unit: written after the numbers.
        at_least: whether more is better.
    """

    required: float | None
    further: float | None = None
    unit: str = "x"
    at_least: bool = False

    def reaches(self, value: float, bound: float | None) -> bool:
        """Whether a value is as good as a bound; never when there is none."""
        if bound is None:
            return False
        return value >= bound if self.at_least else value <= bound

    def outcome(self, value: float) -> str:
        """Whether a value reaches the goals, in words."""
        if self.reaches(value, self.further):
            return "further goal reached"
        if self.required is None:
            return "no goal" if self.further is None else "further goal not reached"
        return "reached" if self.reaches(value, self.required) else UNREACHED

    def text(self, bound: float | None) -> str:
        """A bound as it stands in the table."""
        return "" if bound is None else f"{'>=' if self.at_least else '<='} {bound:.3g} {self.unit}"


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes:
        comparison: what was compared.
        goal: by which it is judged.
        value: measured, in the goal's unit; None when the comparison was not run.
        ours: our side in words.
        baseline: the other side, or why the comparison was not run.
    """

    comparison: str
    goal: Goal
    value: float | None
    ours: str = ""
    baseline: str = ""

    @property
    def outcome(self) -> str:
        """Whether this comparison reaches its goals, in words."""
        return SKIPPED if self.value is None else self.goal.outcome(self.value)

    def cells(self) -> tuple[str, ...]:
        """As many as `HEADER`."""
        bounds = (self.goal.text(self.goal.required), self.goal.text(self.goal.further))
        measured = "" if self.value is None else f"{self.value:.3g} {self.goal.unit}"
        return (self.comparison, *bounds, measured, self.ours, self.baseline, self.outcome)


def against(comparison: str, goal: Goal, ours: Lap, baseline: Lap, name: str, note: str = "") -> Row:
    """The row of our time over a baseline's."""
    return Row(
        comparison,
        goal,
        ours.median / baseline.median,
        seconds(ours.median) + note,
        f"{name} {seconds(baseline.median)}",
    )


def seconds(value: float) -> str:
    """A time with three digits."""
    return f"{value:.3g} s" if value >= 1 else f"{1000 * value:.3g} ms"


Cells = tuple[str, ...]


def losses(rows: Iterable[Cells]) -> list[str]:
    """One line for each row, by its cells, that missed its goal or was not run."""
    lines = []
    for comparison, required, _, measured, _, baseline, outcome in rows:
        if outcome == UNREACHED:
            lines.append(f"- {comparison}: {measured}, required {required}.")
        elif outcome == SKIPPED:
            lines.append(f"- {comparison}: not compared; {baseline}.")
    return lines


def table_of(text: str, title: str) -> list[Cells]:
    """The cells under a heading of a report, without the head of the table."""
    section = text.partition(f"## {title}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [tuple(cell.strip() for cell in line[1:-1].split("|")) for line in lines[2:]]


def replaced(earlier: Iterable[Cells], later: Iterable[Cells]) -> list[Cells]:
    """Earlier rows, with those that were measured again in their places and new ones at the end."""
    again = {row[0]: row for row in later}
    kept = [again.pop(row[0], row) for row in earlier]
    return [*kept, *again.values()]
