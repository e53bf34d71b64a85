"""What the subcommands show: data on stdout as a table or as JSON; warnings, notes and progress on stderr."""

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from quadriform.errors import Warnings
from quadriform.shapes.record import Remark, remarks
from quadriform.words import plain

QUIET_SECONDS = 1.0
"""Work shorter than this shows no progress bar."""
Rows = Sequence[Sequence[str]]


def print_line(text: str) -> None:
    """One line on stderr, without control characters."""
    print(plain(" ".join(text.split())), file=sys.stderr)


def note(text: str) -> None:
    """A note on stderr."""
    print_line(f"note: {text}")


def warn(warnings: Warnings, about: str = "") -> None:
    """The named warnings on stderr, one line each; `about` names their subject."""
    print_remarks(remarks(warnings, about=about))


def print_remarks(every: Iterable[Remark]) -> None:
    """Warnings and notes on stderr, one line each."""
    for remark in every:
        print_line(f"{'warning' if remark.kind else 'note'}: {remark}")


def texts(warnings: Warnings) -> dict[str, str]:
    """Warnings as a JSON object: kind -> sentence."""
    return {str(kind): text for kind, text in warnings.items()}


def closing_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The last rows of the table of a fit: its warnings, its notes, and what was written."""
    return [
        ("warnings", ", ".join(record["warnings"]) or "none"),
        *([("notes", "\n".join(record["notes"]))] if record["notes"] else []),
        ("written", "\n".join(record["outputs"])),
    ]


def emit(text: str) -> None:
    """Data on stdout; a reader that went away (`| head`) is no error."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # else Python would fail once more when it flushes stdout at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def show(record: object, as_json: bool, rows: Rows | str, title: str = "", header: Sequence[str] = ()) -> None:
    """The result on stdout: its record as JSON, or the rows of a table, or lines of text."""
    if as_json:
        emit(json.dumps(record, indent=2, allow_nan=False))
    elif isinstance(rows, str):
        emit(rows)
    else:
        emit_table(rows, title, header)


def emit_table(rows: Rows, title: str = "", header: Sequence[str] = ()) -> None:
    """A table on stdout; without a header the first column names what the second holds."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=bool(header))
    for name in header or [""] * len(rows[0]):
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))  # as Text: a file name may look like markup
    console = Console()
    with console.capture() as captured:
        console.print(table)
    emit("\n".join(filter(None, [title, captured.get().rstrip("\n")])))


@contextlib.contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A callback (done, total) that draws a bar on stderr once the work has taken a second; only on a terminal."""
    if not sys.stderr.isatty():
        yield lambda _done, _total: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    bar = Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True)
    task = bar.add_task(escape(what), total=None)
    begin = time.monotonic()

    def update(done: int, total: int) -> None:
        """Draw the bar, which appears only when the work takes long."""
        bar.update(task, completed=done, total=total)
        if time.monotonic() - begin > QUIET_SECONDS:
            bar.start()

    try:
        yield update
    finally:
        if bar.live.is_started:
            bar.stop()
