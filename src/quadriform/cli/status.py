"""Status and warnings of the fits of models: what subcommands repeat of them, and what `--strict` refuses."""

from pathlib import Path
from typing import Any

from quadriform import errors
from quadriform.cli.screen import print_remarks, texts
from quadriform.errors import Warnings
from quadriform.files.reading import named_in_errors
from quadriform.shapes.record import ModelRecord, remarks_of


def repeat_warnings(record: ModelRecord, strict: str | None, *files: Path) -> dict[str, Any]:
    """The same as `status_fields`; the warnings and notes of a model's fit are shown again, on stderr.

    Args:
        record: of the model, or of several together.
        strict: the mildest status that is refused, or None.
        files: which the models were read from.

    Raises:
        FitError: the status is refused.
    """
    check_strict(strict, record.status, record.warnings, *files)
    print_remarks(remarks_of(record))
    return status_fields(record)


def status_fields(record: ModelRecord) -> dict[str, Any]:
    """Status, warnings and notes as the fields of `--json`."""
    return {
        "status": record.status,
        "warnings": texts(record.warnings),
        "notes": [remark.text for remark in remarks_of(record) if not remark.kind],
    }


def check_strict(strict: str | None, status: str, warnings: Warnings, *files: Path) -> None:
    """Refuse a status as `--strict` says.

    Raises:
        FitError: it is refused; the message names the files.
    """
    with named_in_errors(*files):
        errors.check_strict(strict, status, warnings)
