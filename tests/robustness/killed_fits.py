"""Whole `quadriform fit` runs stopped at random instants: python killed_fits.py [COUNT] [SEED] (`make kill`).

A run is killed, ended or interrupted in turn; every other one at any instant of its time, the rest just after it began
to write. All its files must then be the old ones or all the new ones, byte for byte; a run that was stopped while it
moved them, so that there is no model, must leave the old ones to be put back by the next. A run after all of them must
do as if nothing had been. A program of its own, for it forks: each run is a process in which all is imported already.
Prints what became of the runs; exits with 1 where a promise was broken.
"""

import contextlib
import os
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from shapes_made import lumpy
from undrawn import draw_nothing

from quadriform.cli.main import main
from quadriform.files.result_folder import restore

SIGNALS = {9: "killed", 15: "ended", 2: "interrupted"}
ENDED = {9: (-9, 0), 15: (-15, 0), 2: (130, 0)}
"""Exit codes; 0 of a run that was done when the signal came."""
NAMES = ("model.json", "report.html", "surface.ply")
AGAIN = 1.0
"""Python loses an interrupt that falls into a finaliser: after a second it is sent again."""


def fit(folder: Path) -> int:
    """The run itself, silent."""
    words = ["fit", "cloud.xyz", "-o", "out", "--force", "--method", "paper", "--iterations", "1", "--box", "3,3,3"]
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        os.chdir(folder)
        return main(words)


def forked(folder: Path) -> int:
    child = os.fork()
    if not child:
        code = 1
        try:
            code = fit(folder)
        except KeyboardInterrupt:  # before or after the terminal's own part
            code = 130
        finally:
            os._exit(code)
    return child


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / "out" / name).read_bytes() for name in NAMES}


def strays(folder: Path) -> list[str]:
    return sorted(set(os.listdir(folder / "out")) - set(NAMES))


def stopped(child: int, signal: int) -> int:
    """How the process ended."""
    asked = -AGAIN
    while True:
        if time.monotonic() - asked > AGAIN:
            os.kill(child, signal)
            asked = time.monotonic()
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)


def first_write(folder: Path, child: int) -> None:
    """Wait until a temporary file or a new file shows, or the run has ended."""
    before = {entry.name: entry.inode() for entry in os.scandir(folder / "out")}
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        if {entry.name: entry.inode() for entry in os.scandir(folder / "out")} != before:
            return


def fate(folder: Path, old: dict[str, bytes], new: dict[str, bytes]) -> str:
    moving = not (folder / "out" / "model.json").exists()
    if moving:
        restore(folder / "out")
    found = contents(folder)
    return ("put back" if moving else "old") if found == old else "new" if found == new and not moving else "TORN"


def versions(folder: Path) -> tuple[dict[str, bytes], dict[str, bytes], float]:
    """What is there before, what a run makes of the cloud that is left, and how long a run takes."""
    found = []
    for seed in (1, 2):
        np.savetxt(folder / "cloud.xyz", lumpy(60, seed=seed), fmt="%.17g")
        began = time.monotonic()
        if fit(folder):
            raise SystemExit("the fit itself fails")
        found.append(contents(folder))
    return found[0], found[1], time.monotonic() - began


def harness(folder: Path, count: int, seed: int) -> tuple[Counter, list[str]]:
    """How often each thing happened, and each broken promise in words."""
    rng, (old, new, seconds), happened, faults = random.Random(seed), versions(folder), Counter(), []
    for turn in range(count):
        for name, data in old.items():
            (folder / "out" / name).write_bytes(data)
        before, signal = strays(folder), list(SIGNALS)[turn % 3]
        child = forked(folder)
        if turn % 2:
            first_write(folder, child)
        time.sleep(rng.uniform(0, 0.01 if turn % 2 else seconds))
        ended, which, more = stopped(child, signal), fate(folder, old, new), strays(folder)
        happened[SIGNALS[signal], which] += 1
        allowed = before if signal == 2 else [name for name in more if name.startswith(".quadriform-")]
        if which == "TORN" or ended not in ENDED[signal] or set(more) - set(before) - set(allowed):
            faults.append(f"run {turn}: {SIGNALS[signal]}, exit code {ended}, files {which}, left {more}")
    if fit(folder) or contents(folder) != new:
        faults.append("a run after all of them is not as if nothing had been")
    return happened, faults


def run() -> int:
    count, seed = (int(word) for word in (*sys.argv[1:], *("50", "69")[len(sys.argv) - 1 :]))
    draw_nothing(SimpleNamespace(setattr=setattr))  # drawings would take the longest time of a run
    with tempfile.TemporaryDirectory() as folder:
        happened, faults = harness(Path(folder), count, seed)
    for (how, which), times in sorted(happened.items()):
        print(f"{how}, files {which}: {times}")
    print("\n".join(faults) or f"{count} of {count} as promised")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(run())
