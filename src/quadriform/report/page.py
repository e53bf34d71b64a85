"""Self-contained pages of HTML: no network, no other file, no third-party script."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        title: its heading.
        body: HTML; texts in it are escaped by who made it.
    """

    title: str
    body: Markup


@cache
def _templates() -> Environment:
    # strict: a name that a template misspells is an error, not an empty place on a page
    return Environment(
        loader=PackageLoader("quadriform.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


def rendered(template: str, **values: object) -> Markup:
    """A template of this package with its values, every text in them escaped."""
    return Markup(_templates().get_template(template).render(values))


def source(name: str) -> Markup:
    """A style or a script of this package as it stands."""
    return Markup(files("quadriform.report").joinpath("templates", name).read_text("utf-8"))


@cache
def texts(table: str) -> dict[str, dict[str, Any]]:
    """A file of texts of this package by their sections, with placeholders in braces."""
    # plain text, not Markup: pages escape it
    return tomllib.loads(str(source(table)))


def report_text(section: str, name: str, /, **words: object) -> str:
    """One of the texts of reports, its placeholders replaced."""
    return str(texts("reports.toml")[section][name].format(**words))


def page(title: str, lead: str, sections: Sequence[Section], more_style: str = "") -> bytes:
    """A whole page.

    Args:
        title: of the page, plain text.
        lead: a sentence under it, plain text.
        sections: its parts; the page begins with links to them.
        more_style: CSS of its parts.

    Returns:
        UTF-8. A policy in the page forbids every request that would leave it.
    """
    style = source("page.css") + Markup(more_style)
    page = rendered("page.html.j2", title=title, lead=lead, sections=sections, style=style)
    return page.encode("utf-8", "backslashreplace")  # file names need not be UTF-8
