"""What the page shows: clouds and images, each fitted once by the paper's method and once by default."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from quadriform.errors import InputError
from quadriform.files.guide_points import read_guide_points
from quadriform.fitting.clouds import ALONE
from quadriform.fitting.fit import fit
from quadriform.fitting.outcome import Fit
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.isosurface import isosurface
from quadriform.imaging.reading import example_volume, read_volume
from quadriform.imaging.segmentation import Mask
from quadriform.imaging.selection import Labels
from quadriform.imaging.thinning import thinned
from quadriform.imaging.ventricle import HALF, ventricle_from_labels, ventricle_from_perfusion
from quadriform.imaging.volume import Region, Volume
from quadriform.points import Array
from quadriform.report.paper import clouds
from quadriform.shapes.mesh import Mesh

SYNTHETIC = "synthetic, made by quadriform (MIT)"
BRAIN = "human brain, example4d.nii.gz of nibabel (the nibabel authors; MIT)"
SPECT = (
    'PhysioNet, "Myocardial perfusion scintigraphy image database" 1.0.0, doi 10.13026/ce2z-dw74 (ODbL 1.0), '
    "rest 99mTc-MIBI study {}"
)
PIG = "cine MRI of a pig with the authors' labels, WrightGroupSRI/ep-dataset (CC0 1.0), frame 0"
HUMAN = "contours of a human ventricle in cine MRI, UOA-Heart-Mechanics-Research/biv-me (Apache-2.0), frame 0"

SPECT_FILE = "spect_mpi/nifti/mpi_rest_{}.nii.gz"
PIG_LABELS, PIG_IMAGE = "pig_cine_mri/sax_lv_labels_crop_4d.nii.gz", "pig_cine_mri/sax_cine_crop_4d.nii.gz"
HUMAN_FILE = "human_lv_guidepoints/frames/GPFile_000.txt"
NEEDED = (SPECT_FILE.format(1), SPECT_FILE.format(2), PIG_LABELS, PIG_IMAGE, HUMAN_FILE)
"""What a folder of real hearts has in it."""

SPECT_REGION: Region = ((17, 53), (12, 52), (10, 34))
PIG_SLICES: Region = ((0, 154), (0, 149), (1, 14))
"""Those that are ventricle."""
BLOOD, MUSCLE = Labels((1,)), Labels((2,))
TOLD = "The default was told the plane of the open base, which the paper's method cannot be."
EASY = "The shape is one that a box of 5 x 5 x 5 holds exactly; no real heart's is."
COARSER = 4
"""So many voxels along each axis become one in the coarse brain, which then has as many points as the paper's SPECT."""


def check_hearts(folder: Path) -> None:
    """Refuse a folder without the real data that the page needs; call it before the work.

    Raises:
        InputError: no such folder, or files are missing.
    """
    if not folder.is_dir():
        raise InputError(f"{str(folder)!r}: there is no such folder of real data")
    missing = [name for name in NEEDED if not (folder / name).is_file()]
    if missing:
        raise InputError(f"{str(folder)!r}: {len(missing)} of {len(NEEDED)} files are missing: {', '.join(missing)}")


@dataclass(frozen=True)
class Subject:
    """Points and their fits.

    Attributes:
        name: what it is, in a few words.
        source: data, author and licence, for under its pictures.
        points: (n, 3) in mm by surface; a single one is called "surface".
        paper: the fit with method="paper".
        default: the fit with all defaults.
        surface: the one that pictures show.
        note: what has to be known to compare the fits fairly; a sentence, or nothing.
    """

    name: str
    source: str
    points: Mapping[str, Array]
    paper: Fit
    default: Fit
    surface: str = ALONE
    note: str = ""

    @property
    def cloud(self) -> Array:
        """The points (n, 3) that pictures show."""
        return self.points[self.surface]

    @property
    def fits(self) -> tuple[Fit, Fit]:
        """By the paper's method, and by default."""
        return self.paper, self.default


def fitted(
    name: str,
    source: str,
    points: Mapping[str, Array] | Array,
    surface: str = ALONE,
    note: str = "",
    **options: object,
) -> Subject:
    """A subject with both fits; the options are for the default one."""
    named = points if isinstance(points, Mapping) else {surface: points}
    return Subject(name, source, named, fit(named, method="paper"), fit(named, **options), surface, note)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Scan:
    """A subject that comes from an image.

    Attributes:
        subject: its points and fits.
        volume: the image.
        outlines: the segmented surfaces by name, in the world.
        vertices: how many points the isosurface of each surface has, before any thinning.
        steps: how the points came out of the image, in a sentence.
        caps: (n,) bool, points that close the object where its image cuts it, which nobody measured.
    """

    subject: Subject
    volume: Volume
    outlines: Mapping[str, Mesh]
    vertices: Mapping[str, int]
    steps: str
    caps: Mask | None = None


@dataclass(frozen=True)
class Reduced:
    """A cloud, and what is left of it.

    Attributes:
        whole: the complete data.
        planes: points near three orthogonal planes.
        part: an even subsample.
    """

    whole: Subject
    planes: Subject
    part: Subject


def crossing() -> Subject:
    """The paper's synthetic example."""
    return fitted("three crossing tapered superquadrics", SYNTHETIC, clouds.crossing())


def reduced_ventricle() -> Reduced:
    """A synthetic ventricle of the paper's 6,000 points, three planes of 600 and a subsample of 900 (p. 45)."""
    points = clouds.noisy(clouds.ventricle())
    whole = fitted("synthetic ventricle", SYNTHETIC, points)
    return Reduced(
        whole,
        fitted("three planes", SYNTHETIC, clouds.three_planes(points)),
        fitted("even subsample", SYNTHETIC, clouds.subsample(points)),
    )


def brain() -> Scan:
    """The brain that comes with nibabel: a slab that its image cuts above and below, closed there on purpose."""
    return _whole(example_volume(), "brain", "Otsu's threshold, largest component, closing by 2, isosurface", 2)


def coarse_brain() -> Scan:
    """The same at a quarter of its resolution."""
    image = example_volume()
    sizes = [size // COARSER for size in image.values.shape]
    values = image.values[tuple(slice(0, COARSER * size) for size in sizes)].astype(np.float64)
    shape = [count for size in sizes for count in (size, COARSER)]
    affine = image.world_from_voxel.copy()
    affine[:3, 3] += affine[:3, :3] @ np.full(3, (COARSER - 1) / 2)
    affine[:3, :3] *= COARSER
    coarse = replace(image, values=values.reshape(shape).mean(axis=(1, 3, 5)), world_from_voxel=affine)
    return _whole(coarse, "coarse brain", "Otsu's threshold, largest component, isosurface", 0)


def _whole(image: Volume, name: str, steps: str, closing: int) -> Scan:
    found = points_from_image(image, select="otsu", closing=closing, border="close")
    subject = fitted(name, BRAIN, found.points)
    return Scan(subject, image, {"isosurface": found.mesh}, {ALONE: len(found.points)}, steps, found.on_border)


def scanner() -> Scan:
    """A synthetic ventricle in an image of the paper's third kind, both walls in one box."""
    image = clouds.scanner_image()
    background, muscle, blood = clouds.BRIGHTNESS
    levels = {"epi": (background + muscle) / 2, "endo": (muscle + blood) / 2}
    meshes = {name: points_from_image(image, select=level, closing=1).mesh for name, level in levels.items()}
    points = {name: thinned(mesh.vertices, 1.5) for name, mesh in meshes.items()}
    subject = fitted("synthetic scanner image", SYNTHETIC, points, "endo", EASY)
    steps = "thresholds halfway, largest component, closing by 1, isosurface; one point kept in each cube of 1.5 mm"
    return Scan(subject, image, meshes, {name: len(mesh.vertices) for name, mesh in meshes.items()}, steps)


def spect(folder: Path, study: int) -> Scan:
    """Epicardium of a perfusion image."""
    image = read_volume(folder / SPECT_FILE.format(study))
    found = ventricle_from_perfusion(image, region=SPECT_REGION)
    points = found.isosurfaces["epi"]
    subject = fitted(f"SPECT image {study}", SPECT.format(study), points, note=TOLD, base=found.base)
    wall = points_from_image(image, select=HALF, region=SPECT_REGION, surface="grey").mesh
    steps = "half of the 99.9th percentile in a region, largest component, isosurface; the outer wall below the base"
    return Scan(subject, image, {"isosurface of the wall": wall}, {ALONE: len(points)}, steps)


def pig(folder: Path) -> Scan:
    """Both walls of a pig's ventricle in one box."""
    labels = read_volume(folder / PIG_LABELS, 0)
    image = read_volume(folder / PIG_IMAGE, 0)
    found = ventricle_from_labels(labels, cavity=BLOOD, wall=MUSCLE, region=PIG_SLICES)
    inner = labels.crop(PIG_SLICES)
    outlines = {
        name: isosurface(replace(inner, values=np.isin(inner.values, values))).mesh
        for name, values in (("epi", (1, 2)), ("endo", (1,)))
    }
    subject = fitted(
        "pig's ventricle", PIG, {name: found.clouds[name] for name in outlines}, "endo", TOLD, base=found.base
    )
    steps = f"labels, isosurface; one point kept in each cube of {found.record['apart']:.3g} mm"
    return Scan(subject, image, outlines, {name: len(found.isosurfaces[name]) for name in outlines}, steps)


def human(folder: Path) -> Subject:
    """Endocardium from real sparse data: contours in a few planes."""
    points = read_guide_points(folder / HUMAN_FILE).surface("endo")[0]
    return fitted("human ventricle", HUMAN, points)
