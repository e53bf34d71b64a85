"""The defaults on data that they were not tuned on: error to the truth, status and folds.

python benchmarks/next_patient.py [names...] [--limit N] [--shared PATH] [--cases] [--regret]

With --cases each benchmark has a table of its cases, the worst first. With --regret the errors stand beside those of
the best of seven strengths, chosen in hindsight by the truth.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from common import SHARED
from generalisation import dense, guidepoints, hearts, learned, moved, organs, scans, silent, spect, sunnybrook, voxels
from generalisation.rows import Missing
from generalisation.running import Measured, measured, print_table, regret_line, status_lines, summary

SOURCES = {
    "voxels": voxels,
    "sunnybrook": sunnybrook,
    "guidepoints": guidepoints,
    "hearts": hearts,
    "spect": spect,
    "organs": organs,
    "scans": scans,
    "silent": silent,
    "dense": dense,
    "moved": moved,
    "learned": learned,
}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(SOURCES)}; all unless given")
    parser.add_argument("--limit", type=int, help="only the first N bodies, patients, subjects or scenes of each")
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder with bench/ and data/")
    parser.add_argument("--cases", action="store_true", help="a table of the cases of each benchmark, the worst first")
    parser.add_argument("--regret", action="store_true", help="run the ladder of strengths as well")
    given = parser.parse_intermixed_args()
    if unknown := set(given.names) - set(SOURCES):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; expected {', '.join(SOURCES)}")
    return given


def run(name: str, given: argparse.Namespace, every: list[Measured]) -> list[str]:
    """The lines of the summary of one source; its rows are appended to `every`."""
    try:
        benchmarks = SOURCES[name].benchmarks(given.shared, given.limit)
    except Missing as reason:
        return [f"{name}: skipped, {reason}"]
    lines = []
    for benchmark in benchmarks:
        found = list(measured(benchmark, given.regret))
        if given.cases:
            print_table(benchmark, found)
        every += found
        lines.append(summary(benchmark, found))
    return lines


def main() -> None:
    given = arguments()
    every: list[Measured] = []
    lines = [line for name in given.names or SOURCES for line in run(name, given, every)]
    lines += status_lines(every) + ([regret_line(every)] if given.regret else [])
    print("## The default on data that it was not tuned on\n\n" + "\n".join(f"- {line}" for line in lines))


if __name__ == "__main__":
    main()
