"""The record of a model as fields of its document: status, warnings, notes, title, sources, coverage."""

from collections.abc import Mapping
from typing import Any

from quadriform.errors import WarningKind, Warnings
from quadriform.files.strict import Field
from quadriform.shapes.record import SHA256, STATUSES, Estimate, InputFile, ModelRecord

FIELDS = ("status", "warnings", "notes", "title", "sources", "coverage", "supported", "extends_beyond", "estimates")
"""The last three are null where they are not known."""
SOURCE = ("name", "sha256", "surface", "frame", "note")
ESTIMATE = ("value", "unit", "supported", "sd")


def record_document(record: ModelRecord, surfaces: Mapping[str, object]) -> dict[str, Any]:
    """The fields of a document that hold a record, as far as it is about the surfaces that the model still has."""
    sources = [source for source in record.sources if not source.surface or source.surface in surfaces]
    return {
        "status": record.status,
        "warnings": {str(kind): text for kind, text in record.warnings.items()},
        "notes": list(record.notes),
        "title": record.title,
        "sources": [{key: getattr(source, key) for key in SOURCE} for source in sources],
        "coverage": _of(record.coverage, surfaces),
        "supported": _of(record.supported, surfaces),
        "extends_beyond": _of(record.extends_beyond, surfaces),
        "estimates": {n: {key: getattr(e, key) for key in ESTIMATE} for n, e in record.estimates.items()} or None,
    }


def _of(values: Mapping[str, float], surfaces: Mapping[str, object]) -> dict[str, float] | None:
    return {name: value for name, value in values.items() if name in surfaces} or None


def read_record(root: Field, surfaces: Mapping[str, object]) -> ModelRecord:
    """The record in a document.

    Args:
        root: the document.
        surfaces: by name, which the coverage is recorded of.

    Raises:
        FileFormatError: a field that is missing, unknown or wrong, or a status that the warnings contradict.
    """
    status, warnings = root.member("status"), _warnings(root.member("warnings"))
    if bool(warnings) != (status.choice(STATUSES) in ("warned", "unreliable")):
        status.refuse("a status other than ok or unknown exactly where there are warnings")
    return ModelRecord(
        status=status.text(),
        warnings=warnings,
        notes=tuple(note.line() for note in root.member("notes").items()),
        title=root.member("title").line(),
        sources=tuple(_source(item, surfaces) for item in root.member("sources").items()),
        coverage=_by_surface(root.optional("coverage"), surfaces, 1.0),
        supported=_by_surface(root.optional("supported"), surfaces, 1.0),
        extends_beyond=_by_surface(root.optional("extends_beyond"), surfaces, None),
        estimates={name: _estimate(item) for name, item in root.optional("estimates").members().items()},
    )


def _warnings(field: Field) -> Warnings:
    found: Warnings = {}
    for name, item in field.members().items():
        if name not in WarningKind.__members__:
            item.refuse("a kind of warning that this version knows; a later one needs a newer quadriform", repr(name))
        found[WarningKind(name)] = item.line()
    return found


def _source(field: Field, surfaces: Mapping[str, object]) -> InputFile:
    field.only(SOURCE)
    surface, frame = field.member("surface"), field.member("frame")
    if surface.text() and surface.text() not in surfaces:
        surface.refuse("the name of a surface of the model, or nothing")
    if frame.value is not None and frame.whole() < 0:
        frame.refuse("a number of a frame, from 0, or null")
    return InputFile(
        field.member("name").line(),
        field.member("sha256").matching(SHA256, "64 hexadecimal digits, or nothing"),
        surface.text(),
        frame.value,
        field.member("note").line(),
    )


def _by_surface(field: Field, surfaces: Mapping[str, object], most: float | None) -> dict[str, float]:
    """Numbers from 0, and up to `most` if given, by surface."""
    found = {}
    for name, item in field.members().items():
        if name not in surfaces:
            item.refuse("the name of a surface of the model", repr(name))
        found[name] = item.number()
        if found[name] < 0 or (most is not None and found[name] > most):
            item.refuse("a number of 0 or more" if most is None else f"a number from 0 to {most:g}")
    return found


def _estimate(field: Field) -> Estimate:
    field.only(ESTIMATE)
    optional = {key: field.optional(key) for key in ("supported", "sd")}
    numbers = {key: None if item.value is None else item.number() for key, item in optional.items()}
    return Estimate(field.member("value").number(), field.member("unit").line(), **numbers)
