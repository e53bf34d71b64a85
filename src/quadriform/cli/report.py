"""`quadriform report`: a model becomes one page that shows it."""

from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.measure import LandmarkOptions
from quadriform.cli.options import subcommand
from quadriform.cli.screen import print_line, print_remarks
from quadriform.shapes.record import remarks_of

if TYPE_CHECKING:
    from quadriform.heart.measures_table import Measures
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel


@subcommand
def report(
    model: Path,
    *,
    output: Path = Path("report.html"),
    where: LandmarkOptions,
    strict: str | None = None,
    force: bool = False,
) -> None:
    """Write one page of HTML that holds the model itself: rotate it, play it, read its values, without a network.

    Args:
        model: A model or a moving model, .json or .npz.
        output: The page.
    """
    from quadriform.cli.measure import load_frames
    from quadriform.cli.status import check_strict, status_fields
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.models import read_any_model
    from quadriform.files.reading import suffix_of
    from quadriform.report.reports import model_report

    suffix_of(output, (".html",), "a page")
    check_writable(output, force, inputs=[model])
    frames, times = load_frames([model])
    is_ventricle = where.base or where.contours or "endo" in frames[0].surfaces
    measures = _measures(frames, times, where) if is_ventricle else None
    judged = frames[0] if measures is None else measures
    check_strict(strict, judged.status, judged.warnings, model)
    print_remarks(remarks_of(frames[0].record) if measures is None else measures.remarks)
    # the frames above do not move; the page plays the moving model
    shown = read_any_model(model)
    record = {"model": model.name, "input_sha256": shown.input_sha256} | status_fields(shown.record)
    title = shown.record.title or model.stem
    page = model_report(shown, title=title, record=record, measures=measures)
    write_bytes(output, page, force)
    print_line(f"written: {output}")


def _measures(frames: "list[DeformableModel]", times: "Array | None", where: LandmarkOptions) -> "Measures":
    from quadriform.cli.measure import landmarks
    from quadriform.heart.measure import measure

    base, inserts = landmarks(where, frames)
    return measure(frames, times, base=base, rv_inserts=inserts)
