"""Options of `quadriform fit` that choose how the model is fitted, and how they are read."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from quadriform.cli.options import decimals
from quadriform.errors import OptionError
from quadriform.words import numbers

method_option = partial(typer.Option, rich_help_panel="Method")
tangent_option = partial(typer.Option, rich_help_panel="Method tangent")
paper_option = partial(typer.Option, rich_help_panel="Method paper")


@dataclass(frozen=True)
class MethodChoice:
    """Which model is fitted, and how."""

    kind: Annotated[str | None, method_option(help="ellipsoid, toroid, hyperboloid1 or hyperboloid2.")] = None
    method: Annotated[
        str | None, method_option(help="tangent, or paper: Bardinet, Cohen and Ayache 1998. [default: tangent]")
    ] = None
    box: Annotated[
        str | None, method_option(help="Control points along each axis, or auto with --max-error. [default: 5,5,5]")
    ] = None
    regularity: Annotated[
        str | None,
        method_option(
            help="bending or springs; for paper svd (P7, the default), springs-paper (P9), springs (on displacements)."
        ),
    ] = None
    strength: Annotated[
        str | None,
        method_option(
            help="How strongly the box is regularised: a number, or auto; for svd how many singular values, or their "
            "smallest fraction of the largest."
        ),
    ] = None
    max_error: Annotated[float | None, tangent_option(help="RMS distance that --box auto must reach.")] = None
    robust: Annotated[
        bool | None,
        tangent_option("--robust/--no-robust", help="Detect outliers and down-weight them. [default: robust]"),
    ] = None
    base: Annotated[
        str | None,
        tangent_option(
            help="Where the data ends on purpose: a point and the direction to the missing side, as x,y,z/nx,ny,nz, or "
            "a file with a loop of points along the edge, in the frame of the input."
        ),
    ] = None
    matching: Annotated[str | None, paper_option(help="data-to-model or model-to-data.")] = None
    iterations: Annotated[int | None, paper_option(help="At most so many. [default: 30]")] = None
    tolerance: Annotated[
        float | None,
        paper_option(help="Stop when the surface moves by less than this fraction of the RMS radius of the points."),
    ] = None

    def options(self) -> dict[str, Any]:
        """The arguments for `quadriform.fit` that were given.

        Raises:
            OptionError, FileFormatError: an option that cannot be read, or a loop that cannot.
        """
        read = {"box": _box(self.box), "strength": _strength(self.strength), "base": _base(self.base)}
        return {name: value for name, value in (asdict(self) | read).items() if value is not None}


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
        rows = tuple(decimals(row, "--base") for row in text.split("/"))
    except OptionError:
        return read_points(Path(text))
    if [len(row) for row in rows] != [3, 3]:
        raise OptionError(f"option --base={text!r}: expected x,y,z/nx,ny,nz, or a file of points")
    return rows
