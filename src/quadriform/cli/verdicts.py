"""What subcommands that use a model repeat of its fit, and when `--strict` refuses it."""

from pathlib import Path
from typing import Any

from quadriform.cli.inputs import refuse
from quadriform.cli.screen import tell
from quadriform.files.reading import naming
from quadriform.shapes.record import ModelRecord, remarks_of


def repeat(record: ModelRecord, strict: bool, *files: Path) -> dict[str, Any]:
    """Show the warnings and notes of a model's fit again, on stderr.

    Args:
        record: of the model, or of several together.
        strict: whether warnings are refused.
        files: which the models were read from.

    Returns:
        The same as `verdict`.

    Raises:
        FitError: with `strict`, where there are warnings.
    """
    if strict:
        with naming(*files):
            refuse(record.warnings)
    tell(remarks_of(record))
    return verdict(record)


def verdict(record: ModelRecord) -> dict[str, Any]:
    """Status, warnings and notes as the fields of `--json`."""
    return {
        "status": record.status,
        "warnings": {str(kind): text for kind, text in record.warnings.items()},
        "notes": [remark.text for remark in remarks_of(record) if not remark.kind],
    }
