"""Subcommands of `quadriform` in this process, and what they print."""

import contextlib
import io
import json
from typing import Any

from generalisation.rows import Strength, status_text


class CommandError(Exception):
    """A subcommand ended with another exit code than 0."""


def run(*arguments: object) -> dict[str, Any]:
    """The record that a subcommand prints with --json.

    Raises:
        CommandError: with the exit code and the last line on stderr.
    """
    from quadriform.cli.main import main

    printed, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        code = main([*map(str, arguments), "--json"])
    if code:
        raise CommandError(f"exit code {code}: {(errors.getvalue().strip().splitlines() or [''])[-1]}")
    return json.loads(printed.getvalue())


def strength_option(strength: Strength) -> list[str]:
    """The option of a strength; none for the default."""
    return [] if strength == "auto" else ["--strength", f"{strength:g}"]


def status_of(record: dict[str, Any]) -> str:
    """Level and warnings of a record."""
    return status_text(record["status"], record["warnings"])
