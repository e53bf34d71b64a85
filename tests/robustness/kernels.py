"""The numerical tests under each OpenBLAS kernel: python kernels.py [KERNEL ...] (`make kernels`).

Another kernel rounds otherwise, as another processor does. Each runs in a process of its own, in which threadpoolctl
confirms that NumPy and SciPy really use it, and a kernel that the processor has not is skipped with the reason. A few
fits are compared between all kernels at the end. Exits with 1 where a test failed or fits differ.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
NAMES = {"Prescott": ("Prescott", "Katmai")}
"""What threadpoolctl calls a kernel; that of Prescott serves a family of processors, and the oldest gives the name."""
KERNELS = ("Prescott", "Haswell", "SkylakeX")
FLAGS = {"Prescott": ("pni",), "Haswell": ("avx2", "fma"), "SkylakeX": ("avx512f", "avx512dq", "avx512bw", "avx512vl")}
NOT_IN_USE = 77
"""Exit code of a process that found another kernel."""
SAME = 1e-6
"""Surfaces of fits differ between kernels by less than this, in RMS radii, or carry a warning."""
TESTS = (
    "fitting/test_evidence.py",
    "fitting/test_undetermined.py",
    "fitting/test_start.py",
    "fitting/test_start_axes.py",
    "fitting/test_regularity.py",
    "fitting/test_superquadric_fit.py",
    "fitting/test_ties.py",
    "fitting/test_robust_superquadric.py",
    "motion/test_cycle.py",
    "paper/test_to_the_letter.py",
    "properties/test_costs.py",
    "robustness/test_bad_inputs.py",
    "shapes/test_certificate.py",
    "shapes/test_closest.py",
    "shapes/test_control_box.py",
    "shapes/test_splines.py",
)


def missing(kernel: str) -> str | None:
    """Why the processor cannot run a kernel, by the flags that Linux lists; None where nothing is known against it."""
    listed = Path("/proc/cpuinfo")
    words = set(listed.read_text(encoding="ascii", errors="replace").split()) if listed.exists() else set()
    lacking = [flag for flag in FLAGS.get(kernel, ()) if words and flag not in words]
    return f"the processor has no {', '.join(lacking)}" if lacking else None


def in_use() -> list[str]:
    """The kernels of NumPy's and SciPy's BLAS in this process; none where they are not OpenBLAS."""
    import scipy.linalg  # noqa: F401 - loads its library
    from threadpoolctl import threadpool_info

    return [str(entry.get("architecture")) for entry in threadpool_info() if entry["internal_api"] == "openblas"]


def clouds() -> dict[str, Callable[[], np.ndarray]]:
    """Point sets whose fits once depended on the kernel, or are likely to."""
    from clouds_made import noisy_egg
    from shapes_made import even_directions, made

    sphere, grid = even_directions(300), np.mgrid[-8:9, -8:9, -8:9].reshape(3, -1).T.astype(float)
    return {
        "egg": lambda: noisy_egg(400),
        "whole numbers": lambda: np.round(made(semi_axes=(5.0, 8.0, 12.0)).surface(sphere)),
        "flat": lambda: made(semi_axes=(3.0, 2.0, 1e-3)).surface(sphere),
        "copies": lambda: np.repeat(made(semi_axes=(5.0, 8.0, 12.0)).surface(sphere), 2, axis=0),
        "two planes": lambda: np.vstack([sphere * [1, 1, 0.01] + [0, 0, z] for z in (-0.2, 0.2)]),
        "edges": lambda: made(exponents=(0.1, 0.1)).surface(sphere),
        "planes without noise": lambda: np.vstack([sphere * [1, 1, 0] + [0, 0, z] for z in (-0.2, 0.2)]),
        "cube of voxels": lambda: grid[np.abs(grid).max(axis=1) == 4],
        "cube of six voxels": lambda: grid[np.abs(grid - 0.5).max(axis=1) == 2.5],
        "cube of ten voxels": lambda: grid[np.abs(grid - 0.5).max(axis=1) == 4.5],
        "prism of voxels": lambda: grid[(np.abs(grid - 0.5) / [2.5, 2.5, 1.5]).max(axis=1) == 1],
        "ball of voxels": lambda: grid[np.abs(np.linalg.norm(grid, axis=1) - 6.6) < 0.4],
    }


def fitted(target: Path) -> None:
    """Fit all clouds and keep the surfaces, with a row of zeros behind those of fits with warnings."""
    import quadriform as qf

    found = {}
    for name, cloud in clouds().items():
        fit = qf.fit(cloud())
        vertices = fit.model.mesh(resolution=8).vertices
        found[name] = np.vstack([vertices, np.zeros(3)]) if fit.warnings else vertices
    np.savez(target, **found)


def inside(kernel: str, target: Path) -> int:
    """What the process of one kernel does."""
    found = in_use()
    if len(found) < 2 or not set(found) <= set(NAMES.get(kernel, (kernel,))):
        print(f"NumPy and SciPy use {found or 'no OpenBLAS'}")
        return NOT_IN_USE
    import pytest

    print(f"NumPy and SciPy use {found}", flush=True)
    code = pytest.main(["-q", "-p", "no:cacheprovider", *(str(ROOT / "tests" / test) for test in TESTS)])
    if code == 0:
        fitted(target)
    return int(code)


def differing(folder: Path, kernels: list[str]) -> list[str]:
    """Sentences about fits that differ between two kernels although they carry no warning."""
    first = np.load(folder / f"{kernels[0]}.npz")
    texts = []
    for kernel in kernels[1:]:
        other = np.load(folder / f"{kernel}.npz")
        for name in first:
            one, two = first[name], other[name]
            warned = not (one[-1].any() and two[-1].any())
            scale = np.sqrt(one.var(axis=0).sum())
            if not warned and np.abs(one - two).max() > SAME * scale:
                texts.append(f"{name}: {kernels[0]} and {kernel} differ by {np.abs(one - two).max() / scale:.1e} r")
    return texts


def started(kernel: str, folder: Path) -> "subprocess.Popen[str]":
    """The process of one kernel; what it prints goes to a file."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    command = [sys.executable, __file__, "--inside", kernel, str(folder / f"{kernel}.npz")]
    with open(folder / f"{kernel}.txt", "w", encoding="utf-8") as out:
        environment = os.environ | threads | {"OPENBLAS_CORETYPE": kernel}
        return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=out, stderr=subprocess.STDOUT, text=True)


def main(kernels: tuple[str, ...]) -> int:
    """Run all kernels, as many at once as there are cores, and print what became of each."""
    passed, failed, waiting = list[str](), list[str](), list(kernels)
    running: dict[str, subprocess.Popen[str]] = {}
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as ending:
        folder = Path(name)
        ending.callback(lambda: [process.terminate() for process in running.values()])
        while waiting or running:
            while waiting and len(running) < (os.cpu_count() or 1):
                kernel = waiting.pop(0)
                if reason := missing(kernel):
                    print(f"{kernel}: skipped, {reason}", flush=True)
                else:
                    running[kernel] = started(kernel, folder)
            time.sleep(0.2)
            for kernel in [k for k, process in running.items() if process.poll() is not None]:
                code = running.pop(kernel).returncode
                said = (folder / f"{kernel}.txt").read_text(encoding="utf-8").strip()
                if code == NOT_IN_USE:
                    print(f"{kernel}: skipped, {said}", flush=True)
                    continue
                print(f"{kernel}: {'passed' if code == 0 else f'FAILED ({code})'}\n{said}\n", flush=True)
                (passed if code == 0 else failed).append(kernel)
        texts = differing(folder, passed) if len(passed) > 1 else []
    print("\n".join(texts) or f"the fits of {', '.join(passed) or 'no kernel'} agree to {SAME:g} r")
    return int(bool(failed or texts))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--inside"]:
        raise SystemExit(inside(sys.argv[2], Path(sys.argv[3])))
    raise SystemExit(main(tuple(sys.argv[1:]) or KERNELS))
