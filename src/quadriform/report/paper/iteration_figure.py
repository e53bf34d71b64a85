"""Fig. 22: error and motion of the box in each iteration, to convergence."""

from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.report.paper import drawing
from quadriform.report.paper.convergence import LONGEST, STOP, WITHIN, Convergence
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, Remake, Row, beside, listed, mm, shown
from quadriform.report.parts import legend, tiles

QUANTITIES = {
    "error": "least-squares error RMS, mm",
    "box_motion": "motion of the box RMS, mm",
    "surface_motion": "stop test: motion of the surface RMS, mm",
}
COLOURS = (drawing.ORANGE, drawing.PINK, drawing.GREY, drawing.INK)
"""Colours of the sets of data, none of those of the two methods."""
LEAST = 1e-6
"""Motions in mm below this are not drawn."""


def iterations(material: Material) -> Remake:
    """Fig. 22."""
    found = material.convergence
    pictures = [(label, _curves(found, quantity, label)) for quantity, label in QUANTITIES.items()]
    label = "distance of the points to the model RMS, mm"
    pictures.append((f"{label}; dashed: default", _distances(found, label)))
    key = legend([(each.subject.name, colour) for each, colour in zip(found, COLOURS)])
    sources = "; ".join(dict.fromkeys(each.subject.source for each in found))
    return Remake(
        "22",
        _words(found),
        [shown("22", tiles(pictures, "charts") + key, sources)],
        [row for each in found for row in _rows(each)],
    )


def _curves(found: list[Convergence], quantity: str, label: str) -> Markup:
    def draw(axes: Any) -> None:
        """Draw a curve for each set of data."""
        for each, colour in zip(found, COLOURS):
            values = np.array([getattr(record, quantity) for record in each.long.history])
            shown_ = values > LEAST
            axes.plot(np.arange(1, len(values) + 1)[shown_], values[shown_], color=colour)
        axes.axvline(30, color=drawing.GREY, linestyle=":", linewidth=1)

    return drawing.chart(draw, label, "iteration (dotted: 30)", label.split(":")[-1].strip(), "log")


def _distances(found: list[Convergence], label: str) -> Markup:
    """Errors of the paper's method after some iterations, and of the default, in the same measure."""

    def draw(axes: Any) -> None:
        """Draw the error after each number of iterations, and that of the default method."""
        for each, colour in zip(found, COLOURS):
            axes.plot(each.steps, each.errors, "o-", color=colour, markersize=4)
            axes.axhline(each.subject.default.rms, color=colour, linestyle="--")
        # a logarithm has no place for iteration 0, the superquadric
        axes.set_xscale("symlog", linthresh=1)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(left=0)

    return drawing.chart(draw, label, "iteration", "distance RMS, mm", "log")


def _rows(each: Convergence) -> list[Row]:
    name, subject, default = each.subject.name, each.subject, mm(each.subject.default.rms)
    first, last, count = each.long.history[0], each.long.history[-1], each.long.iterations
    converged = f"not by {LONGEST}" if each.converged is None else str(each.converged)
    end = "at the stop test" if count < LONGEST else f"after {count} iterations, without the stop test being met"
    return [
        (f"distance RMS after {subject.paper.iterations} iterations, {name}", NONE, mm(subject.paper.rms), default),
        (f"distance RMS {end}, {name}", NONE, f"{mm(each.long.rms)} in {count}", default),
        (f"least-squares error, first and last, {name}", "curve", f"{mm(first.error)}, {mm(last.error)}", NOT),
        (f"motion of the box, first and last, {name}", "curve", f"{mm(first.box_motion)}, {mm(last.box_motion)}", NOT),
        (f"iterations until the error stays within {WITHIN:.0%} of its last value, {name}", "30", converged, NOT),
    ]


def _words(found: list[Convergence]) -> dict[str, object]:
    """Which sets need more than 30 iterations, and how errors in the same measure compare at the end."""
    enough = [each.converged is not None and each.converged <= each.subject.paper.iterations for each in found]
    compared = [
        f"{each.subject.name} {beside(each.subject.default.rms, each.long.rms)} ({mm(each.subject.default.rms)} "
        f"and {mm(each.long.rms)})"
        for each in found
    ]
    return {
        "stop": STOP,
        "longest": LONGEST,
        "enough": sum(enough),
        "sets": len(found),
        "converged": listed([f"{each.subject.name}: {each.converged or f'not by {LONGEST}'}" for each in found]),
        "compared": listed(compared),
    }
