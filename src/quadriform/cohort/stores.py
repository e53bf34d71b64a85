"""The results of all subjects in standard stores: parameters in Zarr, measures in Parquet.

Both have one part for each block of subjects, written once and by one process: a shard of every Zarr array, a file of
the table. The models, one file a subject, are the source of truth; all of this can be computed from them again.
"""

import io
import os
import tempfile
import threading
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from quadriform import __version__
from quadriform.cohort.layout import Layout
from quadriform.cohort.subject import Outcome, Parameters
from quadriform.errors import InputError, OutputError
from quadriform.files.atomic import make_folder, write_bytes
from quadriform.files.reading import quoted
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

if TYPE_CHECKING:
    import pyarrow
    import zarr

STORE, TABLE = "parameters.zarr", "metrics"
SUPERQUADRIC = ("a1", "a2", "a3", "e1", "e2", "phi", "theta", "psi", "tx", "ty", "tz")
AXES = ("x", "y", "z")
SIDES = ("s", "t", "u")
WARNINGS_LOCK = threading.Lock()
"""Filters of warnings are global: two threads that change them at once restore them in the wrong order."""


def require_library(library: str) -> None:
    """Check that a library of an extra is installed.

    Raises:
        InputError: it is not installed; the message has the command that does it.
    """
    from importlib.util import find_spec

    if find_spec(library) is None:
        extra = "cluster" if library in ("dask", "distributed") else "cohort"
        raise InputError(f"a cohort needs {library}; pip install 'quadriform[{extra}]'")


# --- parameters --------------------------------------------------------------------------------------------------


def make_store(results: Path, layout: Layout) -> None:
    """Create the empty store, unless it exists: under another name, then renamed, by one process of several.

    Raises:
        OutputError: it cannot be created.
    """
    target = results / STORE
    if target.exists():
        return
    try:
        with tempfile.TemporaryDirectory(prefix=".quadriform-", dir=results, ignore_cleanup_errors=True) as draft:
            _create(Path(draft) / STORE, layout)
            os.rename(Path(draft) / STORE, target)
    except OSError as error:
        if not target.exists():  # else another process was first
            raise OutputError(f"{quoted(target)}: cannot be created: {error.strerror}") from error


def _create(path: Path, layout: Layout) -> None:
    import zarr

    root = zarr.create_group(path, zarr_format=3)
    root.attrs.update({"software": f"quadriform {__version__}", "frame": layout.space, "units": layout.unit})
    _add_arrays(root, layout)
    for dim, names in (("surface", layout.surfaces), ("parameter", SUPERQUADRIC), ("axis", AXES), ("side", SIDES)):
        array = root.create_array(dim, shape=(len(names),), dtype="string", dimension_names=(dim,), compressors=None)
        array[:] = np.array(names, dtype=np.dtypes.StringDType())
    # consolidated metadata is not in Zarr 3's standard; xarray uses it
    with WARNINGS_LOCK, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(path)


def _add_arrays(root: "zarr.Group", layout: Layout) -> None:
    sizes = {"subject": layout.subjects, "frame": layout.frames, "surface": len(layout.surfaces)}
    sizes |= dict(zip("ijk", layout.box)) | {"parameter": len(SUPERQUADRIC), "axis": 3, "side": 3}
    length = {"units": layout.unit, "frame": layout.space}
    mixed = length | {"parameters": "a1 a2 a3 and tx ty tz in units, e1 e2 without, phi theta psi in radians"}
    for name, dims, attributes in (
        ("control_points", ("subject", "frame", "i", "j", "k", "axis"), length),
        ("superquadrics", ("subject", "frame", "surface", "parameter"), mixed),
        ("origin", ("subject", "frame", "axis"), length),
        ("edges", ("subject", "frame", "side", "axis"), length),
        ("time", ("subject", "frame"), {}),
        ("subject", ("subject",), {}),
    ):
        inner = tuple(sizes[dim] for dim in dims[1:])
        text = name == "subject"
        root.create_array(
            name,
            shape=(layout.subjects, *inner),
            dtype="string" if text else "float64",
            chunks=(layout.chunk, *inner),
            shards=(layout.block, *inner),  # a shard is a file: one for each block, so that blocks are written alone
            dimension_names=dims,
            fill_value="" if text else np.nan,
            attributes=dict(attributes),
        )


def write_parameters(results: Path, layout: Layout, block: int, outcomes: Sequence[Outcome]) -> None:
    """Write the shard of a block in every array; subjects without a result are NaN.

    Args:
        results: folder.
        layout: of the cohort.
        block: its number.
        outcomes: of all its subjects, in order.

    Raises:
        OutputError: the disk fails.
    """
    import zarr

    members = layout.members(block)
    where = slice(members.start, members.stop)
    try:
        root = zarr.open_group(results / STORE, mode="r+")
        root["subject"][where] = np.array([each.id for each in outcomes], dtype=np.dtypes.StringDType())  # type: ignore[index]
        for name in Parameters.__dataclass_fields__:
            array: Any = root[name]
            # subjects have different numbers of frames, and some have no result
            values = np.full((len(members), *array.shape[1:]), np.nan)
            for at, each in enumerate(outcomes):
                if each.parameters is not None:
                    own = getattr(each.parameters, name)
                    values[at, : len(own)] = own
            array[where] = values
    except OSError as error:
        raise OutputError(f"{quoted(results / STORE)}: writing failed: {error.strerror}") from error


def models(
    results: Path, layout: Layout, subjects: Iterable[int], frame: int = 0
) -> Iterator[tuple[str, DeformableModel]]:
    """Return ids and models of subjects from the store, in one frame each, without subjects that have no result.

    Args:
        results: folder.
        layout: of the cohort.
        subjects: their numbers, in order; subjects of one chunk are read together.
        frame: number of the frame.

    Raises:
        InputError: there is no store, or no such frame.
    """
    import zarr

    if not 0 <= frame < layout.frames:
        raise InputError(f"frame {frame}: expected 0 to {layout.frames - 1}")
    try:
        root = zarr.open_group(results / STORE, mode="r")
    except FileNotFoundError as error:
        raise InputError(f"{quoted(results / STORE)}: there is no such store") from error
    arrays: dict[str, Any] = {name: root[name] for name in ("origin", "edges", "control_points", "superquadrics")}
    names: Any = root["subject"]
    for chunk, numbers in groupby(subjects, key=lambda number: number // layout.chunk):
        where = slice(chunk * layout.chunk, (chunk + 1) * layout.chunk)
        ids, values = names[where], {name: array[where, frame] for name, array in arrays.items()}
        for at in (number - where.start for number in numbers):
            if np.isfinite(values["origin"][at]).all():
                box = ControlBox(*(values[name][at] for name in ("origin", "edges", "control_points")))
                surfaces = {name: _ellipsoid(row) for name, row in zip(layout.surfaces, values["superquadrics"][at])}
                yield str(ids[at]), DeformableModel(surfaces, box, layout.space, layout.unit)


def _ellipsoid(row: Array) -> Superquadric:
    return Superquadric("ellipsoid", row[:3]).with_parameters(row)


# --- measures ----------------------------------------------------------------------------------------------------


def part_name(block: int, suffix: str) -> str:
    """Return the file name of the part of a block."""
    return f"{block:06d}{suffix}"


def write_measures(results: Path, block: int, outcomes: Sequence[Outcome]) -> None:
    """Write the part of a block in the table, one number a row.

    Raises:
        OutputError: it cannot be written; an earlier part is unchanged.
    """
    from pyarrow import parquet

    stream = io.BytesIO()
    parquet.write_table(_table(outcomes), stream, compression="zstd")
    folder = make_folder(results / TABLE)
    write_bytes(folder / part_name(block, ".parquet"), stream.getvalue(), force=True)


def _table(outcomes: Sequence[Outcome]) -> "pyarrow.Table":
    import pyarrow as pa

    # few different texts: a dictionary is a hundredth of the size
    coded = pa.dictionary(pa.int32(), pa.string())
    columns = {"subject": pa.string(), "frame": pa.int32(), "quantity": coded, "value": pa.float64()}
    schema = pa.schema(columns | {"unit": coded, "text": coded})
    rows = [{"subject": each.id, **vars(measure)} for each in outcomes for measure in each.measures]
    return pa.Table.from_pylist(rows, schema)


def parts(results: Path) -> list[Path]:
    """Return the existing parts of the table, in order."""
    return sorted((results / TABLE).glob("*.parquet"))


def read_measures(part: Path) -> Iterator[dict[str, Any]]:
    """Return the rows of a part: subject, frame, quantity, value, unit and text (not in parts of older versions).

    Raises:
        InputError: the file is missing or damaged.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(part)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{quoted(part)}: cannot be read: {error}") from error
    yield from table.to_pylist()
