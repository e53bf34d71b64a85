"""`quadriform paper`: the figures of the paper again, by its method and by the default, as one page."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli import options as shared


def paper(
    output: Annotated[Path, typer.Option("--output", "-o", help="The page, an .html file.")],
    data: Annotated[
        Path | None,
        typer.Option(help="Folder of real hearts: spect_mpi, pig_cine_mri, human_lv_guidepoints. [default: none]"),
    ] = None,
    force: shared.Force = False,
) -> None:
    """Make each figure of the paper again, by method="paper" and by default, with its numbers beside ours.

    Without --data the page has synthetic data and a brain in the place of hearts. Takes a few minutes.
    """
    from quadriform.cli.screen import progress_bar, say
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.report.paper.whole import paper_page

    check_writable(output, force)
    with progress_bar("the paper") as progress:
        page = paper_page(data, progress)
    write_bytes(output, page, force)
    say(f"written to {output}: {len(page) / 1e6:.1f} MB")
