"""The pieces that pages are made of: tables, figures with their sources, pictures inside the page."""

import base64
import io
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from quadriform.report.page import rendered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> Markup:
    """Rows under a header, columns of numbers right-aligned. Without a header the first column names the rows."""
    cells = [[str(cell) for cell in row] for row in rows]
    numeric = [all(_is_number(row[k]) for row in cells) for k in range(len(cells[0]))] if cells else []
    return rendered("table.html.j2", header=header, rows=cells, numeric=numeric)


def _is_number(text: str) -> bool:
    return bool(re.fullmatch(r"[-+]?[\d.,]+(e[-+]?\d+)?( ?[%a-z]+(\^[23])?)?", text)) or not text


def figure(picture: Markup, caption: str) -> Markup:
    """A picture with the sentence under it, which names its source."""
    return Markup('<figure class="wide">{}<figcaption>{}</figcaption></figure>').format(picture, caption)


def svg(drawing: "Figure", words: str) -> Markup:
    """A drawing as SVG with its text alternative; the same bytes every time."""
    import matplotlib

    stream = io.StringIO()
    # text as text: it can be searched, and the ids are hashed with a fixed salt: the same bytes every time
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "quadriform"}):
        drawing.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    # inside a page an XML declaration and a document type are not allowed
    text = text[text.index("<svg") :].replace("<svg", Markup('<svg role="img" aria-label="{}"').format(words), 1)
    return Markup(text)


def png(drawing: "Figure", dpi: int) -> bytes:
    """The bytes of a drawing as pixels."""
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=dpi, facecolor="white")
    return stream.getvalue()


def image(data: bytes, words: str) -> Markup:
    """The bytes of a PNG inside the page."""
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(words, base64.b64encode(data).decode())


def tiles(named: Iterable[tuple[str, Markup]], size: str = "") -> Markup:
    """Pictures side by side, as many as fit, each under its title; `size` "small", or "charts" for wide ones."""
    each = [
        Markup('<div class="tile"><div class="tile-title">{}</div>{}</div>').format(title, picture)
        for title, picture in named
    ]
    return Markup('<div class="tiles{}">{}</div>').format(f" {size}" if size else "", Markup("").join(each))


def legend(entries: Iterable[tuple[str, str]]) -> Markup:
    """The legend of pictures, from (name, colour) of each."""
    items = [Markup('<li><span style="background:{}"></span>{}</li>').format(colour, name) for name, colour in entries]
    return Markup('<ul class="legend">{}</ul>').format(Markup("").join(items))
