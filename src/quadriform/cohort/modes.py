"""Mean and modes of a cohort, from a sample of subjects where it is large, and the scores of every subject."""

import io
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from quadriform.cohort.layout import Layout
from quadriform.cohort.principal_modes import ShapeModes, shape_modes
from quadriform.cohort.stores import models
from quadriform.files import save
from quadriform.files.atomic import make_folder, write_bytes
from quadriform.points import Array

FOLDER = "modes"
COUNT = 5
"""Number of modes that are written and shown."""
MAX_SHAPES = 500
"""Number of subjects, evenly from the list, whose modes are computed; more do not change the first modes."""
BATCH = 100


@dataclass(frozen=True)
class Modes:
    """Mean and modes as the page shows them.

    Attributes:
        found: mean shape, about the origin, one sigma of each mode, and explained fractions of the variance.
        displacements: (M, l+1, m+1, n+1, 3), of the mean's control points by one sigma of each mode.
        subjects: number of subjects from which they were computed.
    """

    found: ShapeModes
    displacements: Array
    subjects: int


def write_modes(results: Path, layout: Layout) -> Modes | None:
    """Write modes/mean.json, modes.npz and scores.parquet, and return the modes; None for fewer than three models.

    Raises:
        OutputError: they cannot be written.
    """
    even = np.linspace(0, layout.subjects - 1, min(MAX_SHAPES, layout.subjects)).astype(int).tolist()
    sample = [model for _, model in models(results, layout, even)]
    if len(sample) < 3:
        return None
    found = shape_modes(sample, min(COUNT, len(sample) - 1), layout.box)
    mean = found.mean
    ends = found.reconstruct(np.eye(len(found.deviations)))  # one standard deviation along each mode
    moved = np.array([end.box.control_points - mean.box.control_points for end in ends])
    arrays = io.BytesIO()
    ratios = found.variance_ratios
    np.savez(arrays, mean=mean.box.control_points, displacements=moved, deviations=found.deviations, shares=ratios)
    folder = make_folder(results / FOLDER)
    save(mean, folder / "mean.json", force=True)
    write_bytes(folder / "modes.npz", arrays.getvalue(), force=True)
    write_bytes(folder / "scores.parquet", _scores(found, results, layout), force=True)
    return Modes(found, moved, len(sample))


def _scores(found: ShapeModes, results: Path, layout: Layout) -> bytes:
    """A table with one row for each subject and mode; scores in standard deviations."""
    import pyarrow as pa
    from pyarrow import parquet

    every = models(results, layout, range(layout.subjects))
    stream = io.BytesIO()
    schema = pa.schema([("subject", pa.string()), ("mode", pa.int32()), ("score", pa.float64())])
    with parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        while part := list(islice(every, BATCH)):
            names, shapes = zip(*part)
            scores = found.scores(shapes)
            count = scores.shape[1]
            columns = [np.repeat(names, count), np.tile(np.arange(1, count + 1), len(names)), scores.ravel()]
            writer.write_table(pa.table([pa.array(c, f.type) for c, f in zip(columns, schema)], schema=schema))
    return stream.getvalue()
