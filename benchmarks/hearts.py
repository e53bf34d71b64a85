"""From images of real hearts to fitted surfaces: volumes, ejection fractions, and one surface from two file formats.

python benchmarks/hearts.py

Defaults unless a column says otherwise. On isosurfaces the points are not independent, and the strength of the evidence
is too weak; fixed strengths stand beside it. Volumes are cut at the outer faces of the slices that have labels, for
nobody has drawn the ventricle beyond them.
"""

from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from blood_pool import blood_pool
from common import SHARED, rms, table

import quadriform as qf
from quadriform.heart.volumes import volume
from quadriform.imaging.reading import read_volume
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.ventricle import VentriclePoints, ventricle_from_labels, ventricle_from_perfusion
from quadriform.imaging.volume import Region, Volume
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.model import DeformableModel

DATA = SHARED / "data"
BLOOD, MUSCLE = Labels((1,)), Labels((2,))
Strength = float | str

PIG = DATA / "pig_cine_mri"
PIG_SLICES: Region = ((0, 154), (0, 149), (1, 14))
"""Those that are ventricle; above them are base and aortic root, below an apex that the image cuts."""
PIG_SEED, PIG_REGION = (78, 72, 9), ((35, 122), (35, 112), (1, 14))

SPECT = DATA / "spect_mpi"
SPECT_REGION: Region = ((17, 53), (12, 52), (10, 34))
SPECT_REGION_DICOM: Region = ((17, 53), (12, 52), (16, 40))
"""The same voxels: the slices run the other way."""

PATIENTS = {"N-02": 60, "HYP-38": 79, "HF-I-11": 13}
"""Sunnybrook's, and their ejection fractions in % by voxel count as the data set's notes have them."""
SPACINGS = (None, 4.0)
"""Spacing of the points, in mm: a voxel's longest side, 8, by default; half of it for small cavities."""


def between_slices(model: DeformableModel, image: Volume, first: int, last: int) -> float:
    """Volume of the cavity in ml between the outer faces of two slices, across k."""
    affine = image.world_from_voxel
    normal = np.cross(affine[:3, 0], affine[:3, 1])
    normal *= np.sign(normal @ affine[:3, 2]) / np.linalg.norm(normal)
    below, above = (BasePlane(affine[:3, 3] + k * affine[:3, 2], normal) for k in (first - 0.5, last + 0.5))
    return (volume(model, "endo", above) - volume(model, "endo", below)) / 1000


def counted(image: Volume, region: Region) -> float:
    """Volume of the cavity's voxels in a region, in ml."""
    return float((image.crop(region).values == 1).sum() * abs(np.linalg.det(image.world_from_voxel)) / 1000)


def shown(values: dict[str, np.ndarray]) -> str:
    """RMS of each surface's distances."""
    return " / ".join(f"{rms(distances):.2f}" for distances in values.values())


def off(model: DeformableModel, found: VentriclePoints) -> str:
    """RMS distance of all isosurface points of each surface."""
    return shown({name: model.distance(points, name) for name, points in found.unthinned.items()})


def between_surfaces(one: DeformableModel, other: DeformableModel) -> float:
    """Largest distance between the surfaces of two models, both ways."""
    pairs = ((one, other), (other, one))
    return max(np.abs(a.distance(b.mesh(name).vertices, name)).max() for a, b in pairs for name in one.surfaces)


def pig(frame_and_strength: tuple[int, Strength]) -> tuple:
    frame, strength = frame_and_strength
    labels = read_volume(PIG / "sax_lv_labels_crop_4d.nii.gz", frame)
    found = ventricle_from_labels(labels, cavity=BLOOD, wall=MUSCLE, region=PIG_SLICES)
    fit = qf.fit(found.clouds, base=found.base, strength=strength)
    voxels, fitted = counted(labels, PIG_SLICES), between_slices(fit.model, labels, 1, 13)
    return (
        *(frame, strength, f"{voxels:.1f}", f"{fitted:.1f}", f"{100 * (fitted / voxels - 1):+.1f}"),
        *(shown(fit.residuals), f"{fit.strength:.1e}", f"{fit.model.min_jacobian():.3f}", len(fit.model.crossings())),
        ", ".join(fit.warnings) or "ok",
    )


def pig_blood() -> float:
    """Dice of the blood pool of grey frame 0 in slices 1 to 13 with the label."""
    grey = read_volume(PIG / "sax_cine_crop_4d.nii.gz", 0)
    label = read_volume(PIG / "sax_lv_labels_crop_4d.nii.gz", 0).crop(PIG_SLICES).values == 1
    found = blood_pool(grey, PIG_SEED, PIG_REGION)[:, :, 1:14]
    return float(2 * (found & label).sum() / (found.sum() + label.sum()))


def spect(study_and_strength: tuple[int, Strength]) -> tuple:
    study, strength = study_and_strength
    nifti = read_volume(SPECT / "nifti" / f"mpi_rest_{study}.nii.gz")
    all_dicom = (read_volume(file) for file in sorted((SPECT / "dicom").iterdir()))
    dicom = next(image for image in all_dicom if np.array_equal(image.values[:, :, ::-1], nifti.values))
    found = ventricle_from_perfusion(nifti, region=SPECT_REGION)
    other = ventricle_from_perfusion(dicom, region=SPECT_REGION_DICOM)
    fit, twin = (qf.fit(v.clouds, base=v.base, strength=strength) for v in (found, other))
    return (
        *(
            study,
            strength,
            off(fit.model, found),
            off(twin.model, other),
            f"{between_surfaces(fit.model, twin.model):.4f}",
        ),
        *(f"{fit.strength:.1e}", f"{fit.model.min_jacobian():.3f}", len(fit.model.crossings())),
        ", ".join(fit.warnings | twin.warnings) or "ok",
        ", ".join(found.warnings | other.warnings) or "ok",
    )


def sunnybrook(job: tuple[str, float | None, Strength]) -> tuple:
    patient, spacing, strength = job
    voxels, fitted, closed, strengths, warnings = [], [], [], [], dict[str, str]()
    for phase in ("ED", "ES"):
        labels = read_volume(DATA / "sunnybrook" / f"SC-{patient}_{phase}_endo.nii.gz")
        found = ventricle_from_labels(labels, cavity=BLOOD, spacing=spacing)
        fit = qf.fit(found.clouds, base=found.base, strength=strength)
        last = labels.values.shape[2]
        voxels.append(counted(labels, ((0, 256), (0, 256), (0, last))))
        fitted.append(between_slices(fit.model, labels, 0, last - 1))
        closed.append(fit.model.volume() / 1000)
        strengths.append(fit.strength)
        warnings |= fit.warnings
    fractions = [100 * (1 - es / ed) for ed, es in (voxels, fitted, closed)]
    return (
        *(patient, "8, default" if spacing is None else spacing, strength, *(f"{value:.1f}" for value in fractions)),
        *(f"{fractions[1] - fractions[0]:+.1f}", PATIENTS[patient]),
        " ".join(f"{a:.1f} ({b:.1f})" for a, b in zip(fitted, voxels)),
        " ".join(f"{value:.1e}" for value in strengths),
        ", ".join(warnings) or "ok",
    )


def pig_tables(pool: ProcessPoolExecutor) -> None:
    print("## Pig, cavity in slices 1 to 13, both surfaces in one box from their labels, ml (required 3 %)\n")
    header = ("frame", "strength", "voxels", "fitted", "error %", "RMS endo / epi mm")
    header += ("strength used", "bound of det J", "crossings", "warnings")
    table(header, pool.map(pig, product(range(20), ("auto", 1e-6))))
    print(f"\nDice of the blood pool of grey frame 0 with the label: {pig_blood():.3f} (required 0.85)\n")


def spect_table(pool: ProcessPoolExecutor) -> None:
    print("## SPECT at 4 mm, RMS of isosurface points endo / epi, mm (required 1), and both formats' surfaces\n")
    header = ("study", "strength", "from NIfTI", "from DICOM", "largest distance of the two mm (required 0.01)")
    header += ("strength used", "bound of det J", "crossings", "warnings of the fits", "of the images")
    table(header, pool.map(spect, product((1, 2, 3), ("auto", 1e-6, 3e-7, 1e-7))))


def sunnybrook_table(pool: ProcessPoolExecutor) -> None:
    print("\n## Sunnybrook, ejection fraction in %, cut at the stack (required within 3 points)\n")
    header = ("patient", "spacing mm", "strength", "by voxels", "fitted", "closed surface", "difference", "notes")
    header += ("ED, ES ml (by voxels)", "strengths used", "warnings")
    table(header, pool.map(sunnybrook, product(PATIENTS, SPACINGS, ("auto", 1e-6))))


def main() -> None:
    if not DATA.is_dir():
        print("skipped: the folder of real data is not beside this repository")
        return
    with ProcessPoolExecutor(2) as pool:
        pig_tables(pool)
        spect_table(pool)
        sunnybrook_table(pool)


if __name__ == "__main__":
    main()
