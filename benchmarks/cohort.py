"""What a cohort costs and survives: the figures of docs/scale.md, each part by its own name.

    python benchmarks/cohort.py PART ... [--subjects 1000] [--folder out/cohort]

same        serial, on two workers of dask.distributed, one of them killed, killed as a whole and resumed, in two shards
            at once: all byte for byte the same, ten broken subjects among them
speedup     units of work of a second and more: two workers against one
overhead    what a unit costs beside its fit
memory      of the driver, at 1,000 and at 10,000 tiny subjects
lists       a list of 100,000 rows checked, files looked for
modes       known modes found again, from models and from noisy points
cost        seconds and bytes of a fit of 50 frames with both walls, and what 100,000 such subjects take
"""

import argparse
import filecmp
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil

from quadriform.heart.synthetic import SyntheticVentricle

TINY = ("box=2,2,2", "robust=no", "strength=1e-4")
BROKEN = 10
VENTRICLE = SyntheticVentricle()


def make(folder, subjects, points, frames=2, surfaces=("endo",), broken=0):
    """Clouds of ventricles of different sizes on disk, and their list; the last point of a broken one is no number."""
    shutil.rmtree(folder, ignore_errors=True)
    times = np.arange(frames) / frames
    exact = {name: [VENTRICLE.surface_points(name, t, points) for t in times] for name in surfaces}
    bad = {round((k + 0.5) * subjects / broken) for k in range(broken)}
    rows = ["id,input,surface"]
    for number in range(subjects):
        rng = np.random.default_rng(number)
        home = folder / "clouds" / f"s{number:06d}"
        home.mkdir(parents=True)
        size = np.exp(0.1 * rng.normal(size=3))
        for name in surfaces:
            for frame, cloud in enumerate(exact[name]):
                moved = cloud * size + 0.3 * rng.normal(size=cloud.shape)
                if number in bad and frame == frames - 1:
                    moved[-1] = np.nan
                np.save(home / f"{name}_{frame:02d}.npy", moved)
        files = [f"{name}=clouds/s{number:06d}/{name}_*.npy" for name in surfaces]
        rows.append(f"s{number:06d},,{';'.join(files)}")
    (folder / "list.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder / "list.csv"


def command(manifest, out, *words, options=TINY):
    sets = [word for one in options for word in ("--set", one)]
    return [sys.executable, "-m", "quadriform.cli.main", "cohort", manifest, "-o", out, "--json", *sets, *words]


def run(manifest, out, *words, options=TINY, code=None):
    """The record of a whole run, and the seconds it took."""
    begin = time.perf_counter()
    done = subprocess.run(command(manifest, out, *words, options=options), capture_output=True, encoding="utf-8")
    if done.returncode not in ((0, 7) if code is None else (code,)):
        raise SystemExit(f"exit code {done.returncode}: {done.stderr}")
    return json.loads(done.stdout), time.perf_counter() - begin


def start(manifest, out, *words):
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(command(manifest, out, *words), start_new_session=True, **quiet)


def models(out):
    return sorted((out / "subjects").glob("*/model.json"))


def wait_for_models(out, count, process):
    while len(models(out)) < count and process.poll() is None:
        time.sleep(0.2)


def differences(one, other):
    """Files that one folder has and the other has not, or that differ in a byte."""
    names = [{path.relative_to(root) for path in root.rglob("*") if path.is_file()} for root in (one, other)]
    alike = [name for name in names[0] & names[1] if filecmp.cmp(one / name, other / name, shallow=False)]
    return sorted((names[0] | names[1]) - set(alike))


# --- parts -------------------------------------------------------------------------------------------------------


def same(folder, subjects):
    broken = min(BROKEN, subjects // 10)
    manifest = make(folder / "same", subjects, 24, broken=broken)
    home = manifest.parent
    serial, seconds = run(manifest, home / "serial", "--processes", "1", code=7)
    rows = (home / "serial" / "failures.csv").read_text(encoding="utf-8").splitlines()[1:]
    print(f"serial: {serial['fitted']} fitted, {serial['failed']} failed, exit code 7, {seconds:.0f} s")
    print(f"failures.csv: {len(rows)} rows; models: {len(models(home / 'serial'))}")

    _, seconds = run(manifest, home / "dask", "--workers", "2", code=7)
    print(
        f"two workers of dask: {seconds:.0f} s; files that differ: {len(differences(home / 'serial', home / 'dask'))}"
    )
    killed(manifest, home, subjects)
    resumed(manifest, home, subjects)
    shards(manifest, home)


def killed(manifest, home, subjects):
    """A worker of the cluster is killed when a fifth is done."""
    process = start(manifest, home / "killed", "--workers", "2")
    wait_for_models(home / "killed", subjects // 5, process)
    workers = [child for child in psutil.Process(process.pid).children(recursive=True) if is_worker(child)]
    os.kill(workers[0].pid, signal.SIGKILL)
    code = process.wait()
    print(f"one of {len(workers)} workers killed: exit code {code}; files that differ: ", end="")
    print(len(differences(home / "serial", home / "killed")))


def is_worker(process):
    """Processes that a nanny began: children of a child's, or those that burn the time."""
    return "spawn_main" in " ".join(process.cmdline())


def resumed(manifest, home, subjects):
    """The whole run is killed when two fifths are done, and resumed."""
    out = home / "resumed"
    process = start(manifest, out, "--workers", "2")
    wait_for_models(out, 2 * subjects // 5, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(5)  # nannies end their workers when they find nobody above them
    before = {path: path.stat().st_mtime_ns for path in models(out)}
    record, seconds = run(manifest, out, "--workers", "2", "--resume", code=7)
    touched = sum(path.stat().st_mtime_ns != at for path, at in before.items())
    print(f"killed as a whole with {len(before)} done; resumed in {seconds:.0f} s: {record['kept']} kept, ", end="")
    print(f"{record['fitted']} fitted, {touched} of those done were written again; ", end="")
    print(f"files that differ: {len(differences(home / 'serial', out))}")


def shards(manifest, home):
    out = home / "shards"
    both = [start(manifest, out, "--processes", "1", "--shard", f"{part}/2") for part in (1, 2)]
    codes = [process.wait() for process in both]
    print(f"two shards at once: exit codes {codes}; files that differ: {len(differences(home / 'serial', out))}")


def speedup(folder, subjects):
    manifest = make(folder / "speedup", subjects, 600)
    options = ("box=5,5,5",)
    one, _ = run(manifest, manifest.parent / "one", "--workers", "1", options=options)
    two, _ = run(manifest, manifest.parent / "two", "--workers", "2", options=options)
    serial, _ = run(manifest, manifest.parent / "serial", "--processes", "1", options=options)
    took = {name: record["seconds"] for name, record in (("process", serial), ("worker", one), ("workers", two))}
    print(f"{subjects} units of {took['process'] / subjects:.2f} s: one process {took['process']:.1f} s,", end=" ")
    print(f"one worker {took['worker']:.1f} s, two workers {took['workers']:.1f} s:", end=" ")
    print(f"{took['process'] / took['workers']:.2f} x the serial run,", end=" ")
    print(f"{took['worker'] / took['workers']:.2f} x one worker; load of the last minute {os.getloadavg()[0]:.1f}")


def overhead(folder, subjects):
    """Wall clock a unit on one worker, from the slope between two sizes, less the unit itself in this process."""
    from quadriform.cohort.layout import ensure_layout
    from quadriform.cohort.manifest import option, read_manifest
    from quadriform.cohort.subject import Task, work

    few, many = subjects // 4, subjects
    manifest = make(folder / "overhead", many, 24)
    rows = manifest.read_text(encoding="utf-8").splitlines()
    short = manifest.with_name("short.csv")
    short.write_text("\n".join(rows[: few + 1]) + "\n", encoding="utf-8")
    options = dict((name, option(name, value)) for name, value in (one.split("=") for one in TINY))
    listed, out = read_manifest(short, options), manifest.parent / "direct"
    out.mkdir()
    layout = ensure_layout(out, listed, None, 1)
    tasks = [Task(row, listed.folder, out, layout) for row in listed.rows()]
    work(tasks[0])
    begin = time.perf_counter()
    for task in tasks:
        work(task)
    unit = (time.perf_counter() - begin) / few
    for name, words in (("processes", ("--processes", "1")), ("dask", ("--workers", "1"))):
        small, _ = run(short, manifest.parent / f"{name}-few", *words)
        large, _ = run(manifest, manifest.parent / f"{name}-many", *words)
        slope = (large["seconds"] - small["seconds"]) / (many - few)
        print(f"{name}: a unit of {1e3 * unit:.0f} ms takes {1e3 * slope:.0f} ms,", end=" ")
        print(f"{1e3 * (slope - unit):.0f} ms overhead; start and end {small['seconds'] - few * slope:.1f} s")


def memory(folder, subjects):
    """Peak of the driver alone; the fits of all subjects but one are planted, and read back by the workers."""
    for count in (subjects, 10 * subjects):
        manifest = make(folder / f"memory-{count}", count, 24, frames=1)
        out = plant(manifest, manifest.parent / "out")
        process, begin = start(manifest, out, "--processes", "1", "--resume"), time.perf_counter()
        peak = 0
        while process.poll() is None:
            try:
                status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
                peak = max(peak, *(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")))
            except (FileNotFoundError, ProcessLookupError, TypeError):
                pass
            time.sleep(0.2)
        seconds = time.perf_counter() - begin
        print(f"{count} subjects: the driver's peak is {peak / 1024:.0f} MiB, exit code {process.returncode};", end=" ")
        print(f"{seconds:.0f} s, {1e3 * seconds / count:.1f} ms each, page and modes included")


def plant(manifest, out):
    """The results of the first subject, as those of all."""
    from quadriform.cohort import subject
    from quadriform.cohort.layout import ensure_layout
    from quadriform.cohort.manifest import option, read_manifest
    from quadriform.cohort.subject_files import files_by_surface

    options = dict((name, option(name, value)) for name, value in (one.split("=") for one in TINY))
    listed = read_manifest(manifest, options)
    out.mkdir()
    layout = ensure_layout(out, listed, None, 1)
    first = None
    for row in listed.rows():
        task = subject.Task(row, listed.folder, out.absolute(), layout)
        if first is None:
            subject.work(task)
            first = json.loads((task.target / subject.RECORD).read_text(encoding="utf-8"))
            source = task.target / subject.MODEL
            continue
        task.target.mkdir(parents=True)
        shutil.copy(source, task.target / subject.MODEL)
        files = [file for many in files_by_surface(row, listed.folder).values() for file in many]
        record = first | {"key": subject._key(task, files)}
        (task.target / subject.RECORD).write_text(json.dumps(record), encoding="utf-8")
    return out


def lists(folder, subjects):
    """How long a list of many rows is checked, what memory that takes, and how long files are looked for."""
    from quadriform.cohort.manifest import read_manifest
    from quadriform.cohort.subject_files import inspect_files

    few = make(folder / "lists", 200, 24)
    many = few.with_name("many.csv")
    rows = [f"s{number:06d},clouds/s{number % 200:06d}/endo_*.npy" for number in range(subjects)]
    many.write_text("id,input\n" + "\n".join(rows) + "\n", encoding="utf-8")
    begin = time.perf_counter()
    read_manifest(many, {})
    seconds = time.perf_counter() - begin
    tracemalloc.start()
    listed = read_manifest(few, {})
    small = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    read_manifest(many, {})
    peak = tracemalloc.get_traced_memory()[1] - small
    tracemalloc.stop()
    begin = time.perf_counter()
    for row in listed.rows():
        inspect_files(row, listed.folder)
    look = (time.perf_counter() - begin) / listed.subjects
    print(
        f"{subjects} rows are checked in {seconds:.1f} s and {peak / 2**20:.0f} MiB; files of a row found in", end=" "
    )
    print(f"{1e3 * look:.2f} ms")


def modes(folder, subjects):
    from scipy.linalg import subspace_angles
    from scipy.spatial.transform import Rotation

    from quadriform.cohort.statistics import shape_modes
    from quadriform.shapes.control_box import ControlBox
    from quadriform.shapes.model import DeformableModel

    surface = replace(VENTRICLE.surface("endo"), semi_axes=np.array([28.0, 22.0, 44.0]))
    box = ControlBox.around(surface)
    base = box.with_control_points(VENTRICLE.positions(box.rest.reshape(-1, 3), 0.2))
    s, t, u = (2 * box.local(box.rest.reshape(-1, 3)) - 1).T
    zero = np.zeros_like(s)
    axes = box.edges / np.linalg.norm(box.edges, axis=1, keepdims=True)
    fields = [[s, zero, zero], [zero, zero, u**3], [u**2, zero, zero], [s * u, t * u, zero]]
    drawn = [sigma * np.stack(field, axis=1) @ axes for sigma, field in zip((6, 5, 4, 3), fields)]

    def model(amounts):
        moved = sum(amount * one for amount, one in zip(amounts, drawn)).reshape(base.control_points.shape)
        return DeformableModel({"endo": surface}, base.with_control_points(base.control_points + moved), "LPS", "mm")

    rng = np.random.default_rng(8)
    amounts = rng.normal(size=(subjects, len(drawn)))
    shapes = [model(each) for each in amounts]

    def angles(found):
        ends = [found.shapes.transform([model(h * np.eye(4)[k]) for h in (0.1, -0.1)]) for k in range(len(drawn))]
        truth = np.array([one[0] - one[1] for one in ends])
        return np.degrees(subspace_angles(truth.T, found.components[: len(drawn)].T))

    def explained(found, given):
        known = np.column_stack([amounts[: len(given)], np.ones(len(given))])
        scores = found.scores(given)[:, : len(drawn)]
        left = scores - known @ np.linalg.lstsq(known, scores, rcond=None)[0]
        return 1 - (left**2).sum(axis=0) / ((scores - scores.mean(axis=0)) ** 2).sum(axis=0)

    def turned(shape, seed):
        turn, shift = Rotation.random(random_state=seed).as_matrix(), 50 * np.random.default_rng(seed).normal(size=3)
        moved = {name: one.rotated(turn).transformed(1, shift) for name, one in shape.surfaces.items()}
        return DeformableModel(moved, shape.box.rotated(turn).transformed(1, shift), "LPS", "mm")

    points = [shape.mesh(resolution=8).vertices for shape in shapes[: subjects // 2]]
    clouds = [{"endo": each + 0.3 * rng.normal(size=each.shape)} for each in points]
    for name, given in (
        ("models as they lie", shapes),
        ("models turned and moved anyhow", [turned(shape, seed) for seed, shape in enumerate(shapes)]),
        ("points with 0.3 mm noise, fitted", clouds),
    ):
        found = shape_modes(given)
        print(f"{name}: {len(given)} shapes, {len(drawn)} modes drawn;", end=" ")
        print(f"principal angles {', '.join(f'{angle:.2f}' for angle in angles(found)[::-1])} degrees;", end=" ")
        print(f"{100 * found.variance_ratios[: len(drawn)].sum():.2f} % of the variance in as many modes,", end=" ")
        print(f"95 % in {found.modes_for(0.95)};", end=" ")
        print(
            f"of the scores the drawn amounts explain {', '.join(f'{share:.3f}' for share in explained(found, given))}"
        )


def cost(folder, subjects):
    """CPU seconds from the slope between one subject and several, so that starting does not count; bytes of files."""
    manifest = make(folder / "cost", subjects, 400, frames=50, surfaces=("endo", "epi"))
    first = manifest.with_name("first.csv")
    first.write_text("".join(manifest.read_text(encoding="utf-8").splitlines(True)[:2]), encoding="utf-8")
    options, home = ("box=5,5,5",), manifest.parent
    spent = []
    for name, given in (("one", first), ("out", manifest)):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(given, home / name, "--processes", "1", options=options)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    each = (spent[1] - spent[0]) / (subjects - 1)
    sizes = Counter()
    for path in (home / "out").rglob("*"):
        if path.is_file():
            own = "subjects" in path.parts
            sizes[path.name if own else path.relative_to(home / "out").parts[0]] += path.stat().st_size / subjects
    print(f"50 frames of two walls, 400 points each: {each:.1f} CPU seconds a subject, {each / 50:.2f} s a frame")
    for name in ("model.json", "record.json", "parameters.zarr", "metrics"):
        print(f"{name}: {sizes[name] / 1024:.1f} KiB a subject, {1e5 * sizes[name] / 1e9:.2f} GB for 100,000")
    print(f"100,000 such: {1e5 * each / 3600:.0f} core hours")


PARTS = {
    "same": (same, 1000),
    "speedup": (speedup, 40),
    "overhead": (overhead, 200),
    "memory": (memory, 1000),
    "lists": (lists, 100_000),
    "modes": (modes, 100),
    "cost": (cost, 3),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="+", choices=list(PARTS))
    parser.add_argument("--subjects", type=int, help="how many instead of the usual number")
    parser.add_argument("--folder", type=Path, default=Path("out/cohort"), help="for clouds and results, some 100 MB")
    given = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    for name in given.parts:
        part, usual = PARTS[name]
        print(f"--- {name}")
        part(given.folder.absolute(), given.subjects or usual)


if __name__ == "__main__":
    main()
