"""The whole page: all figures of the paper in their order, and one table of its numbers."""

from collections.abc import Callable
from pathlib import Path

from quadriform.fitting.outcome import Progress
from quadriform.report.page import Section, page
from quadriform.report.paper import fit_figures, image_figures, regularity_figures, shape_figures, surface_figures
from quadriform.report.paper.remake import HEADER, NONE, Remake
from quadriform.report.paper.results import Results, collect, count
from quadriform.report.paper.subjects import check_hearts
from quadriform.report.parts import table

FIGURES: tuple[Callable[[Results], Remake], ...] = (
    shape_figures.gallery,
    shape_figures.parametrisations,
    fit_figures.crossing_superquadrics,
    shape_figures.distances,
    shape_figures.free_form,
    fit_figures.synthetic_example,
    fit_figures.medical_example,
    fit_figures.displacement_fields,
    fit_figures.sparse_data,
    regularity_figures.four_boxes,
    regularity_figures.error_and_motion,
    regularity_figures.both_regularities,
    image_figures.first_images,
    image_figures.third_image,
    image_figures.first_overlay,
    image_figures.second_overlay,
    image_figures.segmentation,
    image_figures.third_overlay,
    surface_figures.first_surface,
    surface_figures.second_surface,
    surface_figures.third_surface,
    surface_figures.iterations,
    regularity_figures.outliers,
)
"""Fig. 1 to Fig. 22, and what has no figure."""
TITLE = "A Parametric Deformable Model to Fit Unstructured 3D Data, made again"
LEAD = (
    "E. Bardinet, L. D. Cohen, N. Ayache, Computer Vision and Image Understanding 71(1):39-54, 1998: each figure, by "
    'the method of the paper to the letter (method="paper") and by the default of quadriform. Pages are those of the '
    "paper; blue is the paper's method, green the default. {}"
)
HEARTS = "Hearts are real, but not the paper's, whose images are not public."
NO_HEARTS = (
    "No folder of real hearts was given: this page has synthetic data and a brain in their place, as each picture says."
)


def paper_page(folder: Path | None = None, progress: Progress | None = None) -> bytes:
    """Read, fit and draw everything.

    Args:
        folder: of real hearts, with the files `subjects.NEEDED` in it; None does without.
        progress: called with (pieces done, pieces in all): each set of data, then each figure.

    Returns:
        The page, in UTF-8.

    Raises:
        InputError, FileFormatError: a file of the folder is missing or damaged.
    """
    if folder is not None:
        check_hearts(folder)
    done, total = 0, count(folder) + len(FIGURES)

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    return drawn(collect(folder, step), step)


def drawn(results: Results, step: Callable[[], None]) -> bytes:
    """The page of given results; `step` is called after each figure."""
    remakes = []
    for draw in FIGURES:
        remakes.append(draw(results))
        step()
    lead = LEAD.format(HEARTS if results.real else NO_HEARTS)
    return page(TITLE, lead, [_summary(remakes), *(remake.section() for remake in remakes)])


def _summary(remakes: list[Remake]) -> Section:
    """All numbers that the paper gives, or claims in words, beside ours."""
    rows = [(remake.name, *row) for remake in remakes for row in remake.rows if row[1] != NONE]
    return Section("What the paper says in numbers", table(("", *HEADER), rows))
