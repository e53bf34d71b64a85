"""What the verbs show: data on stdout as a table or as JSON; warnings and progress on stderr."""

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence

from quadriform.errors import Warnings
from quadriform.shapes.record import Remark, remarks
from quadriform.words import plain

QUIET_SECONDS = 1.0
"""Work shorter than this shows no progress bar."""


def say(text: str) -> None:
    """One line on stderr, without control characters."""
    print(plain(" ".join(text.split())), file=sys.stderr)


def warn(warnings: Warnings, about: str = "") -> None:
    """The named warnings on stderr, one line each; `about` says of what."""
    tell(remarks(warnings, about=about))


def tell(every: Iterable[Remark]) -> None:
    """Warnings and notes on stderr, one line each."""
    for remark in every:
        say(f"{'warning' if remark.kind else 'note'}: {remark}")


def emit(text: str) -> None:
    """Data on stdout; a reader that went away (`| head`) is no error."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def emit_json(data: object) -> None:
    """Data on stdout as JSON."""
    emit(json.dumps(data, indent=2, allow_nan=False))


def emit_table(rows: Sequence[Sequence[str]], title: str = "", header: Sequence[str] = ()) -> None:
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

    def show(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)
        if time.monotonic() - begin > QUIET_SECONDS:
            bar.start()

    try:
        yield show
    finally:
        if bar.live.is_started:
            bar.stop()
