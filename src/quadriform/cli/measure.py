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
    "Where the cavity ends: a share of the long axis from the apex (0.8); a fixed plane x,y,z,dx,dy,dz in the models' "
    "frame, its direction leading to the side cut off; a file of mitral points, or contours GPFile_NNN.txt that have "
    "them, for all frames, or one --base a frame. Without it the whole closed surface counts."
)
CONTOURS_HELP = (
    "Contours of the same frames, a folder of GPFile_NNN.txt or the files in order: each frame ends at the plane of "
    "its own mitral points, and the RV insertions are those at ED unless given."
)


def measure(
    models: Annotated[
        list[Path], typer.Argument(help="Models with surfaces endo and epi, frames in order, or one moving model.")
    ],
    base: Annotated[list[str] | None, typer.Option(help=BASE_HELP)] = None,
    contours: Annotated[list[Path] | None, typer.Option(help=CONTOURS_HELP)] = None,
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
    from quadriform.cli.screen import emit_json, emit_table, tell
    from quadriform.files.atomic import check_writable
    from quadriform.files.reading import naming, suffix_of
    from quadriform.heart.measure import measure as measure_heart
    from quadriform.heart.measures_table import TABLE_SUFFIXES, write_measures

    if output is not None:
        suffix_of(output, TABLE_SUFFIXES, "a table of measures")
        check_writable(output, force, inputs=models)
    models, contours = _told_apart(models, contours or [])
    frames, times = load_frames(models)
    planes, inserts = landmarks(base, contours, rv_insertion, frames)
    found = measure_heart(frames, times, base=planes, rv_inserts=inserts, ed=ed, observed=tracked)
    if strict:
        with naming(*models):
            refuse(found.warnings)
    tell(found.remarks)
    if output is not None:
        write_measures(found, output, force)
    if as_json:
        emit_json(found.record())
        return
    rows = [(row.quantity, f"{row.value:.4g}", row.unit, "" if row.observed else "not observed") for row in found.rows]
    rows.append(("status", found.status, "", ", ".join(found.warnings)))
    emit_table(rows, title=f"cavity: {found.rows[0].how}", header=("quantity", "value", "unit", ""))


def load_frames(files: list[Path]) -> tuple[list["DeformableModel"], "Array | None"]:
    """One model a file, in the order of the numbers in their names; or all frames of one moving model, with times."""
    from quadriform.cli.screen import say
    from quadriform.files import read_model
    from quadriform.files.frame_numbers import in_time, listed
    from quadriform.files.moving_models import is_moving_model, read_moving_model

    if len(files) == 1 and files[0].suffix.lower() == ".json" and is_moving_model(files[0]):
        moving = read_moving_model(files[0])
        return [moving.at(float(time)) for time in moving.frame_times], moving.frame_times
    ordered = in_time(files, by_hand=True)
    if ordered != files:
        say(f"note: the models are taken in the order of the numbers in their names: {listed(ordered)}")
    return [read_model(file) for file in ordered], None


def _told_apart(models: list[Path], contours: list[Path]) -> tuple[list[Path], list[Path]]:
    """Models and contours: of the files that a shell puts after --contours all but the first arrive as models."""
    from quadriform.files.guide_points import is_guide_points

    astray = [path for path in models if contours and is_guide_points(path)]
    return [path for path in models if path not in astray], contours + astray


def landmarks(
    base: list[str] | None, contours: list[Path], rv_insertion: list[str] | None, frames: list["DeformableModel"]
) -> "tuple[Base, list[Array] | list[list[float]] | None]":
    """Base and insertions as `measure` takes them, in the frame of the models.

    Raises:
        OptionError: base and contours at once.
    """
    from quadriform.cli.landmarks import coordinates, read_base, read_contours
    from quadriform.errors import OptionError

    if base and contours:
        raise OptionError("options --base and --contours exclude each other: contours bring a base of their own")

    marks = (frames[0].space, frames[0].unit)
    given = [coordinates(text, 3, "--rv-insertion") for text in rv_insertion or ()]
    if not contours:
        return read_base(base or (), marks), given or None
    planes, inserts = read_contours(contours, len(frames), marks)
    return planes, given or inserts
