"""A moving model as a document of its own: the same fields, with knots in time and one box of control points a knot."""

import os
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.atomic import write_bytes
from quadriform.files.models import (
    check_extent,
    encode_json,
    head_document,
    parse_json,
    read_metadata,
    read_surfaces,
    read_version,
)
from quadriform.files.reading import quoted, read_bytes, suffix_of, suffix_to_read
from quadriform.files.records import FIELDS, read_record
from quadriform.files.strict import Field
from quadriform.points import Array
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import ModelRecord
from quadriform.shapes.splines import TimeBasis

FORMAT = "quadriform-moving-model"
VERSION = 3
"""Since 2 the file has the times of its frames; before, they are those of the knots. Since 3 it has the record."""
BODY = ("format", "version", "space", "unit", "input_sha256", "surfaces", "time", "box")


def write_moving_model(model: MovingModel, path: str | os.PathLike[str], force: bool = False) -> None:
    """Write a moving model as .json, all or nothing.

    Raises:
        FileFormatError: another suffix.
        OptionError: a frame or unit that the format does not know.
        OutputError: the target cannot be written.
    """
    suffix_of(path, (".json",), "a moving model")
    knots, frames = model.basis.knots.tolist(), model.frame_times.tolist()
    document = head_document(FORMAT, VERSION, model) | {
        "time": {"knots": knots, "period": model.basis.period, "frames": frames},
        "box": {name: getattr(model, name).tolist() for name in ("origin", "edges", "control_points")},
    }
    write_bytes(path, encode_json(document), force)


def read_moving_model(path: str | os.PathLike[str]) -> MovingModel:
    """The moving model of a file; its parameters are exactly those that were written.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: no moving model, damaged, of a later version, or a field that is missing, unknown or wrong.
        FileLimitError: beyond the budget.
    """
    suffix_to_read(path, (".json",), "a moving model")
    where = quoted(path)
    root = Field(parse_json(read_bytes(path), where), "", where)
    version = read_version(root, FORMAT, VERSION)
    root.only(BODY if version < 3 else (*BODY, *FIELDS))
    box, (space, unit, sha256) = root.member("box"), read_metadata(root)
    shapes = {"origin": (3,), "edges": (3, 3), "control_points": (None, None, None, None, 3)}
    values: dict[str, Any] = {name: box.member(name).numbers(shape) for name, shape in shapes.items()}
    box.only(tuple(shapes))
    surfaces = read_surfaces(root.member("surfaces"))
    record = ModelRecord() if version < 3 else read_record(root, surfaces)
    try:
        basis, frame_times = _times(root.member("time"), version)
        about: dict[str, Any] = {
            "space": space,
            "unit": unit,
            "input_sha256": sha256,
            "frame_times": frame_times,
            "record": record,
        }
        model = MovingModel(surfaces=surfaces, basis=basis, **values, **about)
        # Between knots the splines stay near these states.
        for knot in basis.knots:
            check_extent(model.at(float(knot)), where)
        return model
    except OptionError as error:
        raise FileFormatError(f"{where}: {error}") from error


def is_moving_model(path: str | os.PathLike[str]) -> bool:
    """Whether a .json is a moving model by its fields; damaged files are errors.

    Raises:
        InputError, FileFormatError, FileLimitError: as for `read_moving_model`.
    """
    document = parse_json(read_bytes(path), quoted(path))
    return isinstance(document, dict) and document.get("format") == FORMAT


def _times(field: Field, version: int) -> tuple[TimeBasis, Array]:
    """The splines and the times of the frames; a file of version 1 has none of these."""
    field.only(("knots", "period") if version == 1 else ("knots", "period", "frames"))
    knots, period = field.member("knots").numbers((None,)), field.member("period")
    basis = TimeBasis(knots, None if period.value is None else period.number())
    if version == 1:
        return basis, np.empty(0)
    frames = field.member("frames")
    if not frames.items():
        frames.refuse("one or more times")
    return basis, frames.numbers((None,))
