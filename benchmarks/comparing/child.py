"""Work in a process with its own memory and threads: python benchmarks/comparing/child.py JOB FILE OUT.

Peak memory is the rise of the process's resident high-water mark, which counts what NumPy, BLAS, compiled code and
Python's own allocator take, over a mark taken when the input is loaded, everything is imported and the same job was
done once on about 1,000 points. What is returned is taken off. The input is loaded from a .npy without temporaries, so
the mark starts at what is resident.
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()


def measure(job: str, points: Path, threads: int | None = None, model: Path | None = None) -> dict[str, float]:
    """Run a job in a new process.

    Args:
        job: a name of `JOBS`.
        points: a .npy of its input.
        threads: of BLAS and OpenMP; None: as the environment has it.
        model: where a fit's model is written.

    Returns:
        "seconds" and "cpu" of the job alone, and "beyond": MB beyond input and returned arrays.
    """
    chosen = {} if threads is None else dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(threads))
    command = [sys.executable, str(HERE), job, str(points), *([] if model is None else [str(model)])]
    done = subprocess.run(command, env=os.environ | chosen, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{job} of {points.name} failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def held(thing: Any) -> int:
    """Bytes of the arrays that a result holds."""
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, dict):
        return sum(map(held, thing.values()))
    if isinstance(thing, tuple | list):
        return sum(map(held, thing))
    return sum(held(getattr(thing, field.name)) for field in fields(thing)) if is_dataclass(thing) else 0


def fit_job(points: np.ndarray) -> Callable[[np.ndarray], Any]:
    import quadriform

    return quadriform.fit


def ffd_job(points: np.ndarray) -> Callable[[np.ndarray], Any]:
    from quadriform.heart.synthetic import SyntheticVentricle

    return SyntheticVentricle().model(0.5).box.deform


def splinepy_job(points: np.ndarray) -> Callable[[np.ndarray], Any]:
    sys.path.insert(0, str(HERE.parents[1]))
    from comparing.baselines import splinepy
    from quadriform.heart.synthetic import SyntheticVentricle

    return splinepy(SyntheticVentricle().model(0.5).box.control_points)


JOBS = {"fit": fit_job, "ffd": ffd_job, "splinepy": splinepy_job}


def high_water() -> float:
    """Largest resident size of this program so far, MB of 10^6 bytes.

    Linux' VmHWM; `ru_maxrss` there begins at that of the process that started this one, and would hide what we take.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024  # macOS counts bytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def main() -> None:
    points = np.load(sys.argv[2])
    job = JOBS[sys.argv[1]](points)
    job(points[:: max(1, len(points) // 1000)].copy())
    before, start, cpu = high_water(), time.perf_counter(), time.process_time()
    result = job(points)
    taken = {"seconds": time.perf_counter() - start, "cpu": time.process_time() - cpu}
    beyond = max(0.0, high_water() - before - held(result) / 1e6)
    if len(sys.argv) > 3:
        from quadriform.files import save

        save(result.model, sys.argv[3])
    print(json.dumps(taken | {"beyond": beyond}))


if __name__ == "__main__":
    main()
