"""The search for words that have a standard term: it finds them in each kind of text, and lets plain English pass."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import wording
from wording import LIST, main, read_list, search, without_prose

ENTRIES = [
    {"words": [["gadget"]], "allowed": [], "use": "outlier"},
    {"words": [["at", "rest"]], "allowed": [], "use": "undeformed"},
    {"words": [["#", "numbers"]], "allowed": [], "use": "parameters"},
    {"words": [["turn"]], "allowed": [["turn", "table"]], "use": "rotation", "where": "names"},
    {"words": [["gizmo"]], "allowed": [], "use": "tool", "tests": True},
]


def found(name, text):
    return {number: places for number, places in search(ENTRIES, [(name, text)]).items() if places}


def test_words_are_found_in_prose_and_within_identifiers():
    assert found("a.md", "# A\nNo Gadget here") == {0: ["a.md:2: gadget"]}
    assert found("a.py", "gadget_count = firstGadget = 1") == {0: ["a.py:1: gadget"] * 2}
    assert found("a.md", "gadgetry gadgets' begadgeted") == {}


def test_phrases_go_on_in_the_next_line_of_a_comment():
    assert found("a.py", "# the box is at\n    # rest") == {1: ["a.py:1: at"]}
    assert found("a.py", "float32 numbers; x[1]; numbers[1] numbers") == {}
    assert found("a.md", "386 numbers, 1,157 numbers; all numbers") == {2: ["a.md:1: 386", "a.md:1: 1,157"]}


def test_plain_english_counts_in_identifiers_only():
    text = 'turn = 1  # turn\n"""turn\nturn"""\nf("turn", turn_table, turn=2)'
    assert found("a.py", text) == {3: ["a.py:1: turn", "a.py:4: turn"]}
    assert found("a.js", "// turn\n/* turn */ `turn` 'turn' turnBy(1)") == {3: ["a.js:2: turn"]}
    assert found("a.md", "turn") == {}


def test_the_bodies_of_tests_are_searched_for_some_words():
    text = "gizmo = at = 1  # a gadget at rest"
    assert found("tests/test_a.py", text) == {4: ["tests/test_a.py:1: gizmo"]}
    assert found("tests/test_a.py (names)", "test_gadget") == {0: ["tests/test_a.py (names):1: gadget"]}


def test_lines_stay_where_they_are():
    assert without_prose("a.py", '"""a\nb"""\nc').split("\n")[2] == "c"


def test_a_word_on_the_list_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(wording, "texts", lambda: [("a.md", "a gadget")])
    path = tmp_path / "list.toml"
    path.write_text('[[term]]\nwords = ["gadget"]\nuse = "outlier"\n', encoding="utf-8")
    assert main(path) == 1 and "a.md:1: gadget\n  -> outlier" in capsys.readouterr().out
    path.write_text('[[term]]\nwords = ["outsider"]\nuse = "outlier"\n', encoding="utf-8")
    assert main(path) == 0 and capsys.readouterr().out == ""


def test_the_list_gives_a_term_for_each_word():
    entries = read_list(LIST)
    words = [tuple(word) for entry in entries for word in entry["words"]]
    assert len(words) == len(set(words)) and all(entry["use"] for entry in entries)
