"""What the benchmarks share: where the beds are, and tables."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED = REPOSITORY.parent / "shared"


def bench_data(name: str) -> Path | None:
    """The folder of a test data set, put on the import path; None, and said, where it is missing."""
    folder = SHARED / "bench" / name
    if not folder.is_dir():
        print(f"skipped: there is no test data set {name!r} beside this repository")
        return None
    sys.path.insert(0, str(folder))
    return folder


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table in Markdown, row by row as they come."""
    print("| " + " | ".join(header) + " |\n|" + " --- |" * len(header), flush=True)
    for row in rows:
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def one_thread() -> AbstractContextManager:
    """BLAS held to one thread within: our matrices are tiny, and threads that share them cost more than they bring."""
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, "blas")
