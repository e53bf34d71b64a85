"""A benchmark, its rows, and what several of them measure."""

import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import quadriform as qf

Strength = float | str
"""As `qf.fit` takes it; "auto" is the default that is judged."""
Case = tuple[Any, ...]
"""Kind and number of one input."""


class Missing(Exception):
    """A benchmark cannot run; the message has the reason."""


@dataclass(frozen=True)
class Row:
    """What one input gave.

    Attributes:
        error: to the truth, 0 or larger, by which rows are sorted.
        status: "ok", or the level and the names of the warnings.
        fold: smallest det J of the maps; not positive where one folds, NaN where there is no map.
        correct: whether the error is below what the benchmark accepts of an "ok"; None without a truth.
        numbers: further columns.
    """

    error: float
    status: str
    fold: float
    correct: bool | None
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Benchmark:
    """One table.

    Attributes:
        title: its name.
        error: what the column of errors has, with the unit.
        cases: the inputs.
        row: from a case and a strength to its row.
        figure: from all rows to the text of the summary.
        required: what the figure is compared with.
        has_ladder: whether `row` depends on the strength and its error is one to the truth.
        least_error: smaller errors count as this one in the ratio to the best strength.
    """

    title: str
    error: str
    cases: Sequence[Case]
    row: Callable[[Case, Strength], Row]
    figure: Callable[[Sequence[Row]], str]
    required: str
    has_ladder: bool = True
    least_error: float = 0.0


def bench_module(shared: Path, folder: str, name: str) -> ModuleType:
    """The module of benchmark data with the truth, `bench/FOLDER/NAME.py`.

    Raises:
        Missing: it is absent, or needs a package that is not installed.
    """
    path = present(shared / "bench" / folder / f"{name}.py")
    spec = importlib.util.spec_from_file_location(f"bench_{folder}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def present(path: Path) -> Path:
    """The same path.

    Raises:
        Missing: there is nothing.
    """
    if not path.exists():
        raise Missing(f"there is no {path.name!r} in the folder {path.parent}")
    return path


def needs(package: str) -> None:
    """Check that a package is installed.

    Raises:
        Missing: it is not.
    """
    if importlib.util.find_spec(package) is None:
        raise Missing(f"it needs {package}, which is not installed; pip install -c constraints.txt -e '.[bench]'")


def status_text(status: str, warnings: Sequence[str] | Mapping[str, str]) -> str:
    """The level of a result and the names of its warnings."""
    return f"{status}: {', '.join(warnings)}" if warnings else status


def joined_status(parts: Mapping[str, str]) -> str:
    """One status of several fits: "ok" where all are."""
    texts = [f"{name} {status}" for name, status in parts.items() if status != "ok"]
    return "; ".join(texts) or "ok"


def fraction_within(fit: qf.Fit, truth: np.ndarray, surface: str | None = None) -> float:
    """Percentage of points (n, 3) of the true surface within two standard deviations of the fitted one."""
    distances = np.abs(fit.model.distance(truth, surface))
    return float(100 * (distances <= 2 * fit.uncertainty(truth, surface)).mean())


def column(rows: Sequence[Row], name: str) -> np.ndarray:
    """The numbers of a column, of the rows that have it."""
    return np.array([row.numbers[name] for row in rows if name in row.numbers])


def errors(rows: Sequence[Row]) -> np.ndarray:
    """The errors of the rows that have a result."""
    found = np.array([row.error for row in rows])
    return found[np.isfinite(found)]


def mean(values: np.ndarray) -> float:
    """The mean, NaN of nothing."""
    return float(values.mean()) if len(values) else float("nan")


def largest(values: np.ndarray) -> float:
    """The largest value, NaN of nothing."""
    return float(values.max()) if len(values) else float("nan")


def percent_ok(rows: Sequence[Row]) -> float:
    """Percentage of rows with the status "ok"."""
    return mean(np.array([100.0 * (row.status == "ok") for row in rows]))


def count_folds(rows: Sequence[Row]) -> str:
    """How many maps fold, of how many."""
    found = [row.fold for row in rows if np.isfinite(row.fold)]
    return f"{sum(fold <= 0 for fold in found)} of {len(found)} fold"
