"""Masks of smooth bodies with a known surface (bench/voxels), read from a NIfTI file as a user's are."""

from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import numpy as np

import quadriform as qf
from generalisation.rows import (
    Benchmark,
    Case,
    Row,
    Strength,
    bench_module,
    column,
    count_folds,
    errors,
    fraction_within,
    largest,
    mean,
    needs,
    percent_ok,
    status_text,
)

BODIES = 40
REQUIRED = {"cine": 0.28, "thick": 0.50, "spect": 0.21, "ct": 0.06}
TRUTH_POINTS = 10
"""One of so many vertices of the truth is compared with the uncertainty."""
RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def benchmarks(shared: Path, limit: int | None) -> list[Benchmark]:
    """One benchmark for each spacing of the voxels."""
    needs("igl")
    bench = bench_module(shared, "voxels", "make_masks")
    row = partial(_row, _masks_of(bench), bench)
    result = []
    for kind, rms in REQUIRED.items():
        cases = [(kind, k) for k in range(BODIES)[:limit]]
        required = f"{rms:.2f} mm, 95 % ok"
        result.append(Benchmark(f"voxels {kind}", "RMS mm", cases, row, _figure, required))
    return result


def _masks_of(bench: ModuleType):
    """Bodies and masks by kind and number; the ladder of strengths asks for the same one again."""

    @lru_cache(maxsize=1)
    def made(kind: str, k: int):
        truth = bench.body(k)
        return truth, *bench.mask(truth, bench.SPACINGS[kind], seed=k)

    return made


def _row(masks, bench: ModuleType, case: Case, strength: Strength) -> Row:
    truth, mask, affine = masks(*case)
    fit = fit_of_mask(mask, affine, strength)
    mesh = fit.model.mesh(resolution=48)
    rms, p95, most = bench.error(mesh.vertices, mesh.faces, truth)
    accepted = 2 * _noise(affine) + 0.01 * np.cbrt(0.75 * truth.volume / np.pi)
    numbers = {"95 %": p95, "largest": most, "within 2 sigma %": fraction_within(fit, truth.vertices[::TRUTH_POINTS])}
    status = status_text(fit.status, fit.warnings)
    return Row(rms, status, fit.model.min_jacobian(), rms <= accepted, numbers)


def fit_of_mask(mask: np.ndarray, affine: np.ndarray, strength: Strength) -> qf.Fit:
    """The fit of a mask by way of a file, so that the reader's knowledge of the voxels reaches it."""
    import nibabel

    with TemporaryDirectory() as folder:
        file = Path(folder) / "mask.nii.gz"
        image = nibabel.Nifti1Image(mask, RAS_FROM_LPS @ affine)
        image.header.set_xyzt_units("mm")
        nibabel.save(image, file)
        return qf.fit(file, strength=strength)


def _noise(affine: np.ndarray) -> float:
    """Standard deviation of vertices along the normal, of all directions: errors are uniform along the edges."""
    return float(np.sqrt((affine[:3, :3] ** 2).sum() / 36))


def _figure(rows: Sequence[Row]) -> str:
    found = errors(rows)
    within = mean(column(rows, "within 2 sigma %"))
    return (
        f"{mean(found):.3f} mm, worst {largest(found):.2f}, {percent_ok(rows):.0f} % ok, "
        f"{within:.0f} % within 2 sigma, {count_folds(rows)}"
    )
