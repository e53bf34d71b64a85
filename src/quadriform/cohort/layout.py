"""What all results of a cohort have in common, fixed by the first run: sizes, surfaces, space, unit and blocks.

A block is the subjects of one part of the store and of the table. It has one writer, so that several processes write
into one store without a lock.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from quadriform.cohort.manifest import Manifest
from quadriform.cohort.prior_file import PriorFile
from quadriform.cohort.subject_files import FileSummary, inspect_files
from quadriform.errors import InputError, OptionError, QuadriformError
from quadriform.files.atomic import create_bytes
from quadriform.files.models import parse_json
from quadriform.files.reading import quoted, read_bytes
from quadriform.files.strict import Field

NAME = "cohort.json"
FORMAT = "quadriform-cohort"
VERSION = 2
"""Since 2 with the prior."""
LARGEST_BLOCK = 100
CHUNK = 10
"""Largest number of subjects that a reader of the store expands at once."""


@dataclass(frozen=True)
class Layout:
    """What the results of all subjects have in common.

    Attributes:
        subjects: number of subjects.
        sha256: of their ids in order.
        frames: the largest number of frames of a subject; those of others are padded with NaN.
        surfaces: names in order.
        box: control points along each axis.
        space: "LPS", "RAS" or "unknown".
        unit: of lengths.
        block: subjects in a block.
        chunk: subjects in a chunk of a block.
        prior: SHA-256 of the file of the prior of shape; empty without one.
    """

    subjects: int
    sha256: str
    frames: int
    surfaces: tuple[str, ...]
    box: tuple[int, int, int]
    space: str
    unit: str
    block: int
    chunk: int
    prior: str = ""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.subjects // self.block)

    def members(self, block: int) -> range:
        """Return the numbers of the subjects of a block."""
        return range(block * self.block, min((block + 1) * self.block, self.subjects))

    def blocks_of(self, part: int, parts: int) -> range:
        """Return the blocks of part 1, 2 ... of several, all of about the same size."""
        return range((part - 1) * self.blocks // parts, part * self.blocks // parts)


def ensure_layout(
    folder: Path, manifest: Manifest, space: str | None, parts: int, prior: PriorFile | None = None
) -> Layout:
    """Return the layout in the folder of the results, which is written where there is none; all processes get the same.

    Args:
        folder: exists.
        manifest: the subjects.
        space: to write in, or None for that of the first subject.
        parts: the number of processes, so that there is a block for each.
        prior: of all subjects, or None.

    Raises:
        InputError: no subject can be read, they are none of the population of the prior, or the folder has the results
            of other subjects, of another box or of another prior.
    """
    path, sha256 = folder / NAME, "" if prior is None else prior.sha256
    if not path.exists():
        planned = replace(_planned(manifest, space, parts), prior=sha256)
        if prior is not None:
            prior.check_layout(planned, space)
        create_bytes(path, _encoded(planned))
    found = read_layout(folder)
    if (found.subjects, found.sha256, found.box) != (manifest.subjects, manifest.sha256, manifest.box):
        raise InputError(
            f"{quoted(folder)}: contains the results of other subjects, or of another box; choose another folder"
        )
    if found.prior != sha256:
        raise InputError(
            f"{quoted(folder)}: contains the results {'of another prior' if found.prior else 'without a prior'}; "
            "choose another folder"
        )
    if space is not None and space != found.space:
        raise OptionError(f"option --space={space!r}: {quoted(folder)} contains results in {found.space}")
    return found


def _planned(manifest: Manifest, space: str | None, parts: int) -> Layout:
    first = next(_summaries(manifest), None)
    if first is None:
        raise InputError(f"{quoted(manifest.path)}: no subject has files that can be read; paths are relative to it")
    # the shape of the arrays is fixed before the first subject is fitted
    frames = max(each.frames for each in _summaries(manifest))
    block = max(1, min(LARGEST_BLOCK, -(-manifest.subjects // parts)))
    chunk = max(count for count in range(1, CHUNK + 1) if block % count == 0)  # Zarr: a shard has whole chunks
    return Layout(
        subjects=manifest.subjects,
        sha256=manifest.sha256,
        frames=frames,
        surfaces=first.surfaces,
        box=manifest.box,
        space=first.space if space is None else space,
        unit=first.unit,
        block=block,
        chunk=chunk,
    )


def _summaries(manifest: Manifest) -> Iterator[FileSummary]:
    """The summary of the files of each subject; those that cannot be read fail later, and are reported then."""
    for row in manifest.rows():
        try:
            yield inspect_files(row, manifest.folder)
        except (QuadriformError, OSError):
            continue


def _encoded(layout: Layout) -> bytes:
    document = {"format": FORMAT, "version": VERSION} | asdict(layout)
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def read_layout(folder: Path) -> Layout:
    """Return the layout of a folder of results.

    Raises:
        InputError, FileFormatError: there is none, or it is damaged.
    """
    path = folder / NAME
    root = Field(parse_json(read_bytes(path), quoted(path)), "", quoted(path))
    root.member("format").choice((FORMAT,))
    version = root.member("version").whole()
    if not 1 <= version <= VERSION:
        root.member("version").refuse(f"version 1 to {VERSION}")
    names = tuple(name for name in Layout.__dataclass_fields__ if version > 1 or name != "prior")
    root.only(("format", "version", *names))
    values: dict[str, Any] = {name: root.member(name).whole() for name in ("subjects", "frames", "block", "chunk")}
    values |= {name: root.member(name).text() for name in ("sha256", "space", "unit", "prior") if name in names}
    box = tuple(item.whole() for item in root.member("box").items())
    surfaces = tuple(item.text() for item in root.member("surfaces").items())
    if len(box) != 3 or not surfaces or min(values["subjects"], values["frames"], values["block"], values["chunk"]) < 1:
        root.refuse("counts above 0, three sides of a box and a surface")
    return Layout(surfaces=surfaces, box=(box[0], box[1], box[2]), **values)
