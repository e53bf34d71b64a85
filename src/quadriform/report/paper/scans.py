"""Images, and the points that the paper's chain takes from them: threshold, largest component, closing, isosurface."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from quadriform.errors import InputError
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.imaging.image_points import ImagePoints, points_from_image
from quadriform.imaging.object_choice import Select
from quadriform.imaging.reading import example_volume, read_volume
from quadriform.imaging.segmentation import Mask
from quadriform.imaging.thinning import thinned
from quadriform.imaging.ventricle import HALF
from quadriform.imaging.volume import Region, Volume
from quadriform.report.paper.remake import text
from quadriform.report.paper.subjects import SYNTHETIC, Box, Subject, Walls, fitted, walls
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.voxels import voxels_inside

SPECT_FILE = "spect_mpi/nifti/mpi_rest_{}.nii.gz"
PIG_LABELS, PIG_IMAGE = "pig_cine_mri/sax_lv_labels_crop_4d.nii.gz", "pig_cine_mri/sax_cine_crop_4d.nii.gz"
HUMAN_FILE = "human_lv_guidepoints/frames/GPFile_000.txt"
NEEDED = (SPECT_FILE.format(1), SPECT_FILE.format(2), PIG_LABELS, PIG_IMAGE, HUMAN_FILE)
"""Files of a folder of real hearts."""

EXACT = "Both walls of this shape were made by one box of 5 x 5 x 5 control points; those of a real heart were not."
COARSER = 4
"""So many voxels along each axis become one in the coarse brain, which then has as many points as the paper's SPECT."""
CAVITY_LABEL = 1
SCANNER = ((98, 100, 110), 0.926)
"""Voxels and their side in mm of the paper's third image, by the Dynamic Spatial Reconstructor (p. 47)."""
BRIGHTNESS = (40.0, 90.0, 200.0)
"""Background, muscle and blood with its contrast agent."""


@dataclass(frozen=True)
class Chain:
    """Choices of the paper's chain for one image (section 5).

    Attributes:
        select: the threshold.
        threshold_text: the threshold in words.
        region: half-open ranges of voxels around the heart; None is the whole image.
        closing: as many dilations as erosions.
        connectivity: 26, or 6 where a thin bridge joins the object to something else.
    """

    select: Select
    threshold_text: str
    region: Region | None = None
    closing: int = 0
    connectivity: Literal[6, 26] = 26

    def points(self, image: Volume) -> ImagePoints:
        """Points of the isosurface; where the image or the region cuts the object, a lid closes it."""
        return points_from_image(
            image,
            select=self.select,
            region=self.region,
            connectivity=self.connectivity,
            closing=self.closing,
            border="close",
        )

    @property
    def steps(self) -> str:
        """The chain in words."""
        where = "" if self.region is None else " in a region around the heart"
        s = "" if self.closing == 1 else "s"
        closing = f"closing by {self.closing} dilation{s} and {self.closing} erosion{s}"
        component = f"largest component of {self.connectivity} neighbours"
        return f"threshold {self.threshold_text}{where}, {component}, {closing}, isosurface"


WHOLE_BRAIN = Chain("otsu", "of Otsu", closing=2)
COARSE_BRAIN = Chain("otsu", "of Otsu", closing=1)
SPECT_WALL = Chain(HALF, "half of the 99.9th percentile", ((17, 53), (12, 52), (10, 34)), closing=8)
"""The closing fills the cavity, so that the isosurface is the epicardium."""
PIG_REGION: Region = ((40, 118), (38, 112), (2, 10))
PIG_CAVITY = Chain(60.0, "60", PIG_REGION, closing=2, connectivity=6)
"""The cavity touches the region at its first and last slice only, where lids close it."""


@dataclass(frozen=True)
class Scan:
    """A subject that comes from an image.

    Attributes:
        subject: its points and fits.
        volume: the image.
        outline: the isosurface, in the world.
        steps: how the points came out of the image, in words.
        caps: (n,) bool, points of lids that close the object where its image cuts it: no data.
        real: whether it is a heart of the folder of real data.
        overlap: Dice overlap with labels made by hand, where there are any; the points do not depend on them.
    """

    subject: Subject
    volume: Volume
    outline: Mesh
    steps: str
    caps: Mask
    real: bool = False
    overlap: float | None = None


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


def _scan(image: Volume, chain: Chain, name: str, source: str, box: Box, **more: Any) -> tuple[Scan, ImagePoints]:
    found = chain.points(image)
    subject = fitted(name, source, found.points, box)
    return Scan(subject, image, found.mesh, chain.steps, found.on_border, **more), found


def brain(box: Box) -> Scan:
    """The brain that comes with nibabel: a slab that its image cuts above and below."""
    return _scan(example_volume(), WHOLE_BRAIN, "brain", text("sources", "brain"), box)[0]


def coarse_brain(box: Box) -> Scan:
    """The brain at a quarter of its resolution."""
    image = example_volume()
    # a rest that fills no block is left out
    sizes = [size // COARSER for size in image.values.shape]
    values = image.values[tuple(slice(0, COARSER * size) for size in sizes)].astype(np.float64)
    shape = [count for size in sizes for count in (size, COARSER)]
    affine = image.world_from_voxel.copy()
    # the centre of a coarse voxel is that of the block, not of its first voxel
    affine[:3, 3] += affine[:3, :3] @ np.full(3, (COARSER - 1) / 2)
    affine[:3, :3] *= COARSER
    coarse = replace(image, values=values.reshape(shape).mean(axis=(1, 3, 5)), world_from_voxel=affine)
    return _scan(coarse, COARSE_BRAIN, "coarse brain", text("sources", "brain"), box)[0]


def scanner_image() -> Volume:
    """The undeformed synthetic ventricle as the paper's scanner shows one: bright blood, dark muscle, blur, noise."""
    from scipy.ndimage import gaussian_filter

    shape, side = SCANNER
    model = SyntheticVentricle().model(0.0)
    # the centre of the heart is that of the image, whose first voxel is half its size away
    corner = model.mesh("epi").vertices.mean(axis=0) - side * (np.array(shape) - 1) / 2
    affine = np.diag([side, side, side, 1.0])
    affine[:3, 3] = corner
    volume = Volume(np.full(shape, BRIGHTNESS[0]), affine)
    # the outer wall first: the cavity is filled over it
    for name, value in zip(("epi", "endo"), BRIGHTNESS[1:]):
        mesh = model.mesh(name, 48)
        inside = voxels_inside(Mesh(volume.voxels(mesh.vertices), mesh.faces), shape)
        volume.values[inside] = value
    # noise of a reconstruction is correlated between neighbours, unlike that of a detector
    noise = np.random.default_rng(3).normal(0, 12.0, shape)
    return Volume(gaussian_filter(volume.values, 1.0) + gaussian_filter(noise, 0.7), affine)


def scanner(box: Box) -> Scan:
    """The cavity of a synthetic ventricle in an image of the paper's third kind."""
    return _scan(scanner_image(), _level("endo"), "synthetic scanner image", SYNTHETIC, box)[0]


def scanner_walls(box: Box) -> Walls:
    """Both walls of the same image, one point kept in each cube of 3 mm."""
    image = scanner_image()
    points = {name: thinned(_level(name).points(image).mesh.vertices, 3.0) for name in ("epi", "endo")}
    return walls("synthetic ventricle, both walls", SYNTHETIC, points, box, EXACT)


def _level(name: str) -> Chain:
    """The chain of one wall of the synthetic image: a threshold halfway between the tissues that it divides."""
    background, muscle, blood = BRIGHTNESS
    level = (background + muscle) / 2 if name == "epi" else (muscle + blood) / 2
    return Chain(level, f"{level:g}, halfway between the tissues", closing=1)


def spect(folder: Path, study: int, box: Box) -> Scan:
    """Epicardium of a perfusion image."""
    image = read_volume(folder / SPECT_FILE.format(study))
    return _scan(image, SPECT_WALL, f"SPECT image {study}", text("sources", "spect", study=study), box, real=True)[0]


def pig(folder: Path, box: Box) -> Scan:
    """Endocardium of a pig from the grey image; the labels serve for a comparison only."""
    image = read_volume(folder / PIG_IMAGE, 0)
    scan, found = _scan(image, PIG_CAVITY, "pig's ventricle", text("sources", "pig"), box, real=True)
    inside = tuple(slice(*pair) for pair in PIG_REGION)
    by_hand = read_volume(folder / PIG_LABELS, 0).values[inside] == CAVITY_LABEL
    mask = found.segmentation.mask[inside]
    return replace(scan, overlap=float(2 * (mask & by_hand).sum() / (mask.sum() + by_hand.sum())))


def human_walls(folder: Path, box: Box) -> Walls:
    """Both walls of a human ventricle from contours in a few planes."""
    from quadriform.files.guide_points import read_guide_points

    found = read_guide_points(folder / HUMAN_FILE)
    points = {name: found.surface(name)[0] for name in ("epi", "endo")}
    return walls("human ventricle", text("sources", "human"), points, box)
