"""`quadriform report`: a model becomes one page that shows it."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli.measure import BASE_HELP, CONTOURS_HELP
from quadriform.cli.options import Force, Strict


def report(
    model: Annotated[Path, typer.Argument(help="A model or a moving model, .json or .npz.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The page.")] = Path("report.html"),
    base: Annotated[list[str] | None, typer.Option(help=BASE_HELP)] = None,
    contours: Annotated[list[Path] | None, typer.Option(help=CONTOURS_HELP)] = None,
    strict: Strict = False,
    force: Force = False,
) -> None:
    """Write one page of HTML that holds the model itself: turn it, play it, read off its numbers, without a network."""
    from quadriform.cli.inputs import refuse
    from quadriform.cli.measure import landmarks, load_frames
    from quadriform.cli.screen import say, tell
    from quadriform.cli.verdicts import verdict
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.models import read_model
    from quadriform.files.moving_models import is_moving_model, read_moving_model
    from quadriform.files.reading import naming, suffix_of
    from quadriform.heart.base import base_rule
    from quadriform.heart.base_planes import base_planes
    from quadriform.heart.heart_cycle import check_cycle
    from quadriform.heart.measure import measure
    from quadriform.report.reports import model_report
    from quadriform.shapes.record import remarks_of

    suffix_of(output, (".html",), "a page")
    check_writable(output, force, inputs=[model])
    frames, times = load_frames([model])
    measures = planes = None
    if base or contours or "endo" in frames[0].surfaces:
        where, inserts = landmarks(base, contours or [], None, frames)
        measures = measure(frames, times, base=where, rv_inserts=inserts)
        found = base_planes(check_cycle(frames, times), base_rule(where, len(frames)), {})
        planes = None if where is None else [(plane.point, plane.direction) for plane in found if plane is not None]
    if strict:
        with naming(model):
            refuse(frames[0].warnings if measures is None else measures.warnings)
    tell(remarks_of(frames[0].record) if measures is None else measures.remarks)
    moving = model.suffix.lower() == ".json" and is_moving_model(model)
    shown = read_moving_model(model) if moving else read_model(model)
    record = {"model": model.name, "input_sha256": shown.input_sha256} | verdict(shown.record)
    title = shown.record.title or model.stem
    page = model_report(shown, title=title, record=record, measures=measures, planes=planes)
    write_bytes(output, page, force)
    say(f"written: {output}")
