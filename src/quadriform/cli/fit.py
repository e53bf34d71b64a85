"""`quadriform fit`: points, meshes, masks or grey images become models."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli import method_options as how
from quadriform.cli import options as shared

Inputs = Annotated[list[Path] | None, typer.Argument(help="Points, meshes, images, or folders of them.")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results. [default: INPUT-model]")]
Surface = Annotated[
    list[str] | None,
    typer.Option(
        help="NAME=FILE, or of the one label image NAME=label:1+2, NAME=label:SEGMENT or NAME=preset:acdc; give it "
        "once for each surface."
    ),
]


def fit(
    inputs: Inputs = None,
    output: Output = None,
    surface: Surface = None,
    kind: how.Kind = None,
    method: how.Method = None,
    box: how.Box = None,
    regularity: how.Regularity = None,
    strength: how.Strength = None,
    max_error: how.MaxError = None,
    robust: how.Robust = None,
    base: how.Base = None,
    matching: how.Matching = None,
    iterations: how.Iterations = None,
    tolerance: how.Tolerance = None,
    label: shared.Label = None,
    threshold: shared.Threshold = None,
    region: shared.Region = None,
    seed: shared.Seed = None,
    closing: shared.Closing = None,
    fill_holes: shared.FillHoles = False,
    border: shared.Border = None,
    frame: shared.Frame = None,
    affine: shared.Affine = None,
    columns: shared.Columns = None,
    unit: shared.Unit = None,
    space: shared.Space = None,
    strict: shared.Strict = False,
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Fit a model to each input: model.json, surface.ply, and a table of what came out.

    Several inputs, or a folder, give one model each in OUT/NAME/; a broken one does not stop the others.
    """
    from quadriform.cli.fit_run import plan, run_all, run_one
    from quadriform.imaging.file_points import ImageOptions

    image = ImageOptions.parse(label, threshold, region, seed, closing, fill_holes, border, frame, affine)
    image = replace(image, columns=columns, unit=unit)
    given = how.method_options(
        kind=kind,
        method=method,
        box=box,
        regularity=regularity,
        strength=strength,
        max_error=max_error,
        robust=robust,
        base=base,
        matching=matching,
        iterations=iterations,
        tolerance=tolerance,
    )
    jobs, several = plan(inputs or [], surface or [], output, image, shared.check_space(space))
    if several:
        raise typer.Exit(run_all(jobs, given, strict, force, as_json))
    run_one(jobs[0], given, strict, force, as_json)
