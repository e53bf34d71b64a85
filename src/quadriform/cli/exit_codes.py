"""Exit codes, and the one line on stderr that goes with them."""

import os
import sys
import tempfile
import traceback

from quadriform import __version__
from quadriform.errors import QuadriformError
from quadriform.words import plain

USAGE, NO_MEMORY, SOME_FAILED, INTERNAL, INTERRUPTED = 2, 6, 7, 70, 130


def report_error(error: Exception) -> int:
    """The exit code of an error, after one line about it on stderr; an unforeseen error leaves a report file."""
    if isinstance(error, QuadriformError):
        return error_line(str(error), error.exit_code)
    if isinstance(error, MemoryError):
        return error_line("out of memory; try fewer points or a smaller region", NO_MEMORY)
    # a traceback is for developers, so it is written to a file
    with tempfile.NamedTemporaryFile(
        "w", prefix="quadriform-report-", suffix=".txt", delete=False, encoding="utf-8"
    ) as report:
        report.write(f"quadriform {__version__}, Python {sys.version}, {os.name}\n{traceback.format_exc()}")
    line = f"internal error, a fault of ours ({type(error).__name__}: {error}); report in {report.name!r}"
    return error_line(line, INTERNAL)


def error_line(text: str, code: int) -> int:
    """The code, after one line on stderr without control characters."""
    print("quadriform: " + plain(" ".join(text.split())), file=sys.stderr)
    return code
