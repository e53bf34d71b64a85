"""Mean and modes of a whole cohort: from a sample of it where it is large, and the scores of every subject."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from quadriform.cohort.layout import Layout
from quadriform.cohort.stores import models
from quadriform.files import save
from quadriform.files.atomic import make_folder, write_bytes
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel

if TYPE_CHECKING:
    from quadriform.cohort.statistics import ShapeModes

FOLDER = "modes"
COUNT = 5
"""Modes that are written and shown."""
MOST_SHAPES = 500
"""Subjects that the modes are made of, evenly from the list; more would say the same of the first few modes."""
TOGETHER = 100


@dataclass(frozen=True)
class Modes:
    """What the page shows of them.

    Attributes:
        mean: the mean shape, about the origin.
        displacements: (M, l+1, m+1, n+1, 3), of its control points by one sigma of each mode.
        deviations: (M,) one sigma: RMS distance over the surface.
        shares: (M,) of the variance.
        subjects: how many they were made of.
    """

    mean: DeformableModel
    displacements: Array
    deviations: Array
    shares: Array
    subjects: int


def write_modes(results: Path, layout: Layout) -> Modes | None:
    """Write modes/mean.json, modes.npz and scores.parquet; None, and nothing written, with fewer than three models.

    Raises:
        OutputError: they cannot be written.
    """
    from quadriform.cohort.statistics import shape_modes

    even = np.linspace(0, layout.subjects - 1, min(MOST_SHAPES, layout.subjects)).astype(int).tolist()
    sample = [model for _, model in models(results, layout, even)]
    if len(sample) < 3:
        return None
    found = shape_modes(sample, min(COUNT, len(sample) - 1), layout.box)
    modes = _shown(found, len(sample))
    folder = make_folder(results / FOLDER)
    save(modes.mean, folder / "mean.json", force=True)
    write_bytes(folder / "modes.npz", _arrays(modes), force=True)
    write_bytes(folder / "scores.parquet", _scores(found, results, layout), force=True)
    return modes


def _shown(found: "ShapeModes", subjects: int) -> Modes:
    count = len(found.deviations)
    mean = found.mean
    ends = found.reconstruct(np.eye(count))
    moved = np.array([end.box.control_points - mean.box.control_points for end in ends])
    return Modes(mean, moved, found.deviations, found.shares, subjects)


def _arrays(modes: Modes) -> bytes:
    stream = io.BytesIO()
    np.savez(
        stream,
        mean=modes.mean.box.control_points,
        displacements=modes.displacements,
        deviations=modes.deviations,
        shares=modes.shares,
    )
    return stream.getvalue()


def _scores(found: "ShapeModes", results: Path, layout: Layout) -> bytes:
    """Subject, mode and score in sigmas, one a row."""
    import pyarrow as pa
    from pyarrow import parquet

    stream = io.BytesIO()
    schema = pa.schema([("subject", pa.string()), ("mode", pa.int32()), ("score", pa.float64())])
    with parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        for names, scores in _in_parts(found, results, layout):
            count = scores.shape[1]
            columns = [np.repeat(names, count), np.tile(np.arange(1, count + 1), len(names)), scores.ravel()]
            writer.write_table(pa.table([pa.array(c, f.type) for c, f in zip(columns, schema)], schema=schema))
    return stream.getvalue()


def _in_parts(found: "ShapeModes", results: Path, layout: Layout) -> Iterator[tuple[list[str], Array]]:
    every = models(results, layout, range(layout.subjects))
    while part := list(islice(every, TOGETHER)):
        yield [name for name, _ in part], found.scores([model for _, model in part])
