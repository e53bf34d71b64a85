"""One figure of the paper made again: what it shows, ours by both methods, and where they differ."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from quadriform.report.page import Section, rendered
from quadriform.report.parts import figure, table

HEADER = ("figure of merit", "the paper", 'method="paper"', "default")
NONE = "not given"
"""What stands where the paper gives no number."""
NOT = "not asked"
"""What stands where a method has no say."""

Row = tuple[str, ...]
"""What is measured, and its value in the paper, by the paper's method and by default."""


@dataclass(frozen=True)
class Remake:
    """A figure of the paper made again.

    Attributes:
        name: "Fig. 1".
        title: what it is about.
        page: of the paper, "p. 40".
        claim: what the paper shows or claims, in our words.
        pictures: ours, each with its source.
        rows: of figures of merit.
        verdict: where the two methods and the paper differ.
    """

    name: str
    title: str
    page: str
    claim: str
    pictures: Sequence[Markup]
    rows: Sequence[Row]
    verdict: str

    def section(self) -> Section:
        """It as a part of the page."""
        numbers = table(HEADER, self.rows) if self.rows else ""
        body = rendered(
            "paper_figure.html.j2",
            page=self.page,
            claim=self.claim,
            pictures=self.pictures,
            numbers=numbers,
            verdict=self.verdict,
        )
        return Section(f"{self.name}: {self.title}", body)


def shown(picture: Markup, what: str, source: str) -> Markup:
    """A picture with what it is and whose data it shows."""
    return figure(picture, f"{what} Source: {source}.")


def beside(default: float, paper: float) -> str:
    """How an error by default compares with that by the paper's method, in words."""
    if default < 0.98 * paper:
        return f"{1 - default / paper:.0%} smaller"
    return f"{default / paper - 1:.0%} larger" if default > 1.02 * paper else "the same within 2 %"


def mm(length: float) -> str:
    """A length with three digits."""
    return f"{length:.3g} mm"
