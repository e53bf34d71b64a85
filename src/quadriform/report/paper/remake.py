"""One figure of the paper made again: what it shows, ours by both methods, and how they compare in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from quadriform.report.page import Section, rendered
from quadriform.report.parts import figure, table

HEADER = ("quantity", "the paper", 'method="paper"', "default")
NONE = "not given"
"""Where the paper gives no number."""
NOT = "-"
"""Where a quantity does not exist for a method."""
SAME = 0.02
"""Two errors whose ratio differs from 1 by less are called the same."""
SIMILAR = 0.01
"""Two surfaces are called similar when their RMS distance is at most this share of the length of the body."""

Row = tuple[str, ...]
"""What is measured, and its value in the paper, by the paper's method and by default."""


@dataclass(frozen=True)
class Remake:
    """A figure of the paper made again.

    Attributes:
        name: "Fig. 1".
        title: what it is about.
        page: of the paper, "p. 40".
        claim: what its caption and the text about it say.
        pictures: ours, each with its source.
        rows: quantities under `HEADER`.
        verdict: how the two methods and the paper compare; each sentence follows from numbers in it or in `rows`.
        more: further tables.
    """

    name: str
    title: str
    page: str
    claim: str
    pictures: Sequence[Markup]
    rows: Sequence[Row]
    verdict: str
    more: Sequence[Markup] = ()

    def section(self) -> Section:
        """The part of the page."""
        numbers = table(HEADER, self.rows) if self.rows else ""
        body = rendered(
            "paper_figure.html.j2",
            page=self.page,
            claim=self.claim,
            pictures=self.pictures,
            numbers=[numbers, *self.more],
            verdict=self.verdict,
        )
        return Section(f"{self.name}: {self.title}", body)


def shown(picture: Markup, what: str, source: str) -> Markup:
    """A picture, or several, with what it is and whose data it shows."""
    return figure(picture, f"{what} Source: {source}.")


def beside(one: float, other: float) -> str:
    """How one error compares with another, in words and per cent."""
    if one < (1 - SAME) * other:
        return f"{1 - one / other:.0%} smaller"
    return f"{one / other - 1:.0%} larger" if one > (1 + SAME) * other else f"the same within {SAME:.0%}"


def similar(distance: float, length: float) -> str:
    """Whether two surfaces whose RMS distance is given are similar, in words with the numbers."""
    word = "similar" if distance <= SIMILAR * length else "not similar"
    return f"{word} ({distance / length:.2%} of the length)"


def mm(length: float) -> str:
    """A length with three digits."""
    return f"{length:.3g} mm" if length < 1000 else f"{length:,.0f} mm"


def listed(values: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    return values[0] if len(values) == 1 else f"{', '.join(values[:-1])} and {values[-1]}"
