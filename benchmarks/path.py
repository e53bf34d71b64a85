"""Prints the modules whose functions take all points during one `qf.fit`, from the entry point to the result.

python benchmarks/path.py counts them for both methods: steps of the fit, and geometry (quadriform.shapes).

A module counts when one of its functions is called with an array of the shape of the points. Fewer modules make the
path of the data easier to follow.
"""

import sys
from pathlib import Path

import numpy as np

import quadriform as qf

SOURCE = Path(qf.__file__).parent


def modules(points: np.ndarray, method: str) -> list[str]:
    """Modules, in order of their first call, whose functions take the points (n, 3) or an array of their shape."""
    found: dict[str, None] = {}

    def on_call(frame, event, _):
        if event != "call" or not frame.f_code.co_filename.startswith(str(SOURCE)):
            return
        names = frame.f_code.co_varnames[: frame.f_code.co_argcount + frame.f_code.co_kwonlyargcount]
        values = [frame.f_locals.get(name) for name in names]
        if any(isinstance(value, np.ndarray) and value.shape == points.shape for value in values):
            found.setdefault(str(Path(frame.f_code.co_filename).relative_to(SOURCE).with_suffix("")))

    sys.setprofile(on_call)
    try:
        qf.fit(points, method=method)
    finally:
        sys.setprofile(None)
    return list(found)


def main() -> None:
    """Print the modules of both methods for a noisy superellipsoid."""
    points = qf.Superquadric("ellipsoid", (30, 20, 15), (0.8, 1.2)).grid(20)[0]
    points = points + np.random.default_rng(0).normal(0, 0.3, points.shape)
    for method in ("tangent", "paper"):
        path = modules(points, method)
        geometry = sum(module.startswith("shapes/") for module in path)
        print(f"{method}: {len(path)} modules, {geometry} of them geometry", *path, sep="\n  ")


if __name__ == "__main__":
    main()
