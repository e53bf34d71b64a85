"""Priors of shape in a .npz: the same two arrays as a packed model, a text and all numbers, and as strictly read."""

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.arrays import parse_npz
from quadriform.files.atomic import write_bytes
from quadriform.files.metadata import SPACES, UNITS, check_space_and_unit
from quadriform.files.models import (
    box_document,
    box_fields,
    check_extent,
    parse_json,
    read_surfaces,
    read_version,
    surface_document,
)
from quadriform.files.packed import TEXT, VALUES, Unpacking, packed
from quadriform.files.reading import PathLike, quoted, read_bytes, suffix_of, suffix_to_read
from quadriform.files.strict import Field
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.prior import PriorReport, ShapePrior

PRIOR_SUFFIXES = (".npz",)
FORMAT, VERSION = "quadriform-prior", 1
ARRAYS: dict[str, tuple[int | None, ...]] = {
    "mean": (None, 3),
    "modes": (None, None, 3),
    "variances": (None,),
    "metric": (None, None),
}
COUNTS = ("modes_90", "modes_95", "modes_99")
REPORT = tuple(field.name for field in fields(PriorReport))


def write_prior(prior: ShapePrior, path: PathLike, force: bool = False) -> None:
    """Write a prior as .npz, all or nothing.

    Raises:
        FileFormatError: another suffix.
        OptionError: a frame or unit that the format does not know.
        OutputError: the target cannot be written; an existing file is unchanged.
    """
    suffix_of(path, PRIOR_SUFFIXES, "a prior")
    write_bytes(path, packed(_document(prior)), force)


def read_prior(path: PathLike) -> ShapePrior:
    """The prior of a file; its numbers are exactly those that were written.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: no prior, damaged, of a later version, or a field that is missing, unknown or wrong; the
            message has the path of the field.
        FileLimitError: beyond the budget.
    """
    suffix_to_read(path, PRIOR_SUFFIXES, "a prior")
    where = quoted(path)
    arrays = parse_npz(read_bytes(path), where)
    if arrays.keys() != {TEXT, VALUES}:
        raise FileFormatError(f"{where}: expected a prior, the arrays {TEXT} and {VALUES}, found {', '.join(arrays)}")
    text = parse_json(arrays[TEXT].tobytes(), where)
    prior = _prior(Field(Unpacking(arrays[VALUES], where).document(text), "", where))
    check_extent(prior.mean_model(), where)
    return prior


def is_prior_file(path: PathLike) -> bool:
    """Whether a .npz has the format of a prior; a damaged one is an error.

    Raises:
        InputError, FileFormatError, FileLimitError: as for `read_prior`.
    """
    arrays = parse_npz(read_bytes(path), quoted(path))
    if TEXT not in arrays:
        return False
    document = parse_json(arrays[TEXT].tobytes(), quoted(path))
    return isinstance(document, dict) and document.get("format") == FORMAT


def _document(prior: ShapePrior) -> dict[str, Any]:
    check_space_and_unit(prior.space, prior.unit)
    return {
        "format": FORMAT,
        "version": VERSION,
        "space": prior.space,
        "unit": prior.unit,
        "n_models": prior.n_models,
        "freedom": prior.freedom,
        "size": "any" if prior.any_size else "fixed",
        "report": asdict(prior.report),
        "surfaces": [surface_document(name, surface) for name, surface in prior.surfaces.items()],
        **box_document(prior.box),
        **{name: np.asarray(getattr(prior, name)).tolist() for name in ARRAYS},
    }


def _prior(root: Field) -> ShapePrior:
    read_version(root, FORMAT, VERSION)
    root.only(
        ("format", "version", "space", "unit", "n_models", "freedom", "size", "report", "surfaces", "box", *ARRAYS)
    )
    box, report = root.member("box"), root.member("report")
    report.only(REPORT)
    shown = {name: _of_the_report(report.member(name), name) for name in REPORT}
    return root.build(
        ShapePrior,
        surfaces=read_surfaces(root.member("surfaces")),
        box=box.build(ControlBox, **box_fields(box, axes=3)),
        freedom=root.member("freedom").number(),
        any_size=root.member("size").choice(("any", "fixed")) == "any",
        n_models=root.member("n_models").whole(),
        report=report.build(PriorReport, **shown),
        space=root.member("space").choice(SPACES),
        unit=root.member("unit").choice(UNITS),
        **{name: root.member(name).numbers(shape) for name, shape in ARRAYS.items()},
    )


def _of_the_report(field: Field, name: str) -> float:
    return field.whole() if name in COUNTS else field.number()
