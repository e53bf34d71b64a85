"""Where the subjects of `quadriform cohort` are fitted."""

from dataclasses import dataclass
from typing import Annotated


@dataclass(frozen=True)
class EngineChoice:
    """Where the subjects are fitted; at most one of them is given.

    Engine:
        processes: Processes of this machine. [default: one a core]
        workers: Start a local cluster of dask.distributed with this number of workers.
        scheduler: Address of a scheduler of dask.distributed, as tcp://host:8786.
    """

    processes: Annotated[int | None, {"min": 1}] = None
    workers: Annotated[int | None, {"min": 1}] = None
    scheduler: str | None = None
