"""The table of subjects without a result: one row each with the error and its kind."""

import csv
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from quadriform.cohort.stores import part_name
from quadriform.cohort.subject import Outcome
from quadriform.files.atomic import make_folder, write_bytes
from quadriform.words import csv_bytes

TABLE = "failures.csv"
PARTS = "failures"
HEADER = ("id", "error", "kind")


def write_part(results: Path, block: int, outcomes: Sequence[Outcome]) -> None:
    """Write the failures of a block; a block without any has no part, and that of an earlier run is removed.

    Raises:
        OutputError: it cannot be written.
    """
    failed = [(each.id, each.failure.error, each.failure.kind) for each in outcomes if each.failure is not None]
    path = results / PARTS / part_name(block, ".csv")
    if failed:
        make_folder(path.parent)
        write_bytes(path, csv_bytes(HEADER, failed), force=True)
    else:
        with suppress(FileNotFoundError):
            path.unlink()


def gather(results: Path) -> int:
    """Write the table of all existing parts, and return its number of rows.

    Another process may write a part meanwhile: the parts are compared again at the end, so that no row is missing.

    Raises:
        OutputError: it cannot be written.
    """
    while True:
        before = _state(results)
        found = [row for part in before for row in rows(part)]
        write_bytes(results / TABLE, csv_bytes(HEADER, found), force=True)
        if _state(results) == before:
            return len(found)


def _state(results: Path) -> dict[Path, int]:
    found = {}
    for part in sorted((results / PARTS).glob("*.csv")):
        with suppress(FileNotFoundError):
            found[part] = part.stat().st_mtime_ns
    return found


def rows(part: Path) -> list[tuple[str, ...]]:
    """Return the rows of the table or of a part, without its header; empty where there is none."""
    try:
        with open(part, encoding="utf-8", newline="") as stream:
            return [tuple(row) for row in csv.reader(stream)][1:]
    except FileNotFoundError:
        return []  # another process removed it: its block has no failures now
