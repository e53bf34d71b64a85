"""Fit every real data set beside this repository and write the table of errors, docs/real_data.md.

    python benchmarks/real_data.py [DATA]      DATA: the folder of real data, ../shared/data by default

Nothing is left out and nothing is tuned: each row is `quadriform.fit(points, noise=noise)` with default options, with
the noise that the reader of an image states.
"""

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import quadriform as qf
from quadriform.errors import QuadriformError
from quadriform.files import read_points
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.reading import example_volume, read_volume
from quadriform.imaging.segmentation import Labels, Percentile

HERE = Path(__file__).resolve().parents[1]
Case = tuple[str, str, np.ndarray, np.ndarray | None]
"""Name, unit, points (n, 3), and what is known of their noise."""


def brain() -> Iterator[Case]:
    found = points_from_image(example_volume(), select="otsu", closing=2, border="close")
    yield "brain", "mm", found.points, found.noise


def spect(data: Path) -> Iterator[Case]:
    region = ((17, 53), (12, 52), (10, 34))
    for path in sorted((data / "spect_mpi" / "nifti").glob("*.nii.gz")):
        volume = read_volume(path)
        found = points_from_image(volume, select=Percentile(0.5, 99.9), region=region)
        yield f"{path.name[:-7]}, isosurface", "mm", found.points, found.noise


def pig(data: Path) -> Iterator[Case]:
    for frame in (0, 11):
        labels = read_volume(data / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz", frame)
        for name, values in (("cavity", (1,)), ("cavity + myocardium", (1, 2))):
            found = points_from_image(labels, select=Labels(values))
            yield f"pig frame {frame}, {name}", "mm", found.points, found.noise


def sunnybrook(data: Path) -> Iterator[Case]:
    for path in sorted((data / "sunnybrook").glob("*_E[DS]_endo.nii.gz")):
        found = points_from_image(read_volume(path), select=Labels((1,)))
        yield path.name[:-7], "mm", found.points, found.noise


def meshes(data: Path) -> Iterator[Case]:
    for path in sorted((data / "organs").glob("*.ply")):
        yield path.stem, "mm", read_points(path), None
    for path in sorted((data / "objects").glob("*.ply")):
        yield path.stem, "mm" if path.stem.endswith("_mm") else "m", read_points(path), None


def contours(data: Path) -> Iterator[Case]:
    for path in sorted((data / "human_lv_guidepoints" / "frames").glob("GPFile_*.txt")):
        rows = [line.split("\t") for line in path.read_text().splitlines()[1:] if line.strip()]
        for surface in ("ENDO", "EPI"):
            chosen = [row[:3] for row in rows if f"LV_{surface}CARDIAL" in row[3]]
            yield f"human LV {path.stem[-3:]}, {surface.lower()}", "mm", np.array(chosen, dtype=float), None


def row(case: Case) -> str:
    name, unit, points, noise = case
    try:
        fit = qf.fit(points, noise=noise)
    except QuadriformError as error:
        return f"| {name} | {len(points):,} | | | | | refused | {type(error).__name__}: {error} |"
    to_mm = 1000 if unit == "m" else 1
    size = np.abs(np.asarray(fit.residuals)) * to_mm
    return (
        f"| {name} | {len(points):,} | {fit.superquadric_rms * to_mm:.2f} | {fit.rms * to_mm:.2f} "
        f"| {np.quantile(size, 0.95):.2f} | {size.max():.1f} | {fit.status} | {', '.join(fit.warnings)} |"
    )


def main() -> None:
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / "shared" / "data"
    cases = [brain()]
    if data.is_dir():
        cases += [make(data) for make in (spect, pig, sunnybrook, meshes, contours)]
    else:
        print(f"skipped all but the brain: there is no folder {data}")
    print("| data | points | superquadric RMS | RMS | 95 % | max | status | warnings |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    with ProcessPoolExecutor(2) as pool:
        for line in pool.map(row, (c for case in cases for c in case)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
