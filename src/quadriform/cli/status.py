"""Status and warnings of the fits of models: what subcommands repeat of them, and what `--strict` refuses."""

from pathlib import Path
from typing import Any

from quadriform.cli.screen import print_remarks, texts
from quadriform.errors import FitError, Warnings
from quadriform.files.reading import naming
from quadriform.shapes.record import ModelRecord, remarks_of


def repeat_warnings(record: ModelRecord, strict: bool, *files: Path) -> dict[str, Any]:
    """The same as `status_fields`; the warnings and notes of a model's fit are shown again, on stderr.

    Args:
        record: of the model, or of several together.
        strict: whether warnings are refused.
        files: which the models were read from.

    Raises:
        FitError: with `strict`, where there are warnings.
    """
    check_strict(strict, record.warnings, *files)
    print_remarks(remarks_of(record))
    return status_fields(record)


def status_fields(record: ModelRecord) -> dict[str, Any]:
    """Status, warnings and notes as the fields of `--json`."""
    return {
        "status": record.status,
        "warnings": texts(record.warnings),
        "notes": [remark.text for remark in remarks_of(record) if not remark.kind],
    }


def check_strict(strict: bool, warnings: Warnings, *files: Path) -> None:
    """Refuse warnings where `--strict` is given.

    Raises:
        FitError: there are some; it names the files.
    """
    if strict and warnings:
        with naming(*files):
            raise FitError("refused for its warnings: " + "; ".join(f"{k}: {text}" for k, text in warnings.items()))
