"""`paper`: what is refused before the work, and where the page goes."""

import pytest

from quadriform.report.paper import whole


@pytest.fixture
def work(monkeypatch):
    """The work itself takes minutes: its calls are counted instead."""
    calls = []

    def page(folder, progress):
        if folder is not None:
            whole.check_hearts(folder)
        calls.append(folder)
        progress(1, 1)
        return b"<!doctype html>"

    monkeypatch.setattr(whole, "paper_page", page)
    return calls


def test_the_page_is_written(terminal, tmp_path, work):
    result = terminal("paper", "-o", "page.html")
    assert (result.code, result.out) == (0, "")
    assert (tmp_path / "page.html").read_bytes() == b"<!doctype html>"
    assert work == [None]


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


def test_a_page_needs_a_name(terminal):
    assert terminal("paper").code == 2
