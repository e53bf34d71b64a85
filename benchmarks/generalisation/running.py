"""Runs a benchmark and prints its table, the worst rows first."""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from generalisation.commands import CommandError
from generalisation.rows import Benchmark, Case, Row, Strength
from quadriform.errors import QuadriformError

LADDER = tuple(10.0**exponent for exponent in range(-9, -2))
"""The strengths among which the best one is chosen in hindsight."""


@dataclass(frozen=True)
class Measured:
    """A row of the default with its name, seconds of the processor, and the best strength of the ladder, or None."""

    name: str
    row: Row
    seconds: float
    best: tuple[float, float] | None = None
    ratio: float = float("nan")


def row_of(benchmark: Benchmark, case: Case, strength: Strength) -> Row:
    """The row of a case; an error of the product is a row with an infinite error."""
    try:
        return benchmark.row(case, strength)
    except (CommandError, QuadriformError) as error:
        text = str(error) if isinstance(error, CommandError) else f"exit code {error.exit_code}: {error}"
        return Row(float("inf"), text, float("nan"), False)


def best_in_hindsight(benchmark: Benchmark, case: Case) -> tuple[float, float]:
    """The smallest error over the ladder and its strength."""
    return min((row_of(benchmark, case, strength).error, strength) for strength in LADDER)


def measured(benchmark: Benchmark, with_regret: bool) -> Iterator[Measured]:
    """The rows in the order of the cases."""
    for case in benchmark.cases:
        begin = time.process_time()
        row = row_of(benchmark, case, "auto")
        seconds, best, ratio = time.process_time() - begin, None, float("nan")
        if with_regret and benchmark.has_ladder:
            best = best_in_hindsight(benchmark, case)
            ratio = regret(row.error, best[0], benchmark.least_error)
        name = " ".join(map(str, case))
        print(f"{benchmark.title}: {name}, {seconds:.1f} s of the processor", file=sys.stderr, flush=True)
        yield Measured(name, row, seconds, best, ratio)


def regret(error: float, best: float, least: float = 0.0) -> float:
    """The error over that of the best strength; both count as `least` where they are smaller.

    Without any result the ratio is NaN, or infinite where only the default has none.
    """
    return float("nan") if not np.isfinite(best) else max(error, least) / max(best, least, np.finfo(float).tiny)


def print_table(benchmark: Benchmark, found: Sequence[Measured]) -> None:
    """A table in Markdown, the largest error first."""
    names = list(dict.fromkeys(name for each in found for name in each.row.numbers))
    with_regret = any(each.best for each in found)
    header = ["case", benchmark.error, "correct", *names, "min det J", "CPU s"]
    header += ["best error", "its strength", "ratio"] if with_regret else []
    print(f"## {benchmark.title}\n\n| " + " | ".join([*header, "status"]) + " |\n|" + " --- |" * (len(header) + 1))
    for each in sorted(found, key=lambda each: -each.row.error):
        print("| " + " | ".join(_cells(each, names, with_regret)) + " |")
    print()


def _cells(each: Measured, names: Sequence[str], with_regret: bool) -> list[str]:
    row = each.row
    numbers = [f"{row.numbers[name]:.3g}" if name in row.numbers else "" for name in names]
    cells = [each.name, f"{row.error:.3g}", {True: "yes", False: "no", None: ""}[row.correct], *numbers]
    cells += [f"{row.fold:.2g}", f"{each.seconds:.1f}"]
    if with_regret:
        best, strength = each.best or (float("nan"), float("nan"))
        cells += [f"{best:.3g}", f"{strength:.0e}", f"{each.ratio:.2f}"]
    return [*cells, row.status]


def summary(benchmark: Benchmark, found: Sequence[Measured]) -> str:
    """The line of a benchmark."""
    rows = [each.row for each in found]
    failed = sum(not np.isfinite(row.error) for row in rows)
    text = f"{benchmark.title}: {benchmark.figure(rows)}"
    text += f"; {failed} of {len(rows)} without a result" if failed else ""
    return f"{text}; required {benchmark.required}"


def regret_line(found: Sequence[Measured]) -> str:
    """The line of the ratios of all benchmarks."""
    ratios = np.array([each.ratio for each in found if not np.isnan(each.ratio)])
    text = f"{np.median(ratios):.2f} / {ratios.max():.2f} in {len(ratios)} rows" if len(ratios) else "not measured"
    return f"regret, median / worst: {text}; required 1.1 / 1.5"


def status_lines(found: Sequence[Measured]) -> list[str]:
    """How far the status of all rows can be trusted: wrong ones that are "ok", correct ones that are not."""
    rows = [each.row for each in found if np.isfinite(each.row.error) and each.row.correct is not None]
    ok = [row for row in rows if row.status == "ok"]
    warned, correct = [row for row in rows if row.status != "ok"], sum(row.correct for row in rows)
    silent, needless = sum(not row.correct for row in ok), sum(row.correct for row in warned)
    return [
        f'silent failures: {silent} of {len(ok)} "ok" are wrong; required 0',
        f"warned although correct: {needless} of {len(warned)} warned, of {correct} correct; required < 15 %",
    ]
