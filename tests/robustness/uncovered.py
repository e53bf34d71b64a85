"""Coverage of the packages, and what no test runs: python uncovered.py COVERAGE.json (`make coverage`).

Prints the tables of docs/reliability.md; exits with 1 where a package is below `LEAST`, or a function with lines that
no test runs does not stand in the list of that page.
"""

import json
import re
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("shapes", "fitting", "imaging", "motion", "files", "priors")
LEAST = 95.0
LISTED = re.compile(r"^- `([\w/]+\.py)::([\w.]+)`", re.MULTILINE)


def percent(of: list[dict], what: str) -> float:
    """Share of lines ("lines", "statements") or of branches that were run."""
    run, all_of = {"lines": ("covered_lines", "num_statements"), "branches": ("covered_branches", "num_branches")}[what]
    total = sum(each[all_of] for each in of)
    return 100 * sum(each[run] for each in of) / total if total else 100.0


def uncovered(measured: dict) -> dict[str, dict[str, int]]:
    """For each file the functions with lines that were not run, and how many."""
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for path, file in measured["files"].items():
        name = path.split("quadriform/", 1)[1]
        if name.split("/")[0] in PACKAGES:
            for function, region in file["functions"].items():
                if region["missing_lines"]:
                    found[name][function or "(module)"] = len(region["missing_lines"])
    return found


def main() -> int:
    measured = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    by_package = defaultdict(list)
    for path, file in measured["files"].items():
        by_package[path.split("quadriform/", 1)[1].split("/")[0]].append(file["summary"])
    print("| package | lines, % | branches, % |\n| --- | --: | --: |")
    shares = {p: (percent(by_package[p], "lines"), percent(by_package[p], "branches")) for p in PACKAGES}
    for package, (lines, branches) in shares.items():
        print(f"| {package} | {lines:.1f} | {branches:.1f} |")
    listed = set(LISTED.findall((ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")))
    rows = [(file, function, n) for file, all_of in uncovered(measured).items() for function, n in all_of.items()]
    for file, function, count in rows:
        print(f"- `{file}::{function}`: {count} lines{'' if (file, function) in listed else ' (NOT LISTED)'}")
    low = [package for package, both in shares.items() if min(both) < LEAST]
    return int(bool(low) or any((file, function) not in listed for file, function, _ in rows))


if __name__ == "__main__":
    sys.exit(main())
