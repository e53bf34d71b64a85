"""Checks of the site in out/docs, and the notebook, run as a whole: `make docs`, for both take seconds."""

import re
from html.parser import HTMLParser
from pathlib import Path

import nbformat
from nbclient import NotebookClient

import quadriform as qf

ROOT = Path(__file__).resolve().parents[1]
DOCS, SITE = ROOT / "docs", ROOT / "out" / "docs"
FETCHED = ("src", "srcset", "href", "xlink:href", "data", "poster")
CSS_FETCH = re.compile(r"""(?:url\(|@import)\s*["']?\s*(?:https?:)?//""")


class Fetches(HTMLParser):
    """Addresses outside the site that a browser would ask for on its own: of all elements but links to follow."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if tag != "a" and name in FETCHED and re.match(r"\s*(?:https?:)?//", value or ""):
                self.found.append(value)
            if name == "style" and CSS_FETCH.search(value or ""):
                self.found.append(value)

    def handle_data(self, data):
        if self.get_starttag_text() and self.get_starttag_text().startswith("<style") and CSS_FETCH.search(data):
            self.found.append(data)


def fetches(html):
    parser = Fetches()
    parser.feed(html)
    return parser.found


def test_the_site_has_every_page_and_every_public_name():
    for page in [*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")]:
        assert (SITE / page.relative_to(DOCS).with_suffix(".html")).is_file(), page
    text = (SITE / "api.html").read_text(encoding="utf-8")
    assert [name for name in qf.__all__ if not re.search(rf'id="(module-)?quadriform\.{name}"', text)] == []


def test_the_site_asks_for_nothing_outside_itself():
    pages = sorted(SITE.rglob("*.html"))
    assert len(pages) > 10
    assert {page.name: fetches(page.read_text(encoding="utf-8")) for page in pages} == {page.name: [] for page in pages}
    for sheet in SITE.rglob("*.css"):
        assert not CSS_FETCH.search(sheet.read_text(encoding="utf-8")), sheet


def test_the_search_for_fetches_finds_them():
    assert fetches('<link rel="stylesheet" href="https://x.org/a.css">') == ["https://x.org/a.css"]
    assert fetches('<script src="//x.org/a.js"></script>') == ["//x.org/a.js"]
    assert len(fetches("<style>@font-face { src: url('https://x.org/a.woff') }</style>")) == 1
    assert (
        fetches('<a href="https://x.org">x</a><img src="_images/a.png"><svg xmlns="http://www.w3.org/2000/svg"/>') == []
    )


def test_the_notebook_runs():
    notebook = nbformat.read(DOCS / "entry_points.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in outputs) == 4
    assert not any(output.get("name") == "stderr" for output in outputs)
    saved = next(cell for cell in notebook.cells if "is_watertight" in cell.source)
    assert saved.outputs[-1].data["text/plain"] == "(True, True)"
