"""`quadriform fit`: points, meshes, masks or grey images become models."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli.method_options import MethodChoice
from quadriform.cli.options import Columns, Common, ObjectInImage, Space, check_space, grouped, image_option


@dataclass(frozen=True)
class Reading(ObjectInImage):
    """How the inputs are read."""

    border: Annotated[str | None, image_option(help="Where the object is cut by the image border: close or open.")] = (
        None
    )
    columns: Columns = None
    unit: Annotated[
        str | None, typer.Option(help="Unit of the lengths of a file that names none: mm, m; of tables also cm, um ...")
    ] = None


@grouped
def fit(
    *,
    inputs: Annotated[list[Path] | None, typer.Argument(help="Points, meshes, images, or folders of them.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results. [default: INPUT-model]")
    ] = None,
    surface: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=FILE, or of the one label image NAME=label:1+2, NAME=label:SEGMENT or NAME=preset:acdc; give "
            "it once for each surface."
        ),
    ] = None,
    method: MethodChoice,
    reading: Reading,
    space: Space = None,
    common: Common,
) -> None:
    """Fit a model to each input: model.json, surface.ply, and a table of the results.

    Several inputs, or a folder, give one model each in OUT/NAME/; a broken one does not stop the others.
    """
    from quadriform.cli.fit_run import plan, run_all, run_one

    image = replace(reading.parse(reading.border), columns=reading.columns, unit=reading.unit)
    options = method.options()
    jobs, several = plan(inputs or [], surface or [], output, image, check_space(space))
    if several:
        raise typer.Exit(run_all(jobs, options, common))
    run_one(jobs[0], options, common)
