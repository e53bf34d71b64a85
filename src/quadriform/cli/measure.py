"""`quadriform measure`: the clinical measures of a beating heart."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.options import Common, decimals, subcommand
from quadriform.cli.screen import note, print_remarks, show
from quadriform.errors import OptionError

if TYPE_CHECKING:
    from quadriform.heart.base import Base
    from quadriform.heart.measures_table import Measures
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel


@dataclass(frozen=True)
class LandmarkOptions:
    """Where the cavity ends, and where the right ventricle is inserted.

    Attributes:
        base: Where the cavity ends: a fraction of the long axis from the apex (0.8); a fixed plane x,y,z/dx,dy,dz in
            the models' frame, its direction leading to the side cut off; a file of mitral points, or contours
            GPFile_NNN.txt that have them, for all frames, or one --base a frame. Without it the base that is
            stored with each model; where there is none, the closed surface.
        contours: Contours of the same frames, a folder of GPFile_NNN.txt or the files in order: each frame ends at the
            plane of its own mitral points, and the RV insertions are those at ED unless given.
        rv_insertion: x,y,z where the right ventricle meets the left, at ED; two or more.
    """

    base: list[str] | None = None
    contours: list[Path] | None = None
    rv_insertion: list[str] | None = None


@subcommand
def measure(
    models: list[Path],
    *,
    where: LandmarkOptions,
    ed: int | None = None,
    tracked: bool = False,
    output: Path | None = None,
    common: Common,
) -> None:
    """Volumes, ejection fraction, mass, wall thickness, strain, twist and the 17 segments of a beating heart.

    Args:
        models: Models with surfaces endo and epi, frames in order, or one moving model.
        ed: Frame of end diastole, from 0; the largest volume unless given.
        tracked: The models follow material points: twist and strain are observed.
        output: Table as .csv, everything as .json.
    """
    from quadriform.cli.status import check_strict
    from quadriform.files.atomic import check_writable
    from quadriform.files.reading import suffix_of
    from quadriform.heart.measure import measure as measure_heart
    from quadriform.heart.measures_table import TABLE_SUFFIXES, write_measures

    if output is not None:
        suffix_of(output, TABLE_SUFFIXES, "a table of measures")
        check_writable(output, common.force, inputs=models)
    models, contours = _separated(models, where.contours or [])
    frames, times = load_frames(models)
    planes, inserts = landmarks(replace(where, contours=contours), frames)
    found = measure_heart(frames, times, base=planes, rv_inserts=inserts, ed=ed, observed=tracked)
    check_strict(common.strict, found.status, found.warnings, *models)
    print_remarks(found.remarks)
    if output is not None:
        write_measures(found, output, common.force)
    header = ("quantity", "value", "unit", "")
    show(found.record(), common.as_json, _rows(found), f"cavity: {found.rows[0].how}", header)


def _rows(found: "Measures") -> list[tuple[str, str, str, str]]:
    rows = [(row.quantity, row.number, row.unit, "" if row.observed else "not observed") for row in found.rows]
    return [*rows, ("status", found.status, "", ", ".join(found.warnings))]


def load_frames(files: list[Path]) -> tuple[list["DeformableModel"], "Array | None"]:
    """The models of files in the order of the numbers in their names, or the frames of a moving model with times."""
    from quadriform.files.frame_numbers import in_time, names_of
    from quadriform.files.models import read_any_model, read_model
    from quadriform.shapes.model import DeformableModel

    if len(files) == 1:
        model = read_any_model(files[0])
        if isinstance(model, DeformableModel):
            return [model], None
        return [model.at(float(time)) for time in model.frame_times], model.frame_times
    # shells sort frame_10 before frame_2
    ordered = in_time(files, by_hand=True)
    if ordered != files:
        note(f"the models are taken in the order of the numbers in their names: {names_of(ordered)}")
    return [read_model(file) for file in ordered], None


def _separated(models: list[Path], contours: list[Path]) -> tuple[list[Path], list[Path]]:
    """Models and contours; of the files that a shell puts after --contours all but the first arrive as models."""
    from quadriform.files.guide_points import is_guide_points

    misplaced = [path for path in models if contours and is_guide_points(path)]
    return [path for path in models if path not in misplaced], contours + misplaced


def landmarks(
    where: LandmarkOptions, frames: list["DeformableModel"]
) -> "tuple[Base, list[Array] | list[list[float]] | None]":
    """Base and insertions as `measure` takes them, in the frame of the models.

    Raises:
        OptionError: base and contours at once.
    """
    from quadriform.cli.measured_landmarks import read_base, read_contours

    if where.base and where.contours:
        raise OptionError("options --base and --contours exclude each other: contours contain a base")

    metadata = (frames[0].space, frames[0].unit)
    given = [decimals(text, "--rv-insertion", 3) for text in where.rv_insertion or ()]
    if not where.contours:
        return read_base(where.base or (), metadata), given or None
    planes, inserts = read_contours(where.contours, len(frames), metadata)
    return planes, given or inserts
