"""`quadriform fit`: points, meshes, masks or grey images become models."""

from dataclasses import dataclass, replace
from pathlib import Path

import typer

from quadriform.cli.heart_options import HeartChoice
from quadriform.cli.method_options import MethodChoice
from quadriform.cli.options import Common, ObjectInImage, check_space, subcommand


@dataclass(frozen=True)
class InputReading(ObjectInImage):
    """How the inputs are read.

    Attributes:
        unit: Unit of the lengths of a file that names none: mm, m; of tables also cm, um ...

    Images:
        border: Where the object is cut by the image border: close or open. [default: close labels and masks]
    """

    border: str | None = None
    columns: str | None = None
    unit: str | None = None


@subcommand
def fit(
    inputs: list[Path] | None = None,
    *,
    output: Path | None = None,
    surface: list[str] | None = None,
    hearts: HeartChoice,
    method: MethodChoice,
    reading: InputReading,
    space: str | None = None,
    common: Common,
) -> None:
    """Fit a model to each input: model.json, surface.ply, and a table of the results.

    Several inputs, or a folder, give one model each in OUT/NAME/; a broken one does not stop the others.

    Args:
        inputs: Points, meshes, images, or folders of them.
        output: Folder for the results. [default: INPUT-model]
        surface: NAME=FILE, or of the one label image NAME=label:1+2, NAME=label:SEGMENT or NAME=preset:acdc; give it
            once for each surface.
    """
    from quadriform.cli.fit_run import plan, run_all, run_one

    read_options = replace(reading.parse(reading.border), columns=reading.columns, unit=reading.unit)
    options = method.options()
    heart = hearts.parse(inputs or [], surface or [], read_options, options.get("base"))
    jobs, several = plan(inputs or [], surface or [], output, read_options, check_space(space))
    if heart is not None:
        jobs = [job.of_heart(heart) for job in jobs]
    if several:
        raise typer.Exit(run_all(jobs, options, common))
    run_one(jobs[0], options, common)
