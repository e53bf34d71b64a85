"""One figure of the paper made again: what it shows, ours by both methods, and how they compare in numbers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from quadriform.fitting.result import Fit
from quadriform.report.page import Section, rendered, texts
from quadriform.report.parts import figure, table

FIGURES = "paper/figures.toml"
"""The texts of the page."""
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
        key: of its texts.
        words: for the gaps in its texts; each sentence follows from numbers among them or in `rows`.
        pictures: ours, each with its source.
        rows: quantities under `HEADER`.
        more: further tables.
    """

    key: str
    words: dict[str, object]
    pictures: Sequence[Markup]
    rows: Sequence[Row]
    more: Sequence[Markup] = ()

    @property
    def name(self) -> str:
        """As "Fig. 1"."""
        return text(self.key, "name")

    def section(self) -> Section:
        """The part of the page."""
        numbers = table(HEADER, self.rows) if self.rows else ""
        body = rendered(
            "paper/figure.html.j2",
            page=text(self.key, "page"),
            claim=text(self.key, "claim"),
            pictures=self.pictures,
            numbers=[numbers, *self.more],
            comparison=text(self.key, "comparison", **self.words),
        )
        return Section(f"{self.name}: {text(self.key, 'title', **self.words)}", body)


def text(key: str, part: str, /, **words: object) -> str:
    """One of the texts of a figure, its placeholders replaced; all may contain the limits SAME and SIMILAR."""
    every = texts(FIGURES)
    found = every[key] if part in every[key] else every[every[key]["like"]]
    return str(found[part].format(same=SAME, similar=SIMILAR, **words))


def shown(key: str, picture: Markup, source: str, /, **words: object) -> Markup:
    """A picture, or several, with the caption of a figure and whose data it shows."""
    return figure(picture, f"{text(key, 'caption', **words)} Source: {source}.")


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


def in_mm(name: str, lengths: Iterable[float], stated: str = NONE) -> Row:
    """A row of a length by the paper's method and by default, and what the paper states about it."""
    return name, stated, *map(mm, lengths)


def warnings(name: str, fits: Iterable[Fit]) -> Row:
    """A row of the kinds of the warnings of both fits; `name` is what they are fits of, where there are several."""
    return ", ".join(filter(None, ["warnings", name])), NONE, *(", ".join(fit.warnings) or "none" for fit in fits)


def listed(values: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    return values[0] if len(values) == 1 else f"{', '.join(values[:-1])} and {values[-1]}"
