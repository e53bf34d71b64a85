"""The screen, the page and `info` state the share of volumes and areas that is extrapolated."""

import json

import numpy as np
from shapes_made import lumpy


def test_the_terminal_and_the_page_state_them(terminal, tmp_path):
    cloud = lumpy(200)
    np.savetxt("cut.xyz", cloud[cloud[:, 2] < 10])
    found = terminal("fit", "cut.xyz", "-o", "cut", "--box", "3,3,3")
    assert found.code == 0
    assert "% of the area" in found.out and "not observed" in found.out and "reach beyond" in found.out
    page = (tmp_path / "cut" / "report.html").read_text(encoding="utf-8")
    assert "Data supports" in page and "not observed" in page
    record = json.loads(terminal("fit", "cut.xyz", "-o", "again", "--box", "3,3,3", "--json").out)
    assert record["estimates"]["volume"]["observed"] is False
    assert record["estimates"]["area"]["supported"] == record["supported"]["surface"]
    shown = terminal("info", "cut/model.json")
    assert "not observed" in shown.out and "extends beyond" in shown.out
    assert json.loads(terminal("info", "cut/model.json", "--json").out)["supported"] == record["supported"]
