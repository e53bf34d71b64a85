"""The documents: what their pages say is so; `make docs` runs site_checks.py and gallery_checks.py besides."""

import ast
import json
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import nibabel
import numpy as np
import pytest
from typer.main import get_command

import quadriform as qf
from quadriform.cli.main import app

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NOTEBOOK = DOCS / "entry_points.ipynb"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def relative(path):
    return str(path.relative_to(ROOT))


def cells():
    return json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_links_lead_to_files_and_headings(page):
    """As plain code hosting follows them, without the site."""
    text = page.read_text(encoding="utf-8")
    for target in [*re.findall(r"\]\(([^)\s]+)\)", text), *re.findall(r'<img src="([^"]+)"', text)]:
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


def test_figures_of_the_limits_are_measured():
    """Each number with a decimal point stands in a table of measurements."""
    pages = (ROOT / "BENCHMARK.md", DOCS / "benchmarks.md")
    measured = [line for page in pages for line in page.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    limits = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Limits")[2].partition("\n## ")[0]
    stated = re.findall(r"\b\d+\.\d+\b", limits)
    assert len(stated) > 5
    assert [number for number in stated if not re.search(rf"(?<![\d.]){number}(?!\d)", "\n".join(measured))] == []


def test_the_readme_has_its_parts_in_the_order_in_which_a_reader_needs_them():
    titles = re.findall(r"^## (.+)$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    order = ["Installation", "First example", "Command line", "Limits"]
    assert [title for title in titles if title in order] == order


COMMANDS = [
    (page.name, line.partition("  ")[0])
    for page in (ROOT / "README.md", DOCS / "command_line.md")
    for block in re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for line in re.findall(r"^quadriform .*", block, re.MULTILINE)
]


@pytest.mark.parametrize(("page", "line"), COMMANDS)
def test_commands_have_subcommands_and_options_that_are(page, line):
    _, name, *words = line.split()
    known = {option for each in get_command(app).commands[name].params for option in each.opts}
    assert {word for word in words if re.match("--?[a-z]", word)} <= known


def python_blocks():
    return re.findall(
        r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def test_the_examples_of_the_readme_run(tmp_path, monkeypatch, capsys):
    """On ellipsoids: what they print and make is that of the ellipsoid."""
    body = qf.Superquadric(semi_axes=(40.0, 30.0, 20.0), exponents=(1.0, 1.0))
    points, inner = body.mesh(6).vertices, 0.8 * body.mesh(6).vertices
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(qf, "show", lambda fit: None)
    monkeypatch.setattr(qf.examples, "ventricle", lambda: points)
    grid = np.stack(np.meshgrid(*[np.arange(-45, 46, 4.5)] * 3, indexing="ij"), axis=-1)
    mask = body.implicit(grid.reshape(-1, 3)).reshape(grid.shape[:3]) < 1
    nibabel.save(nibabel.Nifti1Image(mask.astype(np.uint8), np.diag([4.5, 4.5, 4.5, 1.0])), tmp_path / "mask.nii.gz")
    names = {
        "np": np,
        "pcd": SimpleNamespace(points=list(points), normals=list(points / body.semi_axes**2)),
        "inner_points": inner,
        "outer_points": points,
        "scan": points + np.array([0.0, 0.0, 200.0]),
        "point": (0.0, 0.0, 221.0),
        "normal": (0.0, 0.0, -1.0),
        "points_in_wall": 0.9 * points,
        "frames": [{"endo": scale * inner, "epi": scale * points} for scale in (1.0, 0.9)],
    }
    for number, block in enumerate(python_blocks()):
        (tmp_path / f"block{number}.py").write_text(block, encoding="utf-8")
        names |= runpy.run_path(str(tmp_path / f"block{number}.py"), names)
    printed = capsys.readouterr().out.split("\n")
    assert printed[0] == "ok {}" and float(printed[3]) == pytest.approx(body.volume(), rel=0.01)
    shrunk = np.linalg.norm(names["moved"], axis=1) / np.linalg.norm(0.9 * points, axis=1)
    assert shrunk == pytest.approx(np.full(len(points), 0.95), abs=0.02)
    assert 0.9**3 < names["model"].volume("epi") / body.volume() < 1


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


def test_the_notebook_keeps_no_outputs_and_ends_with_the_fit():
    code = [cell for cell in cells() if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    assert "".join(code[-1]["source"]) == "fit"


def test_the_gallery_has_every_example_as_it_is():
    gallery, examples = runpy.run_path(str(DOCS / "gallery_figures.py")), sorted((ROOT / "examples").glob("*.py"))
    assert {path.stem for path in examples} == set(gallery["ORDER"]) == set(gallery["DRAW"])
    assert (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8") == gallery["page"](gallery["printed_on_page"]())
    for path in examples:
        code = path.read_text(encoding="utf-8")
        assert 8 <= len(code.splitlines()) <= 40, path
        assert ast.get_docstring(ast.parse(code)).splitlines()[0].endswith("."), path
        assert (gallery["PICTURES"] / f"{path.stem}.png").is_file()
