"""The entry point: the subcommands, and one line on stderr for each error."""

import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated, Any

import typer
from typer.main import get_command

from quadriform import __version__
from quadriform.cli import (
    cohort,
    compare,
    deform,
    demo,
    export,
    fit,
    info,
    measure,
    paper,
    prior,
    report,
    segment,
    track,
)
from quadriform.cli.exit_codes import INTERRUPTED, USAGE, error_line, report_error
from quadriform.errors import UNRELIABLE

# typer carries its own copy of click in some versions: its errors are found through a name that it does export.
UsageProblem: type[Exception] = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")

app = typer.Typer(
    name="quadriform",
    help="From points, meshes, masks or grey images to a compact model: a superquadric in a free-form control box.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (
    fit.fit,
    track.track,
    measure.measure,
    compare.compare,
    segment.segment,
    deform.deform,
    export.export,
    info.info,
    report.report,
    cohort.cohort,
    prior.prior,
    demo.demo,
    paper.paper,
):
    app.command()(command)


def _version(given: bool) -> None:
    if given:
        typer.echo(f"quadriform {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _with_level(argument: str) -> str:
    """`--strict` alone as the option with a value that typer knows; else the argument."""
    return f"--strict={UNRELIABLE}" if argument == "--strict" else argument


@cache
def _command() -> Callable[..., Any]:
    """The command with all its options, put together once for any number of calls."""
    return get_command(app)


def run() -> None:
    """Run the installed command, and leave the process with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a file name must not fail in a terminal that cannot show it
            stream.reconfigure(errors="backslashreplace")
    sys.exit(main(sys.argv[1:]))


def main(arguments: Sequence[str]) -> int:
    """The exit code of one subcommand, after running it.

    0 done, 2 usage, 3 quality refused, 4 bad input, 5 output cannot be written, 6 beyond a limit, 7 some
    subjects of a cohort failed, 70 internal error, 130 interrupted.
    """
    try:
        # not standalone: errors and exit codes are ours
        words = [*map(_with_level, arguments)] or ["--help"]
        result = _command()(words, prog_name="quadriform", standalone_mode=False)
        code = result if isinstance(result, int) else 0
        return error_line("interrupted", code) if code == INTERRUPTED else code  # typer catches the key itself
    except UsageProblem as problem:
        return error_line(f"{problem.format_message()} (see quadriform --help)", USAGE)  # type: ignore[attr-defined]
    except KeyboardInterrupt:
        return error_line("interrupted", INTERRUPTED)
    except Exception as error:
        return report_error(error)


if __name__ == "__main__":
    run()
