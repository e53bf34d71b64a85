"""The tables of the docs: each has a script, a date and a commit, is replaced whole, and is listed once it is old."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import write_results as results

ROOT = Path(__file__).resolve().parents[1]
PAGE = "docs/benchmarks.md"


def pages():
    return {name: (ROOT / one.page).read_text(encoding="utf-8") for name, one in results.TABLES.items()}


def test_each_table_stands_once_in_its_page_under_its_script():
    for name, text in pages().items():
        assert (ROOT / "benchmarks" / f"{name}.py").is_file()
        found = [one for one in results.BLOCK.finditer(text) if one["name"] == name]
        assert len(found) == 1, name
        assert (
            results.block(name, found[0]["date"], found[0]["commit"], "x").splitlines()[0]
            == (found[0][0].splitlines()[0])
        )
        assert all((ROOT / path).exists() for path in found[0]["paths"].split()), name


def test_each_table_of_accuracy_is_written_by_a_script():
    """No row of numbers stands outside of the comments."""
    for page in {one.page for one in results.TABLES.values()}:
        outside = results.BLOCK.sub("", (ROOT / page).read_text(encoding="utf-8"))
        assert not re.findall(r"^\|.*\d\.\d.*\|$", outside, re.MULTILINE), page


def test_a_block_is_replaced_and_its_neighbours_stay():
    first, second = (results.block(name, "2026-01-01", "abc1234", f"| {name} |") for name in ("cycle", "hearts"))
    new = results.block("cycle", "2026-02-02", "def5678", "| new |")
    page = f"before\n{first}between\n{second}after\n"
    assert results.replaced(page, "cycle", new) == f"before\n{new}between\n{second}after\n"
    assert results.replaced(results.replaced(page, "cycle", new), "cycle", first) == page
    with pytest.raises(SystemExit, match="surfaces"):
        results.replaced(page, "surfaces", new)


def test_a_script_that_lacks_its_data_leaves_the_table(tmp_path, monkeypatch, capsys):
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "cycle.py").write_text("print('skipped: no data')\n", encoding="utf-8")
    monkeypatch.setattr(results, "ROOT", tmp_path)
    assert results.measure("cycle") is None and "cycle: not written: skipped: no data" in capsys.readouterr().out


def commit(folder, text):
    (folder / "src/quadriform/motion/a.py").write_text(text, encoding="utf-8")
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["add", "-A"], [*who, "commit", "-qm", text]):
        subprocess.run(["git", *words], cwd=folder, check=True)
    return results.git("rev-parse", "--short=7", "HEAD")


def test_a_table_is_old_once_its_code_changes(tmp_path, monkeypatch):
    for folder in ("docs", "src/quadriform/motion"):
        (tmp_path / folder).mkdir(parents=True)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    monkeypatch.setattr(results, "ROOT", tmp_path)
    only = results.Results(PAGE, ("src/quadriform/motion",))
    monkeypatch.setattr(results, "TABLES", {"cycle": only})
    (tmp_path / "README.md").write_text("", encoding="utf-8")
    measured = commit(tmp_path, "first")
    (tmp_path / PAGE).write_text(results.block("cycle", "2026-01-01", measured, "| 1 |"), encoding="utf-8")
    assert results.stale() == []
    commit(tmp_path, "second")
    assert results.stale() == [f"{PAGE}: cycle of 2026-01-01: 1 later commits in its code"]
