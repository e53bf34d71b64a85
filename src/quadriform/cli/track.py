"""`quadriform track`: the frames of a cycle become one moving model."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from quadriform.cli.options import Affine, Columns, Common, Space, check_space, decimals, grouped
from quadriform.errors import OptionError
from quadriform.words import numbers


@dataclass(frozen=True)
class Reading:
    """How the frames are read."""

    surface: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=label:VALUES of the label images, such as epi=label:1+2; give it once for each surface."
        ),
    ] = None
    columns: Columns = None
    affine: Affine = None


@dataclass(frozen=True)
class Motion:
    """How the moving model is fitted."""

    strategy: Annotated[
        str, typer.Option(help="cycle (all times at once), previous (from frame to frame), or alone.")
    ] = "cycle"
    times: Annotated[str | None, typer.Option(help="Times of the frames between commas. [default: 0, 1, 2 ...]")] = None
    period: Annotated[
        str, typer.Option(help="After which the motion repeats: a time, auto (the frames are one cycle), or none.")
    ] = "auto"
    shift_slices: Annotated[
        bool,
        typer.Option(
            "--shift-slices",
            help="Let each slice of contours or of an image stack move in its plane, once for the whole cycle. Of "
            "images the points between two slices are left out.",
        ),
    ] = False
    box: Annotated[str | None, typer.Option(help="Control points along each axis, as 5,5,5.")] = None
    strength: Annotated[
        float | None,
        typer.Option(help="How strongly the box is regularised in space; contours like 1e-6. [default: auto]"),
    ] = None

    def options(self) -> dict[str, Any]:
        """The arguments for `quadriform.track`, but for the slices.

        Raises:
            OptionError: an option that cannot be read.
        """
        given = {
            "times": None if self.times is None else decimals(self.times, "--times"),
            "box": None if self.box is None else numbers(self.box, 3, "--box"),
            "strength": self.strength,
        }
        given = {name: value for name, value in given.items() if value is not None}
        return {"strategy": self.strategy, "period": _period(self.period), **given}


@grouped
def track(
    *,
    frames: Annotated[
        list[Path],
        typer.Argument(
            help="One file a frame (points, meshes, images, contours GPFile_*.txt), a folder of them, or one 4-D "
            "image. Numbers in the names give the order in time; files without a common pattern are taken as given."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results. [default: INPUT-track]")
    ] = None,
    reading: Reading,
    motion: Motion,
    space: Space = None,
    common: Common,
) -> None:
    """Fit a moving model to the frames of a cycle: model.json, frames.csv, and a table of the results."""
    from quadriform.cli.track_run import run

    run(frames, output, reading, motion, check_space(space), common)


def _period(text: str) -> float | str | None:
    if text in ("auto", "none"):
        return "auto" if text == "auto" else None
    if not re.fullmatch(r"\d+(\.\d*)?([eE][+-]?\d+)?", text):
        raise OptionError(f"option --period={text!r}: expected a time above 0, auto or none")
    return float(text)
