"""Writes the tables of README and docs from the scripts that measure them, each with date and commit.

make results         the tables that take minutes
make results-full    all of them, hours
make stale-results   lists the tables that are older than the code they depend on; nothing is measured

A table stands between two comments in a page. The first names the script, the date, the commit, and the folders whose
changes make the table old.
"""

import argparse
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(
    r"<!-- results: (?P<name>\w+); (?P<date>[\d-]+), commit (?P<commit>\w+); depends on (?P<paths>[^>]*) -->\n"
    r"(?P<body>.*?)<!-- end of results: (?P=name) -->\n",
    re.DOTALL,
)
FITTING = ("src/quadriform/fitting", "src/quadriform/shapes")
HEARTS = (*FITTING, "src/quadriform/imaging", "src/quadriform/heart")


@dataclass(frozen=True)
class Results:
    """What one script measures.

    Attributes:
        page: with the two comments.
        paths: folders whose changes make the table old, beside the script.
        long: whether it takes more than some minutes.
    """

    page: str
    paths: tuple[str, ...]
    long: bool = False


TABLES = {
    "superquadrics": Results("docs/benchmarks.md", ("src/quadriform/fitting/superquadric",), long=True),
    "surfaces": Results("docs/benchmarks.md", FITTING, long=True),
    "ventricles": Results("docs/benchmarks.md", FITTING),
    "two_boxes": Results("docs/benchmarks.md", FITTING),
    "regularity": Results("docs/benchmarks.md", ("src/quadriform/fitting/paper",)),
    "cycle": Results("docs/benchmarks.md", (*FITTING, "src/quadriform/motion"), long=True),
    "hearts": Results("docs/benchmarks.md", HEARTS, long=True),
    "next_patient": Results(
        "docs/benchmarks.md", ("benchmarks/generalisation", *HEARTS, "src/quadriform/motion"), True
    ),
    "real_data": Results("docs/real_data.md", (*FITTING, "src/quadriform/imaging"), long=True),
}


def git(*words: str) -> str:
    """What git prints."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout.strip()


def block(name: str, day: str, commit: str, body: str) -> str:
    """The lines from the first comment to the last."""
    paths = " ".join((f"benchmarks/{name}.py", *TABLES[name].paths))
    shown = f"*Measured by `benchmarks/{name}.py` on {day}, commit {commit}.*"
    return (
        f"<!-- results: {name}; {day}, commit {commit}; depends on {paths} -->\n{body.strip()}\n\n{shown}\n"
        f"<!-- end of results: {name} -->\n"
    )


def replaced(page: str, name: str, new: str) -> str:
    """The page with the block of that name replaced.

    Raises:
        SystemExit: the page has none.
    """
    found = next((one for one in BLOCK.finditer(page) if one["name"] == name), None)
    if found is None:
        raise SystemExit(f"{TABLES[name].page} has no comments `results: {name}`")
    return page[: found.start()] + new + page[found.end() :]


def measure(name: str) -> str | None:
    """The tables that a script prints in Markdown; None, with a printed reason, where something it needs is missing."""
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, str(ROOT / "benchmarks" / f"{name}.py")]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | one_thread, stdout=subprocess.PIPE, encoding="utf-8")
    if done.returncode or "skipped" in done.stdout:
        reason = next((line for line in done.stdout.splitlines() if "skipped" in line), f"exit code {done.returncode}")
        print(f"{name}: not written: {reason}")
        return None
    return done.stdout


def write(names: list[str]) -> None:
    """Measure and write the tables of these names, one after the other."""
    for name in names:
        body = measure(name)
        if body is None:
            continue
        path = ROOT / TABLES[name].page
        new = block(name, date.today().isoformat(), git("rev-parse", "--short=7", "HEAD"), body)
        path.write_text(replaced(path.read_text(encoding="utf-8"), name, new), encoding="utf-8")
        print(f"{name}: written to {TABLES[name].page}", flush=True)


def stale() -> list[str]:
    """A line for each table whose code has changed since it was measured."""
    lines = []
    for page in sorted({one.page for one in TABLES.values()} | {"README.md"}):
        for found in BLOCK.finditer((ROOT / page).read_text(encoding="utf-8")):
            since = f"{found['commit']}..HEAD"
            try:
                commits = git("log", "--format=%h", since, "--", *found["paths"].split()).split()
            except subprocess.CalledProcessError:  # a shallow clone does not have the commit
                commits = ["?"]
            if commits:
                lines.append(f"{page}: {found['name']} of {found['date']}: {len(commits)} later commits in its code")
    return lines


def main() -> int:
    """Write tables, or list those that are old."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *TABLES], help="which; all that take minutes unless given")
    parser.add_argument("--full", action="store_true", help="the long ones too")
    parser.add_argument("--stale", action="store_true", help="list the tables that are older than their code")
    parser.add_argument("--release", action="store_true", help="with --stale: exit code 1 where there are some")
    chosen = parser.parse_args()
    if chosen.stale:
        lines = stale()
        print(*lines, sep="\n" if lines else "")
        return 1 if lines and chosen.release else 0
    write(chosen.names or [name for name, one in TABLES.items() if chosen.full or not one.long])
    return 0


if __name__ == "__main__":
    sys.exit(main())
