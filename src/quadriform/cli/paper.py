"""`quadriform paper`: the figures of the paper again, by its method and by the default, as one page."""

from pathlib import Path

from quadriform.cli.options import subcommand
from quadriform.cli.screen import print_line, progress_bar
from quadriform.words import numbers


@subcommand
def paper(
    *,
    output: Path,
    figure: list[str] | None = None,
    box: str = "5,5,5",
    data: Path | None = None,
    force: bool = False,
) -> None:
    """Make the figures of the paper again, by method="paper" and by default, with their errors side by side.

    Without --data the page has synthetic data and a brain instead of hearts.
    All figures take about two minutes of processor time.

    Args:
        output: The page, an .html file.
        figure: 1 to 22, kinds, space or outliers; several between commas, or the option repeated. [default: all]
        box: Control points of every model along each axis.
        data: Folder of real hearts: spect_mpi, pig_cine_mri, human_lv_guidepoints. [default: none]
    """
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.reading import suffix_of
    from quadriform.report.paper.whole import paper_page

    # before the work, which takes minutes
    suffix_of(output, (".html",), "a page")
    check_writable(output, force)
    names = [name.strip() for text in figure or () for name in text.split(",")]
    i, j, k = numbers(box, 3, "--box")
    with progress_bar("the paper") as progress:
        page = paper_page(data, progress, names, (i, j, k))
    write_bytes(output, page, force)
    print_line(f"written to {output}: {len(page) / 1e6:.1f} MB")
