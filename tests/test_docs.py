"""The site: it builds without a warning and without the network, and what its pages say is so."""

import json
import re
import runpy
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import quadriform as qf

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NOTEBOOK = DOCS / "entry_points.ipynb"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
FETCHED = ("src", "srcset", "href", "xlink:href", "data", "poster")
CSS_FETCH = re.compile(r"""(?:url\(|@import)\s*["']?\s*(?:https?:)?//""")


def relative(path):
    return str(path.relative_to(ROOT))


def cells():
    return json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


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


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("furo", reason="sphinx and furo (extra docs) are not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", folder / "trees"]
    done = subprocess.run([*command, DOCS, folder / "html"], capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.mark.slow
def test_the_site_has_every_page_and_every_public_name(site):
    for page in [*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")]:
        assert (site / page.relative_to(DOCS).with_suffix(".html")).is_file(), page
    text = (site / "api.html").read_text(encoding="utf-8")
    assert [name for name in qf.__all__ if not re.search(rf'id="(module-)?quadriform\.{name}"', text)] == []


@pytest.mark.slow
def test_the_site_asks_for_nothing_outside_itself(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 10
    assert {page.name: fetches(page.read_text(encoding="utf-8")) for page in pages} == {page.name: [] for page in pages}
    for sheet in site.rglob("*.css"):
        assert not CSS_FETCH.search(sheet.read_text(encoding="utf-8")), sheet


def test_the_search_for_fetches_finds_them():
    assert fetches('<link rel="stylesheet" href="https://x.org/a.css">') == ["https://x.org/a.css"]
    assert fetches('<script src="//x.org/a.js"></script>') == ["//x.org/a.js"]
    assert len(fetches("<style>@font-face { src: url('https://x.org/a.woff') }</style>")) == 1
    assert (
        fetches('<a href="https://x.org">x</a><img src="_images/a.png"><svg xmlns="http://www.w3.org/2000/svg"/>') == []
    )


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_links_lead_to_files_and_headings(page):
    """As plain code hosting follows them, without the site."""
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path, _, heading = target.partition("#")
        if re.match(r"https?:", target):
            continue
        file = page.parent / path if path else page
        assert file.is_file(), target
        assert not heading or heading in headings(file), target


def headings(page):
    """The anchors of a page."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title).strip().lower().replace(" ", "-") for title in titles}


def test_figures_of_how_to_choose_are_measured():
    """Each number with a decimal point stands in a table of measurements; strengths such as 1e-6 are no such."""
    measured = "".join((DOCS / name).read_text(encoding="utf-8") for name in ("benchmarks.md", "real_data.md"))
    said = re.findall(r"\b\d+\.\d+\b", re.sub(r"`[^`]*`", "", (DOCS / "choose.md").read_text(encoding="utf-8")))
    assert len(said) > 5
    assert [number for number in said if not re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", measured)] == []


@pytest.mark.slow
def test_the_line_of_the_readme_for_open3d_fits_its_vectors(tmp_path):
    """Vectors of Open3D are sequences of rows; those of normals have arbitrary signs."""
    body = qf.Superquadric(semi_axes=(40.0, 30.0, 20.0), exponents=(1.0, 1.0))
    points = body.mesh(8).vertices
    signs = np.where(np.arange(len(points)) % 2, 1, -1)[:, None]
    cloud = SimpleNamespace(points=list(points), normals=list(signs * points / body.semi_axes**2))
    (line,) = re.findall(r"^fit = qf.fit\(np.asarray\(pcd.*", (ROOT / "README.md").read_text(encoding="utf-8"), re.M)
    (tmp_path / "line.py").write_text(line, encoding="utf-8")
    names = runpy.run_path(str(tmp_path / "line.py"), {"qf": qf, "np": np, "pcd": cloud})
    assert names["fit"].volume().value == pytest.approx(body.volume(), rel=0.01)


@pytest.mark.slow
def test_points_to_a_model_finds_the_noise_and_the_truth(run):
    names = run("points_to_model.md")
    assert names["fit"].noise == pytest.approx(0.5, rel=0.1)
    assert names["miss"] < 0.25 and names["inside"].all()
    assert 0.5 < names["miss"] / np.sqrt(np.mean(names["sigma"] ** 2)) < 2


@pytest.mark.slow
def test_image_to_a_ventricle_finds_its_volumes(run):
    names = run("image_to_ventricle.md")
    for name in ("endo", "epi"):
        assert names["fit"].model.volume(name) == pytest.approx(names["truth"].volume(name), rel=0.02)
    mass = 1.05 * (names["truth"].volume("epi") - names["truth"].volume("endo")) / 1000
    assert names["table"]["myocardial mass"] == pytest.approx(mass, rel=0.03)
    assert "UNKNOWN_UNIT" not in names["table"].warnings


@pytest.mark.slow
def test_a_beating_heart_finds_its_ejection_fraction(run):
    names = run("beating_heart.md")
    assert names["table"]["ejection fraction"] == pytest.approx(names["exact"]["ejection fraction"], abs=2)
    assert names["between"].volume("endo") == pytest.approx(names["heart"].model(0.25).volume("endo"), rel=0.02)
    assert names["path"].shape == (25, 1, 3) and np.allclose(names["path"][0], names["path"][-1])


def test_the_notebook_keeps_no_outputs_and_ends_with_the_fit():
    code = [cell for cell in cells() if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    assert "".join(code[-1]["source"]) == "fit"


@pytest.mark.slow
def test_the_notebook_runs():
    nbclient = pytest.importorskip("nbclient", reason="nbclient and ipykernel (extra dev) are not installed")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in outputs) == 4
    assert not any(output.get("name") == "stderr" for output in outputs)
    saved = next(cell for cell in notebook.cells if "is_watertight" in cell.source)
    assert saved.outputs[-1].data["text/plain"] == "(True, True)"
