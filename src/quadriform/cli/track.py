"""`quadriform track`: the frames of a cycle become one moving model."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from quadriform.cli import options as shared

Frames = Annotated[
    list[Path],
    typer.Argument(
        help="One file a frame (points, meshes, images, contours GPFile_*.txt), a folder of them, or one 4-D image. "
        "Numbers in the names give the order in time; files without a common pattern are taken as given."
    ),
]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results. [default: INPUT-track]")]
Surface = Annotated[
    list[str] | None,
    typer.Option(help="NAME=label:VALUES of the label images, such as epi=label:1+2; give it once for each surface."),
]
Strategy = Annotated[str, typer.Option(help="cycle (all times at once), previous (from frame to frame), or alone.")]
Times = Annotated[str | None, typer.Option(help="Times of the frames between commas. [default: 0, 1, 2 ...]")]
Period = Annotated[
    str, typer.Option(help="After which the motion repeats: a time, auto (the frames are one cycle), or none.")
]
ShiftSlices = Annotated[
    bool,
    typer.Option(
        "--shift-slices",
        help="Let each slice of contours or of an image stack move in its plane, once for the whole cycle. Of images "
        "the points between two slices are left out.",
    ),
]


def track(
    frames: Frames,
    output: Output = None,
    surface: Surface = None,
    strategy: Strategy = "cycle",
    times: Times = None,
    period: Period = "auto",
    shift_slices: ShiftSlices = False,
    box: Annotated[str | None, typer.Option(help="Control points along each axis, as 5,5,5.")] = None,
    strength: Annotated[
        float | None, typer.Option(help="How strongly the box is held in space; contours like 1e-6. [default: auto]")
    ] = None,
    columns: shared.Columns = None,
    affine: shared.Affine = None,
    space: shared.Space = None,
    strict: shared.Strict = False,
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Fit a moving model to the frames of a cycle: model.json, frames.csv, and a table of what came out."""
    from quadriform.cli.track_run import follow
    from quadriform.words import numbers

    options: dict[str, Any] = {"strategy": strategy, "period": _period(period)}
    if times is not None:
        options["times"] = _times(times)
    if box is not None:
        options["box"] = numbers(box, 3, "--box")
    if strength is not None:
        options["strength"] = strength
    wanted = shared.check_space(space)
    follow(frames, surface or [], columns, affine, output, shift_slices, wanted, options, strict, force, as_json)


def _times(text: str) -> list[float]:
    from quadriform.errors import OptionError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise OptionError(f"option --times={text!r}: expected numbers between commas") from error


def _period(text: str) -> float | str | None:
    from quadriform.errors import OptionError

    if text in ("auto", "none"):
        return "auto" if text == "auto" else None
    if not re.fullmatch(r"\d+(\.\d*)?([eE][+-]?\d+)?", text):
        raise OptionError(f"option --period={text!r}: expected a time above 0, auto or none")
    return float(text)
