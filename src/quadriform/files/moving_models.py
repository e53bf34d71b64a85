"""A moving model as a document of its own: the same fields, with knots in time and one box of control points a knot."""

import os
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.atomic import write_bytes
from quadriform.files.marks import SPACES, UNITS, check_marks
from quadriform.files.models import encode_json, parse_json, read_sha256, read_surfaces, surface_document
from quadriform.files.reading import quoted, read_bytes, suffix_of
from quadriform.files.strict import Field
from quadriform.points import Array
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.splines import TimeBasis

FORMAT = "quadriform-moving-model"
VERSION = 2
"""Since 2 the file has the times of its frames; before, they are those of the knots."""


def write_moving_model(model: MovingModel, path: str | os.PathLike[str], force: bool = False) -> None:
    """Write a moving model as .json, all or nothing.

    Raises:
        FileFormatError: another suffix.
        OptionError: a frame or unit that the format does not know.
        OutputError: the target cannot be written.
    """
    suffix_of(path, (".json",), "a moving model")
    check_marks(model.space, model.unit)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "space": model.space,
        "unit": model.unit,
        "input_sha256": model.input_sha256,
        "surfaces": [surface_document(name, surface) for name, surface in model.surfaces.items()],
        "time": {
            "knots": model.basis.knots.tolist(),
            "period": model.basis.period,
            "frames": model.frame_times.tolist(),
        },
        "box": {name: getattr(model, name).tolist() for name in ("origin", "edges", "control_points")},
    }
    write_bytes(path, encode_json(document), force)


def read_moving_model(path: str | os.PathLike[str]) -> MovingModel:
    """Read a moving model; its numbers are the very same that were written.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: no moving model, damaged, of a later version, or a field that is missing, unknown or wrong.
        FileLimitError: beyond the budget.
    """
    suffix_of(path, (".json",), "a moving model")
    where = quoted(path)
    root = Field(parse_json(read_bytes(path), where), "", where)
    root.member("format").choice((FORMAT,))
    version = root.member("version")
    if not 1 <= version.whole() <= VERSION:
        version.refuse(f"version 1 to {VERSION}; a later one needs a newer quadriform")
    root.only(("format", "version", "space", "unit", "input_sha256", "surfaces", "time", "box"))
    box, marks = root.member("box"), (root.member("space").choice(SPACES), root.member("unit").choice(UNITS))
    shapes = {"origin": (3,), "edges": (3, 3), "control_points": (None, None, None, None, 3)}
    values: dict[str, Any] = {name: box.member(name).numbers(shape) for name, shape in shapes.items()}
    box.only(tuple(shapes))
    surfaces, sha256 = read_surfaces(root.member("surfaces")), read_sha256(root)
    try:
        basis, frame_times = _times(root.member("time"), version.whole())
        return MovingModel(
            surfaces,
            values["origin"],
            values["edges"],
            basis,
            values["control_points"],
            *marks,
            sha256,
            frame_times,
        )
    except OptionError as error:
        raise FileFormatError(f"{where}: {error}") from error


def is_moving_model(path: str | os.PathLike[str]) -> bool:
    """Whether a .json says that it is a moving model; damaged files are errors.

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
