"""1,800 superquadrics, 18 scenarios: failures and errors beside those of EMS (CVPR 2022).

python benchmarks/superquadrics.py [SEED] [CASES]
"""

import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from common import bench_data, table

import quadriform as qf

EMS = {
    "clean": (1.5e-5, 0),
    "noise2": (0.188, 0),
    "noise5": (0.619, 0),
    "outlier20": (0.090, 0),
    "outlier60": (0.094, 1),
    "partial60": (0.153, 5),
    "oneview": (0.294, 23),
    "sparse100": (0.284, 0),
    "sparse30": (0.766, 16),
    "sharp": (0.040, 0),
    "elongated": (0.101, 0),
    "equalaxes": (0.084, 0),
    "combined": (0.895, 10),
    "lv_dense": (0.274, 0),
    "lv_slices": (0.566, 0),
    "outlier150": (51.0, 100),
    "clutter": (9.6, 89),
    "needle": (0.402, 9),
}
"""Median error in % and failures of 100, as published with the benchmark data for its own seed."""


def score(case: tuple) -> tuple[float, bool]:
    """Error E, and whether the case failed, of one (points, truth)."""
    import sqgeom

    points, truth = case
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        s = qf.fit_superquadric(points).superquadric
    found = {"eps": s.exponents, "a": s.semi_axes, "R": s.rotation, "t": s.translation}
    result = sqgeom.score(truth, found)
    return result["E"], bool(result["E"] > 0.05 or result["iou"] < 0.85)


def rows(seed: int, cases: int) -> Iterator[tuple]:
    import make_cases

    failures = 0
    with ProcessPoolExecutor(2) as pool:
        for scenario in make_cases.SCEN:
            results = list(pool.map(score, make_cases.load(seed, scenario, cases), chunksize=5))
            errors, failed = np.array([e for e, _ in results]), sum(f for _, f in results)
            failures += failed
            median, lost = EMS[scenario]
            yield (
                scenario,
                f"{100 * np.median(errors):.3g}",
                f"{100 * np.quantile(errors, 0.9):.3g}",
                failed,
                median,
                lost,
            )
    yield "all", "", "", failures, "", 253


def main() -> None:
    if bench_data("superquadrics") is None:
        return
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 20240607
    cases = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    print(f"## Superquadrics, seed {seed}, {cases} cases each (EMS: seed 20240607, 100 cases)\n")
    table(("scenario", "median E %", "90 % E %", "failures", "EMS median %", "EMS failures"), rows(seed, cases))


if __name__ == "__main__":
    main()
