"""Comparisons of what a hand waits for: deformations, meshes, files, the import and the terminal's help."""

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import one_thread

import quadriform as qf
from comparing import baselines
from comparing.child import measure
from comparing.harness import Goal, Missing, Row, against, in_turn, seconds
from quadriform.files.models import MODEL_SUFFIXES
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes import directions


def ffd(repeats: int, quick: bool) -> Iterator[Row]:
    """A box of 5 x 5 x 5 at many points against splinepy and PyGeM."""
    n = 10_000 if quick else 1_000_000
    box = SyntheticVentricle().model(0.5).box
    queries = np.random.default_rng(0).uniform(size=(n, 3))
    points = box.origin + queries @ box.edges
    goals = {"splinepy, two threads": Goal(1 / 4, 1 / 10), "PyGeM": Goal(None)}
    makers: dict[str, Callable[[], Callable]] = {
        "splinepy, two threads": lambda: baselines.splinepy(box.control_points),
        "PyGeM": lambda: baselines.pygem(
            *(box.local(p.reshape(-1, 3)).reshape(p.shape) for p in (box.control_points, box.rest))
        ),
    }
    sides, missing = {"ours": lambda: box.deform(points)}, {}
    for name, make in makers.items():
        try:
            sides[name] = partial(make(), queries)
        except Missing as error:
            missing[name] = str(error)
    laps = in_turn(sides, repeats)
    for name, goal in goals.items():
        comparison = f"FFD of {n:,} points / {name}"
        if name in missing:
            yield Row(comparison, goal, None, baseline=missing[name])
        else:
            yield against(comparison, goal, laps["ours"], laps[name], name)
    yield _ffd_memory(points, queries)


def _ffd_memory(points: np.ndarray, queries: np.ndarray) -> Row:
    with TemporaryDirectory() as scratch:
        paths = {"ffd": points, "splinepy": queries}
        beyond = {}
        for job, array in paths.items():
            np.save(Path(scratch) / "input.npy", array)
            try:
                beyond[job] = f"{measure(job, Path(scratch) / 'input.npy')['beyond']:.3g}"
            except RuntimeError:
                beyond[job] = "none"
    comparison = f"FFD of {len(points):,} points: memory beyond the output"
    return Row(comparison, Goal(20, unit="MB"), float(beyond["ffd"]), "", f"splinepy {beyond['splinepy']} MB")


def commands(repeats: int, quick: bool) -> Iterator[Row]:
    """Processes from start to end, Python's own start counted."""
    program = Path(sys.executable).with_name("quadriform")
    sides = {
        "import quadriform": (Goal(0.25, unit="s"), [sys.executable, "-c", "import quadriform"]),
        "quadriform --help": (Goal(0.3, unit="s"), [str(program), "--help"]),
    }
    runs = {name: _process(command) for name, (_, command) in sides.items()}
    laps = in_turn({"nothing": _process([sys.executable, "-c", "pass"]), **runs}, 2 if quick else max(10, repeats))
    empty = f"an empty Python {seconds(laps['nothing'].median)}"
    for name, (goal, _) in sides.items():
        yield Row(f"`{name}`, whole process", goal, laps[name].median, seconds(laps[name].median), empty)


def _process(command: Sequence[str]) -> Callable[[], object]:
    return lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def mesh(repeats: int, quick: bool) -> Iterator[Row]:
    """A mesh of 100,000 vertices, with the grid of the sphere to be made and with it at hand."""
    model, resolution = SyntheticVentricle().model(0.5), 130  # 6 n^2 + 2 vertices

    def afresh() -> qf.Mesh:
        directions.sphere_grid.cache_clear()
        return model.mesh(resolution=resolution)

    laps = in_turn({"first call": afresh, "later calls": lambda: model.mesh(resolution=resolution)}, repeats)
    for name, lap in laps.items():
        comparison = f"mesh of {len(lap.result.vertices):,} vertices, {name}"
        yield Row(comparison, Goal(0.05, unit="s"), lap.median, seconds(lap.median))


def sizes(repeats: int, quick: bool) -> Iterator[Row]:
    """A fitted model of 386 parameters in its files; rounding has filled every digit."""
    with one_thread():
        model = qf.fit(SyntheticVentricle().surface_points("epi", 0.3, 900, 0.5)).model
    with TemporaryDirectory() as scratch:
        found = {}
        for suffix in MODEL_SUFFIXES:
            qf.save(model, Path(scratch) / f"model{suffix}")
            found[suffix] = (Path(scratch) / f"model{suffix}").stat().st_size / 1000
    yield Row(f"model of {model.n_parameters} parameters as JSON", Goal(12, unit="kB"), found.pop(".json"))
    suffix = min(found, key=found.__getitem__)
    yield Row(f"model of {model.n_parameters} parameters, binary", Goal(4, unit="kB"), found[suffix], f"`{suffix}`")
