"""A run: subjects of a share of the list go to an engine, and what comes back goes to the stores, block by block."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from quadriform.cohort import failures, stores
from quadriform.cohort.layout import Layout, ensure_layout
from quadriform.cohort.manifest import Manifest, read_manifest
from quadriform.cohort.measures import kinds_of
from quadriform.cohort.modes import write_modes
from quadriform.cohort.page import write_page
from quadriform.cohort.scheduling import WorkerPool, completed
from quadriform.cohort.subject import FAILED, MODEL, Failure, Outcome, Task, subject_folder, work
from quadriform.errors import OptionError, OutputError
from quadriform.files.atomic import check_folder, make_folder
from quadriform.files.reading import quoted

OnOutcome = Callable[[Outcome, int, int], None]
"""Called with each outcome, how many there are now, and how many there will be."""


@dataclass(frozen=True)
class Choices:
    """How a cohort is done.

    Attributes:
        options: of all subjects that do not say otherwise, by the names of the list's columns.
        shard: which part of how many, from 1.
        resume: keep what is done and unchanged.
        force: do everything again.
        strict: refuse results with warnings.
        space: frame of the world to write in; None for that of the first subject.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    shard: tuple[int, int] = (1, 1)
    resume: bool = False
    force: bool = False
    strict: bool = False
    space: str | None = None

    def __post_init__(self) -> None:
        part, parts = self.shard
        if not 1 <= part <= parts:
            raise OptionError(f"option --shard={part}/{parts}: expected a part from 1 to {parts}")
        if self.resume and self.force:
            raise OptionError("options --resume and --force exclude each other; give one")


@dataclass(frozen=True)
class Summary:
    """What a run did.

    Attributes:
        subjects: of its share.
        counts: how many were "fitted", "kept" and "failed".
        complete: whether every block of the cohort is done, by this run or another.
        failed: rows of the table of failures, those of other runs included.
        warned: how many of the subjects of its share have a model with warnings.
        kinds: of warnings, how many of these subjects have each.
        seconds: how long it took.
        layout: of the results.
    """

    subjects: int
    counts: Mapping[str, int]
    complete: bool
    failed: int
    warned: int
    kinds: Mapping[str, int]
    seconds: float
    layout: Layout


def run(
    manifest: Path,
    results: Path,
    engine: Callable[[], AbstractContextManager[WorkerPool]],
    choices: Choices,
    told: OnOutcome = lambda _outcome, _done, _total: None,
) -> Summary:
    """Do the subjects of a list, or of a share of it.

    Args:
        manifest: the list.
        results: folder, made where it is missing.
        engine: starts who does the work; called after everything was checked.
        choices: how.
        told: of each outcome.

    Raises:
        QuadriformError: the list is faulty or the results cannot be written; subjects that fail raise nothing.
    """
    begin = time.perf_counter()
    for library in ("zarr", "pyarrow", "sklearn"):
        stores.needs(library)
    listed = read_manifest(manifest, choices.options)
    check_folder(results)
    make_folder(results)
    layout = ensure_layout(results, listed, choices.space, choices.shard[1])
    blocks = layout.share(*choices.shard)
    if not (choices.resume or choices.force):
        _refuse_done(results, listed, layout, blocks)
    stores.make_store(results, layout)
    tasks = _tasks(listed, results, layout, blocks, choices)
    total = sum(len(layout.members(block)) for block in blocks)
    counts: Counter[str] = Counter()
    warned: Counter[tuple[str, ...]] = Counter()
    try:
        with engine() as started:
            for outcome in _stored(results, layout, _outcomes(tasks, started)):
                counts[outcome.how] += 1
                warned[kinds_of(outcome.measures)] += 1
                told(outcome, counts.total(), total)
    except BrokenExecutor as error:
        raise OutputError(f"the workers are gone: {error}; what is done is kept, run again with --resume") from error
    failed = failures.gather(results)
    complete = len(stores.parts(results)) == layout.blocks
    if complete:
        write_page(results, layout, write_modes(results, layout))
    kinds: Counter[str] = Counter()
    for each, times in warned.items():
        kinds.update(dict.fromkeys(each, times))
    seconds = time.perf_counter() - begin
    return Summary(total, counts, complete, failed, total - warned[()], kinds, seconds, layout)


def _tasks(listed: Manifest, results: Path, layout: Layout, blocks: range, choices: Choices) -> Iterator[Task]:
    for row in listed.rows():
        if row.number // layout.block in blocks:
            yield Task(row, listed.folder, results.absolute(), layout, choices.resume, choices.strict)


def _outcomes(tasks: Iterator[Task], engine: WorkerPool) -> Iterator[Outcome]:
    for task, result in completed(tasks, work, engine):
        if isinstance(result, Outcome):
            yield result
        else:  # the worker died of it, or the engine lost it
            yield Outcome(task.row.number, task.row.id, FAILED, failure=Failure.lost(result))


def _stored(results: Path, layout: Layout, outcomes: Iterator[Outcome]) -> Iterator[Outcome]:
    """The outcomes, each passed on; a block is written when its last one is there, and forgotten."""
    held: dict[int, dict[int, Outcome]] = {}
    for outcome in outcomes:
        block = outcome.number // layout.block
        mine = held.setdefault(block, {})
        mine[outcome.number] = outcome
        if len(mine) == len(layout.members(block)):
            ordered = [mine[number] for number in layout.members(block)]
            stores.write_parameters(results, layout, block, ordered)
            failures.write_part(results, block, ordered)
            stores.write_measures(results, block, ordered)  # the last: the block is done
            del held[block]
        yield outcome


def _refuse_done(results: Path, listed: Manifest, layout: Layout, blocks: range) -> None:
    """Refuse a share of which something is done already; a list of any length is looked through one by one."""
    for row in listed.rows():
        if row.number // layout.block in blocks and (subject_folder(results, row.id) / MODEL).exists():
            raise OutputError(
                f"{quoted(results)}: holds results of these subjects already; --resume goes on, --force does all again"
            )
