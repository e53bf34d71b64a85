"""Comparisons on the same work, both sides in turn in one run, and rate against distortion.

python benchmarks/comparisons.py [-o BENCHMARK.md] [--repeats 5] [--only NAME ...] [--quick] [--huge]

`-o` writes the report; without it the tables are printed alone. With `--only` those rows of an earlier report that are
not measured again stay as they are. `--quick` runs small sizes once, to see that everything runs: its figures mean
nothing, and no report is written of them.
"""

import argparse
import datetime
import os
import platform
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import rate_distortion
from common import table
from comparing import baselines, fits, hand
from comparing.harness import HEADER, Cells, Row, losses, replaced, table_of

import quadriform

PACKAGES = ("numpy", "scipy", "open3d", "pycpd", "probreg", "splinepy", "fast-simplification", "trimesh", "libigl")

MEASURED = """\
Written by `python benchmarks/comparisons.py -o BENCHMARK.md`. Both sides run in turn, A B A B, in one run; figures
are medians of {repeats} turns (at least 10 for commands; 10^7 points once). `measured` is our time over the
baseline's unless a unit is given. Our own fits in the same process hold BLAS to one thread; baselines have all
cores, and rows of their own with one thread, which on a busy machine is faster for them too: the harder row counts.
Our time includes the mesh (24,578 vertices) where a baseline returns one. Memory is the rise of the high-water mark
of a process of its own, input loaded, libraries imported and the same done once before on about 1,000 points; what
is returned is taken off. The two-threads comparison sets `OMP_NUM_THREADS` and `OPENBLAS_NUM_THREADS`: the first is
also how many threads our loops over points and searches of neighbours take.
"""


def comparisons(huge: bool) -> dict[str, Callable[[int, bool], Iterator[Row]]]:
    """All comparisons by name; each is called with the repeats and whether it should be quick."""
    return {
        "reconstruction": fits.reconstruction,
        "superquadric": fits.superquadric,
        "ffd": hand.ffd,
        "size": partial(fits.by_size, huge=huge),
        "cycle": fits.cycle,
        "threads": fits.threads,
        "commands": hand.commands,
        "mesh": hand.mesh,
        "files": hand.sizes,
    }


def machine() -> str:
    """Processor, cores, memory, system; no names of hosts."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        named = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = named[0] if named else model
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    load = os.getloadavg()[0]
    return f"{model}, {os.cpu_count()} cores, {memory:.0f} GiB, {platform.system()}; load {load:.1f} before the run"


def versions() -> str:
    """Of ourselves, Python and every baseline."""
    found = [f"quadriform {quadriform.__version__}", f"Python {platform.python_version()}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} not installed")
    return ", ".join(found)


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table as text."""
    cells = [list(header), *rows]
    lines = ["| " + " | ".join(row) + " |" for row in cells]
    return "\n".join([lines[0], "|" + " --- |" * len(cells[0]), *lines[1:]])


def report(rows: list[Cells], rate: list[Cells], before: str, repeats: int) -> str:
    """The text of BENCHMARK.md."""
    today = datetime.datetime.now(datetime.UTC).date()
    sections = [
        f"# Comparisons\n\n{today}. {before}.\n\n{versions()}.",
        MEASURED.format(repeats=repeats).strip(),
        f"## Results\n\n{markdown(HEADER, rows)}",
        "## Goals that are not reached\n\nRows that missed their goal, and comparisons that were not run.\n\n"
        + ("\n".join(losses(rows)) or "Nowhere in this run."),
        f"## How each baseline was called and tuned\n\n{baselines.HOW.strip()}",
        f"## Rate against distortion\n\n{markdown(rate_distortion.HEADER, rate)}"
        "\n\n![Rate against distortion](docs/figures/rate_distortion.png)",
    ]
    return "\n\n".join(sections) + "\n"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="write the report here")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--only", nargs="+", choices=[*comparisons(False), "rate"], default=[*comparisons(False), "rate"]
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, once, no report")
    parser.add_argument("--huge", action="store_true", help="10^7 points as well")
    chosen = parser.parse_args()
    if chosen.quick and chosen.output:
        parser.error("--quick measures nothing that could be reported; leave -o out")
    return chosen


def main() -> None:
    chosen, before = arguments(), machine()
    repeats = 1 if chosen.quick else chosen.repeats
    rows: list[Cells] = []

    def run() -> Iterator[tuple[str, ...]]:
        for name, comparison in comparisons(chosen.huge).items():
            if name in chosen.only:
                for row in comparison(repeats, chosen.quick):
                    rows.append(row.cells())
                    yield row.cells()

    table(HEADER, run())
    rate = rate_distortion.printed() if "rate" in chosen.only and not chosen.quick else []
    if chosen.output:
        earlier = chosen.output.read_text(encoding="utf-8") if chosen.output.is_file() else ""
        distortion = list(rate_distortion.rows(rate)) or table_of(earlier, "Rate against distortion")
        if distortion:
            rate_distortion.draw(rate_distortion.measured(distortion))
        every = replaced(table_of(earlier, "Results"), rows)
        if len(rows) < len(every):
            before += f". Only these comparisons were run then, the other rows are older: {', '.join(chosen.only)}"
        chosen.output.write_text(report(every, distortion, before, repeats), encoding="utf-8")


if __name__ == "__main__":
    main()
