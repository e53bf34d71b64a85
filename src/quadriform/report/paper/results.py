"""All fits of the page, made once and shared by its figures."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quadriform.report.paper import subjects
from quadriform.report.paper.robustness import Robustness, measure_robustness
from quadriform.report.paper.subjects import Reduced, Scan, Subject
from quadriform.report.paper.trade_off import TradeOff, measure_trade_off


@dataclass(frozen=True)
class Results:
    """What the figures are drawn from.

    Attributes:
        crossing: the paper's synthetic example.
        ventricle: a synthetic ventricle, complete and sparse.
        trade_off: what each regularity costs.
        robustness: errors with more and more strangers among the points.
        brain: the image that is always there.
        first: in the place of the paper's first image, SPECT of 64 x 64 x 64 voxels.
        second: in the place of its second, coarser SPECT.
        third: in the place of its third, of the Dynamic Spatial Reconstructor; both walls in one box.
        human: real contours, where there is real data.
    """

    crossing: Subject
    ventricle: Reduced
    trade_off: TradeOff
    robustness: Robustness
    brain: Scan
    first: Scan
    second: Scan
    third: Scan
    human: Subject | None = None

    @property
    def real(self) -> bool:
        """Whether real hearts were given."""
        return self.human is not None


def collect(folder: Path | None, step: Callable[[], None]) -> Results:
    """Read and fit everything.

    Args:
        folder: of real data; None is brain and synthetic data only.
        step: called after each of `count(folder)` pieces.

    Raises:
        InputError, FileFormatError: a file of the folder is missing or damaged.
    """
    done: dict[str, Any] = {}
    for name, job in _jobs(folder).items():
        done[name] = job()
        step()
    return Results(**({"first": done["brain"]} | done))


def count(folder: Path | None) -> int:
    """How many pieces `collect` has."""
    return len(_jobs(folder))


def _jobs(folder: Path | None) -> dict[str, Callable[[], object]]:
    always: dict[str, Callable[[], object]] = {
        "crossing": subjects.crossing,
        "ventricle": subjects.reduced_ventricle,
        "trade_off": measure_trade_off,
        "robustness": measure_robustness,
        "brain": subjects.brain,
    }
    if folder is None:
        return always | {"second": subjects.coarse_brain, "third": subjects.scanner}
    return always | {
        "first": lambda: subjects.spect(folder, 1),
        "second": lambda: subjects.spect(folder, 2),
        "third": lambda: subjects.pig(folder),
        "human": lambda: subjects.human(folder),
    }
