"""Comparisons of fits: against other ways to a surface, by size, by threads, and a whole cycle."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import bench_data, one_thread, rms
from scipy.spatial import cKDTree

import quadriform as qf
from comparing import baselines
from comparing.child import measure
from comparing.harness import Goal, Lap, Missing, Row, against, in_turn, seconds
from quadriform.heart.synthetic import SyntheticVentricle

NOISE = 0.5
"""Of points, mm."""
SEED = 20261125
BASELINES: dict[str, Callable[[np.ndarray], baselines.Surface]] = {
    "Open3D Poisson": baselines.poisson,
    "Open3D Poisson, depth 5": lambda points: baselines.poisson(points, baselines.COARSE),
    "pycpd": baselines.pycpd,
    "probreg": baselines.probreg,
}
ONE = ", one thread"
GOALS = {
    ("Open3D Poisson", "p6000"): Goal(1.0, 1 / 3),
    ("Open3D Poisson", "p20000"): Goal(0.7, 1 / 3),
    ("pycpd", "p6000"): Goal(1 / 8, 1 / 25),
    ("pycpd", "p20000"): Goal(1 / 8, 1 / 25),
    ("probreg", "p6000"): Goal(1 / 2, 1 / 9),
    ("probreg", "p20000"): Goal(1 / 2, 1 / 9),
}
KD_TREE = {1_000: Goal(60, 20), 10_000: Goal(15, 5), 100_000: Goal(8, 3)}


def held(baseline: Callable[[np.ndarray], baselines.Surface], points: np.ndarray) -> baselines.Surface:
    """A baseline with BLAS and OpenMP held to one thread: on a busy machine that is the faster way for it too."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return baseline(points)


def ours(points: np.ndarray) -> baselines.Surface:
    """The whole default fit and its mesh, BLAS held to one thread, as in the tests."""
    with one_thread():
        mesh = qf.fit(points).model.mesh(resolution=64)
    return mesh.vertices, mesh.faces


def reconstruction(repeats: int, quick: bool) -> Iterator[Row]:
    """The egg against Poisson and coherent point drift; each row has the errors of both surfaces beside their times."""
    folder = bench_data("surfaces")
    if folder is None:
        yield Row(
            "whole default fit of the egg",
            Goal(1.0),
            None,
            baseline="the benchmark data of closed surfaces is not there",
        )
        return
    data = np.load(folder / "data" / "egg.npz")
    for key in ("p1000",) if quick else ("p6000", "p20000"):
        yield from _reconstruction(data, key, repeats)


def _reconstruction(data: np.lib.npyio.NpzFile, key: str, repeats: int) -> Iterator[Row]:
    points, sides, missing = data[key], {}, {}
    every = BASELINES | {name + ONE: partial(held, BASELINES[name]) for name, _ in GOALS}
    for name, baseline in every.items():
        try:
            baseline(data["p1000"][::4])  # imports, and says now what is missing
            sides[name] = baseline
        except Missing as error:
            missing[name] = str(error)
    laps = in_turn({n: partial(side, points) for n, side in {"ours": ours, **sides}.items()}, repeats)
    for name in every:
        comparison = f"whole default fit of egg {key} / {name}"
        goal = GOALS.get((name.removesuffix(ONE), key), Goal(None))
        if name in missing:
            yield Row(comparison, goal, None, baseline=missing[name])
        else:
            row = against(comparison, goal, laps["ours"], laps[name], name, _error(laps["ours"], data))
            yield Row(comparison, goal, row.value, row.ours, row.baseline + _error(laps[name], data))


def _error(lap: Lap, data: np.lib.npyio.NpzFile) -> str:
    from metrics import evaluate

    return f", RMS {evaluate(*lap.result, data)['rms']:.3f}"


def superquadric(repeats: int, quick: bool) -> Iterator[Row]:
    """A superquadric alone against one k-d tree of the same cloud, CPU time: of points of its kind, and of others."""
    made = {"points of a superquadric": _of_a_superquadric, "points of a ventricle": _of_a_ventricle}
    for what, drawn in made.items():
        for n, goal in KD_TREE.items():
            if quick and n > 1_000:
                break
            points = drawn(n)
            sides = {"ours": partial(qf.fit_superquadric, points), "tree": partial(_tree, points)}
            with one_thread():  # threads that wait would count as work
                laps = in_turn(sides, repeats, time.process_time)
            comparison = f"superquadric alone, {n:,} {what}, CPU / k-d tree"
            yield against(comparison, goal, laps["ours"], laps["tree"], "scipy cKDTree")


def _of_a_superquadric(n: int) -> np.ndarray:
    rng = np.random.default_rng(SEED)
    directions = rng.normal(size=(n, 3))
    shape = qf.Superquadric(semi_axes=(30, 20, 15), exponents=(0.7, 1.2))
    surface = shape.surface(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    return surface + NOISE * rng.normal(size=(n, 3))


def _of_a_ventricle(n: int) -> np.ndarray:
    return SyntheticVentricle().surface_points("epi", 0.3, n, NOISE)


def _tree(points: np.ndarray) -> None:
    cKDTree(points).query(points)


def cycle(repeats: int, quick: bool) -> Iterator[Row]:
    """A whole cycle of two surfaces at once against as many fits."""
    heart, n_frames = SyntheticVentricle(), 4 if quick else 25
    times = np.arange(n_frames) / n_frames
    frames = [
        {name: heart.surface_points(name, at, 400, NOISE, seed=k) for name in ("epi", "endo")}
        for k, at in enumerate(times)
    ]
    sides = {
        "cycle": lambda: qf.track(frames, times=times, period=1.0),
        "fits": lambda: [qf.fit(frame) for frame in frames],
    }
    with one_thread():
        laps = in_turn(sides, repeats)
    comparison = f"{n_frames} frames, two surfaces of 400 points, whole cycle / single fits"
    yield against(comparison, Goal(2.0, 1.0), laps["cycle"], laps["fits"], "single fits")


def by_size(repeats: int, quick: bool, huge: bool) -> Iterator[Row]:
    """Fits of more and more points, one thread: growth, memory, and whether the surface is still the same."""
    sizes = [1_000, 10_000] if quick else [10_000, 100_000, 1_000_000]
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        runs = _runs(folder, sizes, repeats)
        if huge:
            runs |= _runs(folder, [10_000_000], 1)
        medians = {n: float(np.median([run["seconds"] for run in found])) for n, found in runs.items()}
        for less, more in pairwise(medians):
            growth = medians[more] / medians[less] / (more / less)
            times = (f"{more:,}: {seconds(medians[more])}", f"{less:,}: {seconds(medians[less])}")
            yield Row(f"fit of {more:,} points: growth of time over growth of N", Goal(1.0), growth, *times)
        for n, found in runs.items():
            beyond = float(np.median([run["beyond"] for run in found]))
            said = f"{seconds(medians[n])}, {len(found)} run{'s' * (len(found) > 1)}"
            yield Row(
                f"fit of {n:,} points: memory beyond input and returned arrays", Goal(100, unit="MB"), beyond, said
            )
        yield from _same_surface(folder, list(runs))
    if not huge and not quick:
        yield Row("fit of 10,000,000 points", Goal(100, unit="MB"), None, baseline="only with --huge")


def _runs(folder: Path, sizes: list[int], repeats: int) -> dict[int, list[dict[str, float]]]:
    """Fits of each size in turn, each in a process of its own; models are left in the folder."""
    for n in sizes:
        np.save(folder / f"{n}.npy", SyntheticVentricle().surface_points("epi", 0.3, n, NOISE))
    runs: dict[int, list[dict[str, float]]] = {n: [] for n in sizes}
    for _ in range(repeats):
        for n in sizes:
            (folder / f"{n}.json").unlink(missing_ok=True)
            runs[n].append(measure("fit", folder / f"{n}.npy", 1, folder / f"{n}.json"))
    for n in sizes:
        (folder / f"{n}.npy").unlink()
    return runs


def _same_surface(folder: Path, sizes: list[int]) -> Iterator[Row]:
    """The fits of large clouds beside that of 10^6 points, and beside the truth, in standard deviations of the noise.

    Two clouds of different sizes have different noise: their fits cannot be nearer than about noise x sqrt(386 / n).
    """
    models = {n: qf.load(folder / f"{n}.json") for n in sizes}
    middle = 1_000_000 if 1_000_000 in models else max(models)
    samples = SyntheticVentricle().surface_points("epi", 0.3, 5_000)
    for n, model in models.items():
        truth = f"RMS to the truth {rms(model.distance(samples)) / NOISE:.2g} of the noise"
        if n == middle:
            continue
        apart = rms(models[middle].distance(model.mesh(resolution=24).vertices)) / NOISE
        bound = f"noise alone allows about {np.sqrt(386 / min(n, middle)):.1g}"
        goal = Goal(None, 1e-3 if n > middle else None, "of the noise")
        yield Row(f"surface of {n:,} points against that of {middle:,}", goal, apart, truth, bound)


def threads(repeats: int, quick: bool) -> Iterator[Row]:
    """One thread against two of BLAS and OpenMP, on one fit, processes in turn; only the fit itself is timed."""
    n = 10_000 if quick else 1_000_000
    with TemporaryDirectory() as scratch:
        path = Path(scratch) / "points.npy"
        np.save(path, SyntheticVentricle().surface_points("epi", 0.3, n, NOISE))
        found: dict[int, list[float]] = {1: [], 2: []}
        for _ in range(repeats):
            for count in found:
                found[count].append(measure("fit", path, count)["seconds"])
    one, two = (float(np.median(found[count])) for count in (1, 2))
    comparison = f"two threads (OMP_NUM_THREADS) against one, fit of {n:,} points"
    yield Row(comparison, Goal(1.6, 1.9, at_least=True), one / two, f"two: {seconds(two)}", f"one: {seconds(one)}")
