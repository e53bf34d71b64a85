"""Options of `quadriform fit` that choose how the model is made, and what their words mean."""

from pathlib import Path
from typing import Annotated, Any

import typer

from quadriform.errors import OptionError
from quadriform.words import numbers

METHOD = "Method"
TANGENT = "Method tangent"
PAPER = "Method paper"

Kind = Annotated[
    str | None, typer.Option(help="ellipsoid, toroid, hyperboloid1 or hyperboloid2.", rich_help_panel=METHOD)
]
Method = Annotated[
    str | None,
    typer.Option(help="tangent, or paper: Bardinet, Cohen and Ayache 1998. [default: tangent]", rich_help_panel=METHOD),
]
Box = Annotated[
    str | None,
    typer.Option(
        help="Control points along each axis, or auto with --max-error. [default: 5,5,5]", rich_help_panel=METHOD
    ),
]
Regularity = Annotated[
    str | None,
    typer.Option(
        help="bending or springs; for paper svd (P7, the default), springs-paper (P9), springs (on displacements).",
        rich_help_panel=METHOD,
    ),
]
Strength = Annotated[
    str | None,
    typer.Option(
        help="How strongly the box is regularised: a number, or auto; for svd how many singular values, or their "
        "smallest fraction of the largest.",
        rich_help_panel=METHOD,
    ),
]
MaxError = Annotated[
    float | None, typer.Option(help="RMS distance that --box auto must reach.", rich_help_panel=TANGENT)
]
Robust = Annotated[
    bool | None,
    typer.Option(
        "--robust/--no-robust", help="Tell strangers from inliers. [default: robust]", rich_help_panel=TANGENT
    ),
]
Base = Annotated[
    str | None,
    typer.Option(
        help="Where the data ends on purpose: a point and the direction to the missing side, as x,y,z/nx,ny,nz, or a "
        "file with a loop of points along the edge, in the frame of the input.",
        rich_help_panel=TANGENT,
    ),
]
Matching = Annotated[str | None, typer.Option(help="data-to-model or model-to-data.", rich_help_panel=PAPER)]
Iterations = Annotated[int | None, typer.Option(help="At most so many. [default: 30]", rich_help_panel=PAPER)]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Stop when the surface moves by less than this fraction of the RMS radius of the points.",
        rich_help_panel=PAPER,
    ),
]


def method_options(*, box: str | None, strength: str | None, base: str | None, **others: Any) -> dict[str, Any]:
    """Arguments for `quadriform.fit` from the words that were given.

    Raises:
        OptionError, FileFormatError: a word that cannot be read, or a loop that cannot.
    """
    read = {"box": _box(box), "strength": _strength(strength), "base": _base(base)}
    return {name: value for name, value in (read | others).items() if value is not None}


def _box(text: str | None) -> tuple[int, ...] | str | None:
    return text if text is None or text == "auto" else numbers(text, 3, "--box")


def _strength(text: str | None) -> float | str | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return text


def _base(text: str | None) -> Any:
    """A plane (point, direction) from x,y,z/nx,ny,nz; anything that is not numbers is a file with a loop."""
    from quadriform.files import read_points

    if text is None:
        return None
    try:
        rows = tuple([float(number) for number in row.split(",")] for row in text.split("/"))
    except ValueError:
        return read_points(Path(text))
    if [len(row) for row in rows] != [3, 3]:
        raise OptionError(f"option --base={text!r}: expected x,y,z/nx,ny,nz, or a file of points")
    return rows
