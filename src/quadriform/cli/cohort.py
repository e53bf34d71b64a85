"""`quadriform cohort`: a list of subjects becomes models, one store of parameters and one table of measures."""

from pathlib import Path
from typing import Any

import typer

from quadriform.cli.engine_choice import EngineChoice
from quadriform.cli.exit_codes import SOME_FAILED
from quadriform.cli.options import Common, check_space, subcommand
from quadriform.errors import OptionError


@subcommand
def cohort(
    manifest: Path,
    *,
    output: Path,
    shard: str = "1/1",
    resume: bool = False,
    set_: list[str] | None = None,
    heart: list[str] | None = None,
    space: str | None = None,
    prior: Path | None = None,
    common: Common,
    show_ids: bool = False,
    engine: EngineChoice,
) -> None:
    """Fit or track many subjects: a model each, parameters.zarr, metrics/*.parquet, failures.csv, cohort.html.

    A subject that fails does not stop the others (exit code 7). INPUT and NAME=FILES of a row are files, patterns or a
    folder, relative to the list, ';' between several; surfaces of label images are NAME=label:1+2.

    Args:
        manifest: CSV: id, input, and where needed surface and options by name.
        output: Folder for the results.
        shard: Only part i of n, i from 1: the task of an array job; all may run at the same time.
        resume: Continue: results that exist and whose input has not changed are kept.
        heart: The left ventricle in label images: endo=label:1 for the cavity, for the wall epi=label:1+2, of all
            subjects whose row has none. Volumes and ejection fraction are those below the base of the labels.
        prior: Prior of shape, .npz, as written by quadriform prior: all subjects are members of its population
            in all frames; the table has the distance of each from the mean.
        set_: NAME=VALUE, an option of all subjects whose row has none, such as box=5,5,5.
        show_ids: Name subjects on the screen; else only their rows are shown.
    """
    from quadriform.cli.cohort_run import run_and_show
    from quadriform.cohort.run import Choices

    given = [*(set_ or []), *([f"heart={';'.join(heart)}"] if heart else [])]
    choices = Choices(_options(given), _shard(shard), resume, common.force, common.strict, check_space(space), prior)
    if run_and_show(manifest, output, choices, engine, show_ids, common.as_json):
        raise typer.Exit(SOME_FAILED)


def _options(texts: list[str]) -> dict[str, Any]:
    from quadriform.cohort.manifest import option

    found: dict[str, Any] = {}
    for text in texts:
        # only the first sign separates: a value may contain others
        name, equals, value = text.partition("=")
        if not equals or name in found:
            raise OptionError(f"option --set={text!r}: expected NAME=VALUE, each name once")
        found[name] = option(name, value)
    return found


def _shard(text: str) -> tuple[int, int]:
    part, _, parts = text.partition("/")
    if not (part.isdecimal() and parts.isdecimal()):
        raise OptionError(f"option --shard={text!r}: expected i/n, such as 1/100")
    return int(part), int(parts)
