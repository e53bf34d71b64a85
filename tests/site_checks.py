"""Checks of the site in out/docs, its tutorials and its notebook, which are run as a whole: `make docs`."""

import re
import runpy
from html.parser import HTMLParser
from pathlib import Path

import nbformat
import numpy as np
import pytest
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


@pytest.fixture
def run(capsys):
    """Runs the Python of a tutorial, sees that it prints what the page shows, and gives the names that it leaves."""

    def of_page(name):
        page = DOCS / "tutorials" / name
        names = runpy.run_path(str(DOCS / "make_figures.py"))["run"](page)
        shown = "".join(re.findall(r"^```text\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))
        assert_alike(capsys.readouterr().out, shown)
        return names

    return of_page


def assert_alike(printed, shown):
    """The same words, and numbers that a reader would call the same."""
    number = re.compile(r"-?\d+(?:\.\d+)?")
    assert number.sub("#", printed).split() == number.sub("#", shown).split()
    both = [[float(value) for value in number.findall(text)] for text in (printed, shown)]
    assert both[0] == pytest.approx(both[1], rel=0.1, abs=0.02)


def test_points_to_a_model_finds_the_noise_and_the_truth(run):
    names = run("points_to_model.md")
    assert names["fit"].noise == pytest.approx(0.5, rel=0.1)
    assert names["miss"] < 0.25 and names["inside"].all()
    assert 0.5 < names["miss"] / np.sqrt(np.mean(names["sigma"] ** 2)) < 2


def test_a_prior_of_a_cohort_finds_a_heart_from_three_planes(run):
    names = run("prior.md")
    errors = [
        np.abs(names["found"].model.distance(names["truth"].mesh(name).vertices, name)) for name in names["planes"]
    ]
    assert np.concatenate(errors).max() < 0.5 and names["found"].status != "unreliable"


def test_image_to_a_ventricle_finds_its_volumes(run):
    names = run("image_to_ventricle.md")
    for name in ("endo", "epi"):
        assert names["fit"].model.volume(name) == pytest.approx(names["truth"].volume(name), rel=0.02)
    mass = 1.05 * (names["truth"].volume("epi") - names["truth"].volume("endo")) / 1000
    assert names["table"]["myocardial mass"] == pytest.approx(mass, rel=0.03)
    assert "UNKNOWN_UNIT" not in names["table"].warnings


def test_a_beating_heart_finds_its_ejection_fraction(run):
    names = run("beating_heart.md")
    assert names["table"]["ejection fraction"] == pytest.approx(names["exact"]["ejection fraction"], abs=2)
    assert names["between"].volume("endo") == pytest.approx(names["heart"].model(0.25).volume("endo"), rel=0.02)
    assert names["path"].shape == (25, 1, 3) and np.allclose(names["path"][0], names["path"][-1])


def test_the_notebook_runs():
    notebook = nbformat.read(DOCS / "entry_points.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in outputs) == 4
    assert not any(output.get("name") == "stderr" for output in outputs)
    saved = next(cell for cell in notebook.cells if "is_watertight" in cell.source)
    assert saved.outputs[-1].data["text/plain"] == "(True, True)"
