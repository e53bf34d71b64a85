"""What `quadriform cohort` does: the engine, the lines during the run, and the closing table."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Any

from quadriform.cli.engine_choice import EngineChoice
from quadriform.cli.screen import print_line, show
from quadriform.cohort import executors, failures, modes, page, stores
from quadriform.cohort.run import Choices, OnOutcome, Summary, run
from quadriform.cohort.scheduling import WorkerPool
from quadriform.cohort.subject import FAILED, FITTED, KEPT, Outcome
from quadriform.errors import OptionError
from quadriform.shapes.threads import cores

EVERY = 30.0
"""Seconds between two lines where no bar can be drawn."""
MOST_LINES = 20
"""Failures that are reported one by one; all are in the table."""


def run_and_show(
    manifest: Path, output: Path, choices: Choices, engine: EngineChoice, show_ids: bool, as_json: bool
) -> int:
    """How many subjects of this part of the cohort failed, after they were fitted and the results shown.

    Args:
        manifest: the list.
        output: folder for the results.
        choices: which subjects are fitted, and how.
        engine: where.
        show_ids: whether subjects are named on the screen.
        as_json: on stdout.

    Raises:
        QuadriformError: the list or an option cannot be used, or the results cannot be written.
    """
    start = _engine(engine)
    with _reporting(show_ids) as report:
        summary = run(manifest, output, start, choices, report)
    record = _record(output, summary)
    show(record, as_json, _rows(record), str(manifest))
    return summary.counts[FAILED]


def _engine(chosen: EngineChoice) -> Callable[[], AbstractContextManager[WorkerPool]]:
    if sum(value is not None for value in astuple(chosen)) > 1:
        raise OptionError("options --processes, --workers and --scheduler exclude each other; give one")
    if chosen.workers is None and chosen.scheduler is None:
        return partial(executors.processes, chosen.processes or cores())
    # before anything is read: the message says how to install it
    stores.require_library("distributed")
    return partial(executors.cluster, chosen.scheduler, chosen.workers or 0)


# --- during the run ---------------------------------------------------------------------------------------------


@contextmanager
def _reporting(show_ids: bool) -> Iterator[OnOutcome]:
    """A bar with rate and time left on a terminal, a line now and then elsewhere; the first failures by line."""
    lines = 0
    with _bar() if sys.stderr.isatty() else _log() as update:

        def report(outcome: Outcome, done: int, total: int) -> None:
            """Show an outcome: advance the bar, and print the first failures."""
            nonlocal lines
            if outcome.failure is not None:
                lines += 1
                # thousands of lines would hide the bar; the table has them all
                if lines <= MOST_LINES:
                    print_line(_failure(outcome, show_ids))
                if lines == MOST_LINES:
                    print_line(f"further failures are listed in {failures.TABLE} only")
            update(done, total)

        yield report


def _failure(outcome: Outcome, show_ids: bool) -> str:
    """One line; messages of errors contain paths, which contain ids: without `show_ids` only the kind is shown."""
    kind, error = (outcome.failure.kind, outcome.failure.error) if outcome.failure else ("", "")
    return f"failed: {outcome.id}: {kind}: {error}" if show_ids else f"failed: subject {outcome.number + 1}: {kind}"


@contextmanager
def _bar() -> Iterator[Callable[[int, int], None]]:
    from rich import progress
    from rich.console import Console

    rate = progress.TextColumn("{task.fields[rate]}")
    bars = (progress.BarColumn(), progress.MofNCompleteColumn(), rate)
    times = (progress.TimeElapsedColumn(), progress.TextColumn("left"), progress.TimeRemainingColumn())
    begin = time.monotonic()
    with progress.Progress(*bars, *times, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, rate="")

        def update(done: int, total: int) -> None:
            """Draw the bar."""
            bar.update(task, completed=done, total=total, rate=f"{done / (time.monotonic() - begin):.3g}/s")

        yield update


@contextmanager
def _log() -> Iterator[Callable[[int, int], None]]:
    begin = last = time.monotonic()

    def update(done: int, total: int) -> None:
        """Print a line every few seconds."""
        nonlocal last
        now = time.monotonic()
        if now - last >= EVERY:
            last, rate = now, done / (now - begin)
            print_line(
                f"{done} of {total} subjects, {rate:.3g} a second, about {_duration((total - done) / rate)} left"
            )

    yield update


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes else f"{seconds:.0f} s"


# --- at the end --------------------------------------------------------------------------------------------------


def _record(output: Path, summary: Summary) -> dict[str, Any]:
    layout = summary.layout
    written = [output / name for name in ("subjects", stores.STORE, stores.TABLE, failures.TABLE)]
    written += [output / name for name in (modes.FOLDER, page.NAME) if (output / name).exists()]
    return {
        "subjects": summary.subjects,
        **{how: summary.counts[how] for how in (FITTED, KEPT, FAILED)},
        "cohort": {"subjects": layout.subjects, "complete": summary.complete, "failed": summary.failed},
        "warned": summary.warned,
        "warnings": dict(summary.kinds),
        "frames": layout.frames,
        "surfaces": list(layout.surfaces),
        "space": layout.space,
        "unit": layout.unit,
        "outputs": [str(path) for path in written],
        "seconds": round(summary.seconds, 3),
    }


def _rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    whole = record["cohort"]
    state = "complete" if whole["complete"] else "other shards are not done"
    return [
        ("subjects", str(record["subjects"])),
        *((how, str(record[how])) for how in (FITTED, KEPT, FAILED)),
        ("whole cohort", f"{whole['subjects']} subjects, {whole['failed']} failed, {state}"),
        ("with warnings", "\n".join([str(record["warned"]), *(f"{k}: {n}" for k, n in record["warnings"].items())])),
        ("frames, surfaces", f"{record['frames']}, {', '.join(record['surfaces'])}"),
        ("frame, unit", f"{record['space']}, {record['unit']}"),
        ("time", f"{record['seconds']:.1f} s, {record['subjects'] / max(record['seconds'], 1e-9):.3g} a second"),
        ("written", "\n".join(record["outputs"])),
    ]
