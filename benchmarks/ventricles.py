"""25 frames of a beating human ventricle from contours: each surface alone, and both in one box.

python benchmarks/ventricles.py
"""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from common import SHARED, rms, table
from scipy.spatial import cKDTree

import quadriform as qf

FOLDER = SHARED / "data" / "human_lv_guidepoints"
SOURCE = "Contours and reference surfaces: UOA-Heart-Mechanics-Research/biv-me, Apache-2.0."


def contours(frame: int) -> dict[str, np.ndarray]:
    """Endo- and epicardial points (n, 3) of a frame, LPS mm."""
    lines = (FOLDER / "frames" / f"GPFile_{frame:03d}.txt").read_text().splitlines()[1:]
    fields = [line.split("\t") for line in lines if line.strip()]
    return {
        name: np.array([f[:3] for f in fields if f"LV_{name.upper()}CARDIAL" in f[3]], dtype=float)
        for name in ("endo", "epi")
    }


def reference_rms(frame: int) -> float:
    """RMS distance of the endocardial points to the reference surface of a frame."""
    import trimesh

    mesh = trimesh.load(FOLDER / "reference" / f"patient1_LV_ENDOCARDIAL_{frame:03d}.obj", process=False)
    samples = trimesh.sample.sample_surface(mesh, 200_000, seed=0)[0]
    return rms(cKDTree(samples).query(contours(frame)["endo"])[0])


def alone(frame: int) -> tuple:
    row: list[object] = [frame]
    for points in contours(frame).values():
        fit = qf.fit(points)
        longest = fit.model.superquadric().semi_axes.max() / np.ptp(points, axis=0).max()
        row += [len(points), f"{fit.rms:.2f}", f"{longest:.2f}", ", ".join(fit.warnings) or "ok"]
    return tuple(row)


def together(frame: int) -> tuple:
    fit = qf.fit(contours(frame))
    errors = {name: rms(values) for name, values in fit.residuals.items()}
    bound, crossing = fit.model.min_jacobian(), len(fit.model.crossings())
    return (frame, f"{errors['endo']:.2f}", f"{errors['epi']:.2f}", f"{bound:.3f}", crossing, f"{fit.strength:.1e}")


def main() -> None:
    if not Path(FOLDER).is_dir():
        print("skipped: the contours of the human ventricle are not beside this repository")
        return
    frames = range(25)
    with ProcessPoolExecutor(2) as pool:
        print(f"## Human ventricle, each surface alone, 386 parameters. {SOURCE}\n")
        header = ("frame", "endo points", "RMS mm", "longest semi-axis / extent", "status")
        table((*header, "epi points", *header[2:]), pool.map(alone, frames))
        print("\n## Against the reference surfaces, RMS to the endocardial points, mm (required 0.75)\n")
        table(("frame", "ours", "reference", "ratio"), against_reference())
        print("\n## Both surfaces in one box, 397 parameters (required: bound above 0, no crossing)\n")
        table(("frame", "endo RMS", "epi RMS", "bound of det J", "crossings", "strength"), pool.map(together, frames))


def against_reference() -> Iterator[tuple]:
    for frame in (0, 9):
        ours, reference = qf.fit(contours(frame)["endo"]).rms, reference_rms(frame)
        yield frame, f"{ours:.3f}", f"{reference:.3f}", f"{ours / reference:.2f}"


if __name__ == "__main__":
    main()
