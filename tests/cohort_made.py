"""Tiny cohorts on disk: clouds of ventricles of different sizes, and their list."""

import filecmp
from importlib.util import find_spec

import numpy as np
import pytest

from quadriform.heart.synthetic import SyntheticVentricle

TINY = {"box": (2, 2, 2), "robust": False, "strength": 1e-4}
"""The cheapest fit that is one."""


def needs(*libraries):
    """A mark that skips tests where a library is missing, without the seconds that importing them all takes."""
    missing = [name for name in libraries if find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason="the extra 'cohort' is not installed")


def listed(folder, subjects, frames=2, broken=(), points=80):
    """Write clouds and list; the last point of a broken subject is no number."""
    ventricle = SyntheticVentricle()
    exact = [ventricle.surface_points("endo", frame / 2, points) for frame in range(frames)]
    rows = ["id,input"]
    for number in range(subjects):
        rng = np.random.default_rng(number)
        home = folder / "clouds" / f"person{number:02d}"
        home.mkdir(parents=True)
        size = np.exp(0.1 * rng.normal(size=3))
        for frame, cloud in enumerate(exact):
            moved = cloud * size + 0.3 * rng.normal(size=cloud.shape)
            if number in broken and frame == frames - 1:
                moved[-1] = np.nan
            np.save(home / f"{frame}.npy", moved)
        rows.append(f"person{number:02d},clouds/person{number:02d}/*.npy")
    path = folder / "list.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def differences(one, other):
    """Files that one folder has and the other has not, or that differ in a byte."""
    names = [{path.relative_to(root) for path in root.rglob("*") if path.is_file()} for root in (one, other)]
    alike = {name for name in names[0] & names[1] if filecmp.cmp(one / name, other / name, shallow=False)}
    return sorted(map(str, (names[0] | names[1]) - alike))
