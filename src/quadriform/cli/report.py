"""`quadriform report`: a model becomes one page that shows it."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli.measure import BASE_HELP, CONTOURS_HELP
from quadriform.cli.options import Force


def report(
    model: Annotated[Path, typer.Argument(help="A model or a moving model, .json or .npz.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The page.")] = Path("report.html"),
    base: Annotated[list[str] | None, typer.Option(help=BASE_HELP)] = None,
    contours: Annotated[list[Path] | None, typer.Option(help=CONTOURS_HELP)] = None,
    force: Force = False,
) -> None:
    """Write one page of HTML that holds the model itself: turn it, play it, read off its numbers, without a network."""
    from quadriform.cli.measure import landmarks, load_frames
    from quadriform.cli.screen import say, warn
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.models import read_model
    from quadriform.files.moving_models import is_moving_model, read_moving_model
    from quadriform.files.reading import suffix_of
    from quadriform.heart.base import base_rule
    from quadriform.heart.frames import check_frames
    from quadriform.heart.measure import measure
    from quadriform.heart.planes import base_planes
    from quadriform.report.reports import model_report

    suffix_of(output, (".html",), "a page")
    check_writable(output, force, inputs=[model])
    frames, times = load_frames([model])
    measures = planes = None
    if base or contours or "endo" in frames[0].surfaces:
        where, inserts = landmarks(base, contours or [], None, frames)
        measures = measure(frames, times, base=where, rv_inserts=inserts)
        found = base_planes(check_frames(frames, times), base_rule(where, len(frames)), {})
        planes = None if where is None else [(plane.point, plane.direction) for plane in found if plane is not None]
        warn(measures.warnings)
    record = {"model": model.name, "input_sha256": frames[0].input_sha256}
    moving = model.suffix.lower() == ".json" and is_moving_model(model)
    shown = read_moving_model(model) if moving else read_model(model)
    page = model_report(shown, title=model.stem, record=record, measures=measures, planes=planes)
    write_bytes(output, page, force)
    say(f"written: {output}")
