"""Fits in a worker process of each kind and in threads at once: prints whether each is the serial one, and how near.

A program of its own (`python -O at_once.py COUNT`), for spawned workers must import it. Its name hides it from pytest.
"""

import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np

import quadriform as qf


def cloud(seed):
    u = np.random.default_rng(seed).normal(size=(100, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u * [3, 2, 4] + 0.1 * np.sin(3 * u[:, [1, 2, 0]])


def fitted(seed):
    return qf.fit(cloud(seed), box=(2, 2, 2)).model.box.control_points


def report(name, found, wanted):
    same = all(one.tobytes() == other.tobytes() for one, other in zip(found, wanted, strict=True))
    near = max(float(np.abs(one - other).max()) for one, other in zip(found, wanted, strict=True))
    print(name, same, f"{near:.1e}")


if __name__ == "__main__":
    seeds = range(1, 1 + int(sys.argv[1]))
    wanted = [fitted(seed) for seed in seeds]
    for way in ("spawn", "fork"):
        with ProcessPoolExecutor(1, multiprocessing.get_context(way)) as pool:
            report(way, list(pool.map(fitted, seeds[:1])), wanted[:1])
    with ThreadPoolExecutor(len(seeds)) as pool:
        report("threads", list(pool.map(fitted, seeds)), wanted)
    print("matplotlib", "matplotlib" in sys.modules)
    print(wanted[0].tobytes().hex())
