"""Searches the project for words that docs/vocabulary.toml replaces by standard terms; exit code 1 where it finds some.

Identifiers are split at underscores and capitals. In a sentence a word may be plain English: then only names count.
"""

import re
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = ROOT / "docs" / "vocabulary.toml"
CODE = (".py", ".cpp", ".hpp", ".js")
SEARCHED = (*CODE, ".md", ".ipynb", ".j2", ".html", ".toml")
PYTHON_PROSE = re.compile(r'""".*?"""|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|#[^\n]*', re.DOTALL)
OTHER_PROSE = re.compile(r'/\*.*?\*/|`[^`]*`|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|//[^\n]*', re.DOTALL)
CAPITAL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
COMMENT_START = re.compile(r"(?<=\n)[ \t]*(?:#|//|\*)")
WORD = re.compile(r"[a-z]+|(?<![a-z\d])\d[\d,.]*|[^\w\s\"'`]")


def read_list(path=LIST):
    """The entries of the list, words and allowed uses as lists of single words and signs."""
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["term"]
    for entry in entries:
        for key in ("words", "allowed"):
            entry[key] = [WORD.findall(phrase.replace("_", " ")) for phrase in entry.get(key, ())]
    return entries


def texts(root=ROOT):
    """Name and text of everything that is searched."""
    paths = [*(root / "src").rglob("*"), *(root / "docs").rglob("*.*"), *root.glob("examples/*.py")]
    for path in sorted([*paths, root / "README.md", root / "CONTRIBUTING.md"]):
        if path.suffix in SEARCHED and path.is_file() and path.name != LIST.name:
            yield str(path.relative_to(root)), path.read_text(encoding="utf-8")
    yield "CHANGELOG.md", (root / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## [0")[0]
    for path in sorted((root / "tests").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        yield str(path.relative_to(root)), text
        names = re.findall(r"^def (test_\w+)", text, re.MULTILINE)
        yield f"{path.relative_to(root)} (names)", "\n".join([path.stem, *names])


def is_test(name):
    """Whether a text is all of a file of tests, and not the names of its tests alone."""
    return name.startswith("tests/") and name.endswith(CODE)


def without_prose(name, text):
    """The text with blanks for strings and comments; nothing where it is no code."""
    if not name.endswith(CODE):
        return ""
    prose = PYTHON_PROSE if name.endswith(".py") else OTHER_PROSE
    return prose.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def places_of(words):
    """From each word to where it stands; # to where any number stands."""
    places = defaultdict(list)
    for i, word in enumerate(words):
        places[word].append(i)
        if word[0].isdigit():
            places["#"].append(i)
    return places


def positions(words, places, phrase):
    """Where the phrase begins among the words."""
    return [i for i in places.get(phrase[0], ()) if words[i + 1 : i + len(phrase)] == phrase[1:]]


def uses(entry, words, places):
    """Positions of an entry's words that no allowed phrase covers."""
    starts = ((i, len(phrase)) for phrase in entry["allowed"] for i in positions(words, places, phrase))
    allowed = {i + k for i, length in starts for k in range(length)}
    return [i for phrase in entry["words"] for i in positions(words, places, phrase) if i not in allowed]


def applies(entry, name, names_only):
    """Whether an entry counts in a text, or in its names alone."""
    if (entry.get("where") == "names") != names_only or not name.startswith(entry.get("within", "")):
        return False
    return not is_test(name) or bool(entry.get("tests"))


def search(entries, named_texts):
    """For each entry, by its number, the uses as `file:line: word`."""
    found = defaultdict(list)
    for name, text in named_texts:
        for names_only, searched in ((False, text), (True, without_prose(name, text))):
            counting = [(n, entry) for n, entry in enumerate(entries) if applies(entry, name, names_only)]
            if not counting:
                continue
            separate = CAPITAL.sub(" ", COMMENT_START.sub("", searched)).replace("_", " ").lower()
            matches = list(WORD.finditer(separate))
            words = [match[0] for match in matches]
            places = places_of(words)
            for number, entry in counting:
                for i in uses(entry, words, places):
                    line = separate.count("\n", 0, matches[i].start()) + 1
                    found[number].append(f"{name}:{line}: {words[i]}")
    return found


def main(path=LIST):
    """Print the words that are found; 1 where there are some."""
    entries = read_list(path)
    found = search(entries, texts())
    for number, uses_of in found.items():
        print(
            *uses_of, f"  -> {entries[number]['use']} ({path.name}: {' '.join(entries[number]['words'][0])})", sep="\n"
        )
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
