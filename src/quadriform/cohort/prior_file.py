"""The prior of shape of a cohort: one file for all subjects, checked before any of them is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.errors import InputError, OptionError
from quadriform.files.priors import read_prior
from quadriform.files.reading import quoted, sha256_of
from quadriform.fitting.population.checks import OF_PRIOR
from quadriform.shapes.prior import ShapePrior

if TYPE_CHECKING:
    from quadriform.cohort.layout import Layout


@dataclass(frozen=True)
class PriorFile:
    """A file with a prior, which workers read themselves: it is larger than a task.

    Attributes:
        path: absolute.
        sha256: of its bytes.
    """

    path: Path = field(repr=False)
    sha256: str

    @classmethod
    def of(cls, path: Path) -> PriorFile:
        """Of a path.

        Raises:
            InputError, FileFormatError: it is missing or empty.
        """
        return cls(path.absolute(), sha256_of(path))

    def read(self) -> ShapePrior:
        """The prior.

        Raises:
            InputError, FileFormatError, FileLimitError: no prior, or another one than when the run began.
        """
        return _read(self)

    @property
    def box(self) -> tuple[int, int, int]:
        """Control points along each axis."""
        l, m, n, _ = self.read().box.control_points.shape
        return l, m, n

    def check_options(self, options: Mapping[str, Any]) -> None:
        """Refuse options of a subject that the prior takes the place of.

        Raises:
            OptionError: naming the option.
        """
        for name in OF_PRIOR:
            if name in options:
                raise OptionError(f"{name}: not with a prior, which has its own box and weights")
        if options.get("method") == "paper":
            raise OptionError("method: a prior is not an option of the method 'paper'; use 'tangent'")
        if options.get("strategy") == "previous":
            raise OptionError("strategy: a prior is not an option of the strategy 'previous'; use 'cycle'")

    def check_layout(self, layout: Layout, space: str | None) -> None:
        """Refuse subjects whose shapes are none of the population.

        Args:
            layout: of the results.
            space: that the results are transformed to; None for that of the subjects.

        Raises:
            InputError: of other surfaces, or in another unit or frame.
        """
        prior, where = self.read(), quoted(self.path)
        if set(prior.surfaces) != set(layout.surfaces):
            expected, found = ", ".join(prior.surfaces), ", ".join(layout.surfaces)
            raise InputError(f"{where}: a prior of the surfaces {expected}; the subjects have {found}")
        pairs = [("unit", prior.unit, layout.unit)] + ([("space", prior.space, layout.space)] if space is None else [])
        for what, own, other in pairs:
            if "unknown" not in (own, other) and own != other:
                raise InputError(f"{where}: a prior in the {what} {own}; the subjects are in {other}")


@lru_cache(maxsize=1)  # of a worker, which gets one subject after the other
def _read(file: PriorFile) -> ShapePrior:
    if sha256_of(file.path) != file.sha256:
        raise InputError(f"{quoted(file.path)}: has changed since the run began; start it again")
    return read_prior(file.path)
