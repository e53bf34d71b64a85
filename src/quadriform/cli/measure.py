"""`quadriform measure`: what a cardiologist reads off a beating heart."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadriform.cli.options import Force, Json, Strict

if TYPE_CHECKING:
    from quadriform.heart.base import Base
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel

BASE_HELP = (
    "Where the cavity ends: a share of the long axis from the apex (0.8); a fixed plane x,y,z,dx,dy,dz, its direction "
    "leading to the side cut off; a file of mitral points for all frames, or one --base a frame. Without it the whole "
    "closed surface counts."
)


def measure(
    models: Annotated[
        list[Path], typer.Argument(help="Models with surfaces endo and epi, frames in order, or one moving model.")
    ],
    base: Annotated[list[str] | None, typer.Option(help=BASE_HELP)] = None,
    rv_insertion: Annotated[
        list[str] | None, typer.Option(help="x,y,z where the right ventricle meets the left, at ED; two or more.")
    ] = None,
    ed: Annotated[
        int | None, typer.Option(help="Frame of end diastole, from 0; the largest volume unless given.")
    ] = None,
    tracked: Annotated[
        bool, typer.Option("--tracked", help="The models follow material points: twist and strain are observed.")
    ] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Table as .csv, everything as .json.")] = None,
    strict: Strict = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Volumes, ejection fraction, mass, wall thickness, strain, twist and the 17 segments of a beating heart."""
    from quadriform.cli.inputs import refuse
    from quadriform.cli.screen import emit_json, emit_table, warn
    from quadriform.files.atomic import check_writable
    from quadriform.files.reading import suffix_of
    from quadriform.heart.measure import measure as measure_heart
    from quadriform.heart.table import TABLE_SUFFIXES, write_measures

    if output is not None:
        suffix_of(output, TABLE_SUFFIXES, "a table of measures")
        check_writable(output, force, inputs=models)
    frames, times = load_frames(models)
    inserts = None if rv_insertion is None else [_coordinates(text, 3, "--rv-insertion") for text in rv_insertion]
    found = measure_heart(frames, times, base=_base(base), rv_inserts=inserts, ed=ed, observed=tracked)
    if strict:
        refuse(found.warnings)
    warn(found.warnings)
    if output is not None:
        write_measures(found, output, force)
    if as_json:
        emit_json(found.record())
        return
    rows = [(row.quantity, f"{row.value:.4g}", row.unit, "" if row.observed else "not observed") for row in found.rows]
    emit_table(rows, title=f"cavity: {found.rows[0].how}", header=("quantity", "value", "unit", ""))


def load_frames(files: list[Path]) -> tuple[list["DeformableModel"], "Array | None"]:
    """One model a file, in the order given; or all frames of one moving model, at its knots, with their times."""
    from quadriform.files import read_model
    from quadriform.files.moving_models import is_moving_model, read_moving_model

    if len(files) == 1 and files[0].suffix.lower() == ".json" and is_moving_model(files[0]):
        moving = read_moving_model(files[0])
        return [moving.at(float(time)) for time in moving.basis.knots], moving.basis.knots
    return [read_model(file) for file in files], None


def _base(words: list[str] | None) -> "Base":
    """What --base says, as `measure` takes it."""
    from quadriform.files import read_points

    if not words:
        return None
    if len(words) > 1:
        return [read_points(word) for word in words]
    try:
        return float(words[0])
    except ValueError:
        pass
    if words[0].count(",") == 5 and not Path(words[0]).exists():
        plane = _coordinates(words[0], 6, "--base")
        return plane[:3], plane[3:]
    return read_points(words[0])


def _coordinates(text: str, count: int, option: str) -> list[float]:
    from quadriform.errors import OptionError

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise OptionError(f"option {option}={text!r}: expected {count} numbers between commas")
    return values
