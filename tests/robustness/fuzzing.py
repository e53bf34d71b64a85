"""Mutated files over all readers: python tests/robustness/fuzzing.py [COUNT] [SEED] (`make fuzz`).

Whatever bytes come, a reader ends in a typed error, in the same result as the whole file, or, in formats that have
neither checksum nor count for what was changed, in what an independent reader gets from the same bytes. Never another
exception, never more than `SECONDS` or `ROOM`. Files are read in a few processes, many in each.
"""

import multiprocessing
import resource
import signal
import sys
import tempfile
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import fuzzed_kinds
import numpy as np

from quadriform.errors import QuadriformError

SECONDS, ROOM = 10, 1024**3
MARKS = b'0123456789-+. =:\n,;e#"[]{}\0'
TYPED, SAME, INDEPENDENT = "typed error", "identical", "as an independent reader"


@dataclass(frozen=True)
class Fault:
    """A file that broke the promise: its kind, how it was changed, and what happened."""

    kind: str
    seed: int
    change: str
    what: str


def mutated(data: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """Cut, flipped, doubled, dropped, moved, put in, taken out or recounted; and how, in words."""
    how = rng.choice(["cut", "flip", "head", "lines", "swap", "insert", "delete", "digit", "several"])
    place = int(rng.integers(len(data)))
    if how == "cut":
        return data[:place], f"cut at {place}"
    if how in ("flip", "head"):
        place = place if how == "flip" else int(rng.integers(min(512, len(data))))
        bit = int(rng.integers(8))
        return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :], f"bit {bit} of byte {place} flipped"
    if how == "lines":
        lines = data.splitlines(keepends=True)
        line, twice = int(rng.integers(len(lines))), bool(rng.integers(2))
        return b"".join([*lines[:line], *[lines[line]] * 2 * twice, *lines[line + 1 :]]), f"line {line}, {twice=}"
    if how == "swap":
        lines = data.splitlines(keepends=True)
        one, other = (int(line) for line in rng.integers(min(30, len(lines)), size=2))
        lines[one], lines[other] = lines[other], lines[one]
        return b"".join(lines), f"lines {one} and {other} swapped"
    if how in ("insert", "delete"):
        place = int(rng.integers(min(512, len(data)))) if rng.integers(2) else place
        more = bytes([int(rng.choice(list(MARKS)))]) * int(rng.integers(1, 4)) if how == "insert" else b""
        left = data[place + (0 if more else int(rng.integers(1, 5))) :]
        return data[:place] + more + left, f"{how} at {place} {more!r}"
    if how == "digit":
        digits = [i for i, byte in enumerate(data[:2000]) if chr(byte).isdigit()]
        if not digits:
            return data[:-1], "cut at the last byte"
        place = int(rng.choice(digits))
        return data[:place] + b"%d" % rng.integers(10) + data[place + 1 :], f"digit at {place} changed"
    for _ in range(int(rng.integers(2, 6))):
        place = int(rng.integers(len(data)))
        data = data[:place] + bytes([int(rng.integers(256))]) + data[place + 1 :]
    return data, "several bytes"


def judged(kind: fuzzed_kinds.Kind, path: Path, whole: bytes) -> str:
    """What reading a changed file came to; an answer that is none of the three good ones is a fault's description."""
    try:
        found = fuzzed_kinds.plain(kind.read(path))
    except QuadriformError:
        return TYPED
    except MemoryError:
        return "no memory left"
    except BaseException:
        return traceback.format_exc(limit=-3)
    if found == whole:
        return SAME
    try:
        other = None if kind.independent is None else fuzzed_kinds.plain(kind.independent(path))
    except Exception as error:
        return f"accepted, where an independent reader refuses: {type(error).__name__}: {error}"
    return INDEPENDENT if found == other else "another result than the whole file's and an independent reader's"


def _too_long(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def batch(job: tuple[int, int]) -> tuple[Counter, list[Fault]]:
    """So many files of all kinds in turn, from a seed on."""
    first, count = job
    resource.setrlimit(resource.RLIMIT_AS, (4 * ROOM, resource.getrlimit(resource.RLIMIT_AS)[1]))
    signal.signal(signal.SIGALRM, _too_long)
    tally, faults = Counter(), list[Fault]()
    with tempfile.TemporaryDirectory() as folder:
        kinds = [(kind, *kind.sample(Path(folder))) for kind in fuzzed_kinds.KINDS]
        for seed in range(first, first + count):
            kind, path, data = kinds[seed % len(kinds)]
            changed, how = mutated(data, np.random.default_rng(seed))
            path.write_bytes(changed)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            signal.alarm(SECONDS)
            what = judged(kind, path, kind.whole)
            signal.alarm(0)
            if (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 > ROOM:
                what = "more than the room that it may take"
            tally[kind.name, what if what in (TYPED, SAME, INDEPENDENT) else "FAULT"] += 1
            if what not in (TYPED, SAME, INDEPENDENT):
                faults.append(Fault(kind.name, seed, how, what))
    return tally, faults


def run(count: int, seed: int, processes: int) -> tuple[Counter, list[Fault]]:
    """`count` files from a seed on."""
    each = max(1, min(500, count // processes))
    jobs = [(start, min(each, seed + count - start)) for start in range(seed, seed + count, each)]
    tally, faults = Counter(), list[Fault]()
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:  # a pool would wait for the dead
        for (first, number), done in [(job, pool.submit(batch, job)) for job in jobs]:
            try:
                some, broken = done.result()
            except BrokenProcessPool:
                broken = [Fault("all", first, f"one of {number} files", "its reader took the whole process down")]
                return tally, faults + broken
            tally += some
            faults += broken
    return tally, faults


def main() -> int:
    count, seed = (int(word) for word in (*sys.argv[1:], *("100000", "0")[len(sys.argv) - 1 :]))
    tally, faults = run(count, seed, 2)
    columns = (TYPED, SAME, INDEPENDENT, "FAULT")
    print("| reader | " + " | ".join(columns) + " |\n| --- |" + " --- |" * len(columns))
    for name in [kind.name for kind in fuzzed_kinds.KINDS]:
        print(f"| {name} | " + " | ".join(str(tally[name, column]) for column in columns) + " |")
    for fault in faults[:40]:
        print(f"\n{fault.kind}, seed {fault.seed}, {fault.change}: {fault.what}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
