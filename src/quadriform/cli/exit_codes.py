"""Exit codes, and the one line on stderr that goes with them."""

import os
import sys
import tempfile
import traceback

from quadriform import __version__
from quadriform.errors import QuadriformError
from quadriform.words import plain

USAGE, NO_MEMORY, SOME_FAILED, INTERNAL, INTERRUPTED = 2, 6, 7, 70, 130


def complain(error: Exception, about: str = "") -> int:
    """Print one line about an error on stderr and return its exit code; an unforeseen one leaves a report file."""
    if isinstance(error, QuadriformError):
        return one_line(f"{about}{error}", error.exit_code)
    if isinstance(error, MemoryError):
        return one_line(f"{about}out of memory; try fewer points or a smaller region", NO_MEMORY)
    with tempfile.NamedTemporaryFile(
        "w", prefix="quadriform-report-", suffix=".txt", delete=False, encoding="utf-8"
    ) as report:
        report.write(f"quadriform {__version__}, Python {sys.version}, {os.name}\n{traceback.format_exc()}")
    line = f"{about}internal error, a fault of ours ({type(error).__name__}: {error}); report in {report.name!r}"
    return one_line(line, INTERNAL)


def one_line(text: str, code: int) -> int:
    """Print one line on stderr, without control characters, and return the code."""
    print("quadriform: " + plain(" ".join(text.split())), file=sys.stderr)
    return code
