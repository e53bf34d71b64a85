"""A run: subjects of one part of the list are processed by a pool, and their results stored block by block."""

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
from quadriform.cohort.prior_file import PriorFile
from quadriform.cohort.scheduling import WorkerPool, completed
from quadriform.cohort.subject import FAILED, MODEL, Failure, Outcome, Task, subject_folder, work
from quadriform.errors import OptionError, OutputError
from quadriform.files.atomic import check_folder, make_folder
from quadriform.files.reading import quoted

OnOutcome = Callable[[Outcome, int, int], None]
"""Called with each outcome, the number of outcomes so far, and the total."""


@dataclass(frozen=True)
class Choices:
    """The options of a run.

    Attributes:
        options: for subjects without their own, by the names of the list's columns.
        shard: which part, from 1, of how many.
        resume: keep results that are unchanged.
        force: process all subjects again.
        strict: the mildest status that is refused, or None.
        space: to write in; None for that of the first subject.
        prior: file of a prior of shape, of whose population all subjects are, in all frames.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    shard: tuple[int, int] = (1, 1)
    resume: bool = False
    force: bool = False
    strict: str | None = None
    space: str | None = None
    prior: Path | None = None

    def __post_init__(self) -> None:
        part, parts = self.shard
        if not 1 <= part <= parts:
            raise OptionError(f"option --shard={part}/{parts}: expected a part from 1 to {parts}")
        if self.resume and self.force:
            raise OptionError("options --resume and --force exclude each other; give one")


@dataclass(frozen=True)
class Summary:
    """The result of a run.

    Attributes:
        subjects: number of subjects of its part.
        counts: numbers of "fitted", "kept" and "failed" subjects.
        complete: whether every block of the cohort is done, by this run or another.
        failed: rows of the table of failures, those of other runs included.
        warned: number of subjects of its part that have a model with warnings.
        kinds: kind of a warning -> number of these subjects.
        seconds: duration.
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
    report: OnOutcome = lambda _outcome, _done, _total: None,
) -> Summary:
    """Return the summary of a run over the subjects of a list, or of a part of it.

    Args:
        manifest: the list.
        results: folder, created where it is missing.
        engine: starts the pool of workers; called after all checks.
        choices: options.
        report: called with each outcome.

    Raises:
        QuadriformError: the list is faulty or the results cannot be written; subjects that fail raise nothing.
    """
    begin = time.perf_counter()
    prior = None if choices.prior is None else PriorFile.of(choices.prior)
    listed, layout, blocks = _prepared(manifest, results, choices, prior)
    tasks = _tasks(listed, results, layout, blocks, choices, prior)
    total = sum(len(layout.members(block)) for block in blocks)
    counts: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    warned = 0
    try:
        with engine() as pool:
            for outcome in _stored(results, layout, _outcomes(tasks, pool)):
                counts[outcome.how] += 1
                found = kinds_of(outcome.measures)
                kinds.update(found)
                warned += bool(found)
                report(outcome, counts.total(), total)
    except BrokenExecutor as error:
        raise OutputError(f"the workers are gone: {error}; results are kept, run again with --resume") from error
    failed = failures.gather(results)
    complete = len(stores.parts(results)) == layout.blocks
    if complete:
        write_page(results, layout, write_modes(results, layout))
    return Summary(total, counts, complete, failed, warned, kinds, time.perf_counter() - begin, layout)


def _prepared(
    manifest: Path, results: Path, choices: Choices, prior: PriorFile | None
) -> tuple[Manifest, Layout, range]:
    """The checked list, the layout of the results, and the blocks of this run; the store exists afterwards."""
    for library in ("zarr", "pyarrow"):
        stores.require_library(library)
    of_prior = () if prior is None else (prior.box, prior.check_options)
    listed = read_manifest(manifest, choices.options, *of_prior)
    check_folder(results)
    make_folder(results)
    layout = ensure_layout(results, listed, choices.space, choices.shard[1], prior)
    blocks = layout.blocks_of(*choices.shard)
    if not (choices.resume or choices.force):
        _refuse_done(results, listed, layout, blocks)
    stores.make_store(results, layout)
    return listed, layout, blocks


def _tasks(
    listed: Manifest, results: Path, layout: Layout, blocks: range, choices: Choices, prior: PriorFile | None
) -> Iterator[Task]:
    for row in listed.rows():
        if row.number // layout.block in blocks:
            yield Task(row, listed.folder, results.absolute(), layout, choices.resume, choices.strict, prior)


def _outcomes(tasks: Iterator[Task], engine: WorkerPool) -> Iterator[Outcome]:
    for task, result in completed(tasks, work, engine):
        if isinstance(result, Outcome):
            yield result
        else:  # the worker died
            yield Outcome(task.row.number, task.row.id, FAILED, failure=Failure.of_worker(result))


def _stored(results: Path, layout: Layout, outcomes: Iterator[Outcome]) -> Iterator[Outcome]:
    """The same outcomes; a block is written after its last one, and then released from memory."""
    blocks: dict[int, dict[int, Outcome]] = {}
    for outcome in outcomes:
        block = outcome.number // layout.block
        mine = blocks.setdefault(block, {})
        mine[outcome.number] = outcome
        if len(mine) == len(layout.members(block)):
            ordered = [mine[number] for number in layout.members(block)]
            stores.write_parameters(results, layout, block, ordered)
            failures.write_part(results, block, ordered)
            stores.write_measures(results, block, ordered)  # the last one marks the block as done
            del blocks[block]
        yield outcome


def _refuse_done(results: Path, listed: Manifest, layout: Layout, blocks: range) -> None:
    """Refuse a part of which a subject has results already."""
    for row in listed.rows():
        if row.number // layout.block in blocks and (subject_folder(results, row.id) / MODEL).exists():
            raise OutputError(
                f"{quoted(results)}: contains results of these subjects; --resume continues, --force replaces them"
            )
