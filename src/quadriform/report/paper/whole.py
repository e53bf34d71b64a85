"""The whole page: the figures of the paper in their order, and one table of its numbers."""

from collections.abc import Callable, Sequence
from pathlib import Path

from quadriform.errors import choose
from quadriform.fitting.options import check_box
from quadriform.fitting.result import Progress
from quadriform.report.page import Section, page, source
from quadriform.report.paper import (
    fit_figures,
    image_figures,
    iteration_figure,
    matching_figure,
    regularity_figures,
    shape_figures,
    space_figures,
    surface_figures,
)
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import HEADER, NONE, Remake, text
from quadriform.report.paper.scans import check_hearts
from quadriform.report.parts import table

FIGURES: dict[str, Callable[[Material], Remake]] = {
    "1": shape_figures.gallery,
    "kinds": shape_figures.other_kinds,
    "2": shape_figures.parametrisations,
    "3": fit_figures.crossing_superquadrics,
    "4": matching_figure.distances,
    "5": shape_figures.free_form,
    "6": lambda material: fit_figures.from_start_to_end("6", material.crossing),
    "7": lambda material: fit_figures.from_start_to_end("7", material.first.subject),
    "8": fit_figures.displacement_fields,
    "9": fit_figures.sparse_data,
    "space": space_figures.whole_space,
    "10": regularity_figures.four_boxes,
    "11": regularity_figures.error_and_motion,
    "12": regularity_figures.both_regularities,
    "13": lambda each: image_figures.images("13", {"64 x 64 x 64": each.first, "64 x 64 x 21": each.second}),
    "14": lambda material: image_figures.images("14", {"98 x 100 x 110": material.third}),
    "15": lambda material: image_figures.overlaid("15", material.first),
    "16": lambda material: image_figures.overlaid("16", material.second),
    "17": image_figures.segmentation,
    "18": lambda material: image_figures.overlaid("18", material.third),
    "19": lambda material: surface_figures.surface("19", ("6,000", "46"), material.first, 3),
    "20": lambda material: surface_figures.surface("20", ("1,000", "7.7"), material.second, 1),
    "21": surface_figures.third_surface,
    "22": iteration_figure.iterations,
    "outliers": regularity_figures.outliers,
}
"""The figures of the paper by number, and three things that it says without a figure."""


def paper_page(
    folder: Path | None = None,
    progress: Progress | None = None,
    figures: Sequence[str] = (),
    box: tuple[int, int, int] = (5, 5, 5),
) -> bytes:
    """Read, fit and draw what the figures need.

    Args:
        folder: of real hearts, with the files `scans.NEEDED` in it; None does without.
        progress: called with (figures done, figures in all).
        figures: names of `FIGURES`; none means all.
        box: control points of the models along each axis.

    Returns:
        The page, in UTF-8.

    Raises:
        OptionError: no such figure, or the box is out of its range.
        InputError, FileFormatError: a file of the folder is missing or damaged.
    """
    for name in figures:
        choose(name, tuple(FIGURES), "figure")
    if folder is not None:
        check_hearts(folder)
    chosen = [name for name in FIGURES if not figures or name in figures]
    return drawn(Material(folder, check_box(box)), chosen, progress)


def drawn(material: Material, figures: Sequence[str], progress: Progress | None = None) -> bytes:
    """The page of some figures."""
    remakes = []
    for done, name in enumerate(figures, 1):
        remakes.append(FIGURES[name](material))
        if progress is not None:
            progress(done, len(figures))
    hearts = text("page", "hearts" if material.real else "no_hearts")
    lead = text("page", "lead", box=" x ".join(map(str, material.box)), hearts=hearts)
    sections = [*_summary(remakes), *(remake.section() for remake in remakes)]
    return page(text("page", "title"), lead, sections, source("paper/paper.css"))


def _summary(remakes: list[Remake]) -> list[Section]:
    """All numbers that the paper gives, or claims in words, beside ours."""
    rows = [(f"{remake.name}: {row[0]}", *row[1:]) for remake in remakes for row in remake.rows if row[1] != NONE]
    return [Section("What the paper says in numbers", table(HEADER, rows))] if rows else []
