"""`quadriform fit`: points, meshes, masks or grey images become models."""

from pathlib import Path
from typing import Annotated, Any

import typer

from quadriform.cli import options as shared
from quadriform.cli.options import numbers

METHOD = "Method"


def fit(
    inputs: Annotated[list[Path] | None, typer.Argument(help="Points, meshes, images, or folders of them.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results. [default: INPUT-model]")
    ] = None,
    surface: Annotated[
        list[str] | None,
        typer.Option(help="NAME=FILE, or NAME=LABEL of the one label image; give it once for each surface."),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(help="ellipsoid, toroid, hyperboloid1 or hyperboloid2.", rich_help_panel=METHOD),
    ] = None,
    box: Annotated[
        str | None, typer.Option(help="Control points along each axis, as 5,5,5.", rich_help_panel=METHOD)
    ] = None,
    method: Annotated[str | None, typer.Option(help="Such as paper.", rich_help_panel=METHOD)] = None,
    regularity: Annotated[
        str | None, typer.Option(help="springs, springs-paper or svd.", rich_help_panel=METHOD)
    ] = None,
    strength: Annotated[
        str | None, typer.Option(help="How strongly the box is held: a number, or auto.", rich_help_panel=METHOD)
    ] = None,
    matching: Annotated[
        str | None, typer.Option(help="data-to-model or model-to-data.", rich_help_panel=METHOD)
    ] = None,
    iterations: Annotated[int | None, typer.Option(help="At most so many.", rich_help_panel=METHOD)] = None,
    label: shared.Label = None,
    threshold: shared.Threshold = None,
    region: shared.Region = None,
    seed: shared.Seed = None,
    closing: shared.Closing = None,
    fill_holes: shared.FillHoles = False,
    border: shared.Border = None,
    frame: shared.Frame = None,
    strict: shared.Strict = False,
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Fit a model to each input: model.json, surface.ply, and a table of what came out.

    Several inputs, or a folder, give one model each in OUT/NAME/; a broken one does not stop the others.
    """
    from quadriform.cli.batch import plan, run_all, run_one
    from quadriform.cli.inputs import ImageOptions

    image = ImageOptions.parse(label, threshold, region, seed, closing, fill_holes, border, frame)
    chosen: dict[str, Any] = {
        "kind": kind,
        "box": None if box is None else numbers(box, 3, "--box"),
        "method": method,
        "regularity": regularity,
        "strength": _number_or_word(strength),
        "matching": matching,
        "iterations": iterations,
    }
    given = {name: value for name, value in chosen.items() if value is not None}
    jobs, several = plan(inputs or [], surface or [], output, image)
    if several:
        raise typer.Exit(run_all(jobs, given, strict, force, as_json))
    run_one(jobs[0], given, strict, force, as_json)


def _number_or_word(text: str | None) -> float | str | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return text
