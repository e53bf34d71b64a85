"""`paper`: what is refused before the work, and where the page goes."""

import pytest

from quadriform.report.paper import whole


@pytest.fixture
def work(monkeypatch):
    """The work itself takes minutes: its calls are counted instead."""
    calls = []

    def drawn(material, figures, progress):
        calls.append((material.folder, material.box, figures))
        progress(1, 1)
        return b"<!doctype html>"

    monkeypatch.setattr(whole, "drawn", drawn)
    return calls


def test_the_page_is_written(terminal, tmp_path, work):
    result = terminal("paper", "-o", "page.html")
    assert (result.code, result.out) == (0, "")
    assert (tmp_path / "page.html").read_bytes() == b"<!doctype html>"
    assert work == [(None, (5, 5, 5), list(whole.FIGURES))]


def test_a_file_that_exists_is_kept(terminal, tmp_path, work):
    (tmp_path / "page.html").write_text("mine")
    result = terminal("paper", "-o", "page.html")
    assert result.code == 5
    assert "exists already" in result.err
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "mine"
    assert work == []
    assert terminal("paper", "-o", "page.html", "--force").code == 0
    assert (tmp_path / "page.html").read_text(encoding="utf-8") != "mine"


def test_a_missing_folder_is_refused_before_the_work(terminal, tmp_path, work):
    result = terminal("paper", "-o", "no/page.html")
    assert result.code == 5
    assert "does not exist" in result.err
    assert work == []
    assert list(tmp_path.iterdir()) == []


def test_data_that_is_no_folder(terminal, tmp_path, work):
    (tmp_path / "file").write_text("x")
    for data in ("file", "nowhere"):
        result = terminal("paper", "-o", "page.html", "--data", data)
        assert result.code == 4
        assert f"'{data}': there is no such folder of real data" in result.err
    assert work == []
    assert not (tmp_path / "page.html").exists()


def test_figures_and_the_box_are_chosen(terminal, work):
    assert terminal("paper", "--figure", "6", "--box", "4,4,4", "-o", "a.html").code == 0
    assert terminal("paper", "--figure", "22, 1", "--figure", "kinds", "-o", "b.html").code == 0
    assert work == [(None, (4, 4, 4), ["6"]), (None, (5, 5, 5), ["1", "kinds", "22"])]


def test_an_unknown_figure_or_box_is_refused_before_the_work(terminal, tmp_path, work):
    result = terminal("paper", "--figure", "23", "-o", "page.html")
    assert result.code == 2
    assert "figure='23' is unknown; expected one of '1', 'kinds', '2', '3'" in result.err
    for box in ("4,4", "1,5,5", "5,5,21", "a,b,c"):
        result = terminal("paper", "--box", box, "-o", "page.html")
        assert result.code == 2 and "box" in result.err
    assert work == []
    assert not (tmp_path / "page.html").exists()


def test_another_suffix_is_refused_before_the_work(terminal, tmp_path, work):
    for name in ("page", "page.pdf"):
        result = terminal("paper", "-o", name)
        assert result.code == 4 and f"'{name}': a page cannot have the suffix" in result.err
    assert work == [] and list(tmp_path.iterdir()) == []


def test_one_figure_alone_is_made(terminal, tmp_path):
    assert terminal("paper", "--figure", "5", "-o", "page.html").code == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Fig. 5" in text and "Fig. 4" not in text


def test_a_page_needs_a_name(terminal):
    assert terminal("paper").code == 2
