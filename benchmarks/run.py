"""All benchmarks of accuracy, one after the other; what is missing beside this repository is said and skipped."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import superquadrics
import surfaces
import ventricles


def main() -> None:
    for bench in (superquadrics, surfaces, ventricles):
        bench.main()
        print(flush=True)


if __name__ == "__main__":
    main()
