"""Figs. 13 to 18: slices of images, with the segmentation and the models over them."""

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from quadriform.fitting.result import flat, rms
from quadriform.imaging.volume import Volume
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, Remake, Row, beside, listed, mm, shown
from quadriform.report.paper.scans import Scan
from quadriform.report.parts import image
from quadriform.report.slices import slice_pictures
from quadriform.shapes.mesh import Mesh

MARGIN = 3
"""Voxels around what is shown."""
SLICES = 12


def first_images(material: Material) -> Remake:
    """Fig. 13."""
    scans = (material.first, material.second)
    return Remake(
        "Fig. 13",
        "3D images of the left ventricle, SPECT",
        "p. 48",
        "cross sections of two SPECT images in order; volumes of 64 x 64 x 64 and of 64 x 64 x 21 voxels (p. 47).",
        [_slices(scan) for scan in scans],
        [_size(scan, stated) for scan, stated in zip(scans, ("64 x 64 x 64", "64 x 64 x 21"))],
        _which(scans, "the brain, fine and coarse"),
    )


def third_image(material: Material) -> Remake:
    """Fig. 14."""
    scan = material.third
    return Remake(
        "Fig. 14",
        "3D image of the left ventricle, in the paper by X-rays",
        "p. 48",
        "cross sections of an image by the Dynamic Spatial Reconstructor, a fast CT scanner: 98 x 100 x 110 voxels of "
        "0.926 mm (p. 47).",
        [_slices(scan)],
        [_size(scan, "98 x 100 x 110")],
        _which([scan], "a synthetic ventricle in an image of the paper's size, with blur and noise"),
    )


def _size(scan: Scan, stated: str) -> Row:
    return f"voxels, {scan.subject.name}", stated, *[_voxels(scan)] * 2


def _which(scans: Sequence[Scan], other: str) -> str:
    """The paper's own images were never published."""
    sizes = listed([f"{_voxels(scan)} voxels of {_spacing(scan)} mm" for scan in scans])
    instead = "of other hearts" if scans[0].real else f"of {other}, for no real data was given"
    return f"the paper's images are not public. These are {instead}: {sizes}."


def _voxels(scan: Scan) -> str:
    return " x ".join(map(str, scan.volume.values.shape))


def _spacing(scan: Scan) -> str:
    return " x ".join(f"{step:.3g}" for step in scan.volume.spacing)


def _slices(scan: Scan) -> Markup:
    tiles = _tiles(scan.volume, {})
    words = f"The {scan.subject.name}: {_voxels(scan)} voxels of {_spacing(scan)} mm; {len(tiles)} even cross sections "
    words += "of those that are not of one value."
    return shown(drawing.tiles(tiles, "small"), words, scan.subject.source)


def first_overlay(material: Material) -> Remake:
    """Fig. 15."""
    what = (
        "segmentation and representation of the epicardium for the SPECT MIBI image: top the isosurface superimposed "
    )
    what += "on the image, bottom the reconstruction by the model"
    return _overlaid("Fig. 15", "first image", "p. 49", what, material.first)


def second_overlay(material: Material) -> Remake:
    """Fig. 16."""
    what = "the same for the second SPECT image"
    return _overlaid("Fig. 16", "second image", "p. 49", what, material.second)


def segmentation(material: Material) -> Remake:
    """Fig. 17."""
    scan = material.third
    points = f"{len(scan.subject.cloud):,}"
    rows: list[Row] = [("points of the isosurface", "10,000", points, points)]
    verdict = f"the chain gives {points} points: {scan.steps}."
    if scan.overlap is not None:
        rows.append(
            (
                "Dice overlap in the region with the authors' labels, which the chain does not use",
                NONE,
                *[f"{scan.overlap:.2f}"] * 2,
            )
        )
        verdict += f" In the region the segmented cavity overlaps the labels by {scan.overlap:.2f} (Dice)."
    return Remake(
        "Fig. 17",
        "segmentation of the endocardium",
        "p. 49",
        "segmentation of the endocardium, the inner wall of the ventricle, in the scanner's image: threshold, largest "
        "connected component, an equal number of erosions and dilations, isosurface (p. 48).",
        [_overlay(scan, {"isosurface": (scan.outline, drawing.ORANGE)})],
        rows,
        verdict,
    )


def third_overlay(material: Material) -> Remake:
    """Fig. 18."""
    what = "reconstruction of the endocardium by the model, on the scanner's image"
    return _overlaid("Fig. 18", "third image", "p. 50", what, material.third)


def _overlay(scan: Scan, outlines: Mapping[str, tuple[Mesh, str]]) -> Markup:
    meshes = {name: mesh for name, (mesh, _) in outlines.items()}
    key = drawing.legend([(name, colour) for name, (_, colour) in outlines.items()])
    near = _around(scan.volume, [*meshes.values(), scan.outline])
    colours = [colour for _, colour in outlines.values()]
    words = f"The {scan.subject.name}, cross sections: {' and '.join(meshes)}."
    return shown(drawing.tiles(_tiles(near, meshes, colours), "small") + key, words, scan.subject.source)


def _tiles(volume: Volume, meshes: Mapping[str, Mesh], colours: list[str] | None = None) -> list[tuple[str, Markup]]:
    found = slice_pictures(volume.values, volume.world_from_voxel, meshes, SLICES, colours)
    return [(f"slice {k}", image(data, f"slice {k}")) for k, data in found.items()]


def _around(volume: Volume, meshes: list[Mesh]) -> Volume:
    """The image near some surfaces; all slices, for their numbers."""
    voxels = np.concatenate([volume.voxels(mesh.vertices) for mesh in meshes])
    low, high = np.floor(voxels.min(axis=0)) - MARGIN, np.ceil(voxels.max(axis=0)) + MARGIN + 1
    size = volume.values.shape
    (i0, j0, _), (i1, j1, _) = np.clip([low, high], 0, size).astype(int).tolist()
    return volume.crop(((i0, i1), (j0, j1), (0, size[2])))


def _overlaid(name: str, which: str, page: str, what: str, scan: Scan) -> Remake:
    paper, default = (fit.rms for fit in scan.subject.fits)
    models = {
        'model, method="paper"': (scan.subject.paper.model.mesh(resolution=40), drawing.BY_PAPER),
        "model, default": (scan.subject.default.model.mesh(resolution=40), drawing.BY_DEFAULT),
    }
    return Remake(
        name,
        f"segmentation and model, {which}",
        page,
        f"{what}; 5 x 5 x 5 control points, 11 parameters, 30 iterations (p. 48). Agreement is shown, not measured.",
        [_overlay(scan, {"isosurface": (scan.outline, drawing.ORANGE)}), _overlay(scan, models)],
        _rows(scan),
        f"the points are {mm(paper)} RMS from the paper's model and {mm(default)} from the default's; the error of the "
        f"latter is {beside(default, paper)}. The points: {scan.steps}. {scan.subject.note}",
    )


def _rows(scan: Scan) -> list[Row]:
    name, fits = scan.subject.name, scan.subject.fits
    rows: list[Row] = [(f"error RMS, {name}", NONE, *(mm(fit.rms) for fit in fits))]
    if scan.caps.any():
        measured = (mm(rms(flat(fit.residuals)[~scan.caps])) for fit in fits)
        rows.append((f"the same without the lids where the image or its region ends, {name}", NONE, *measured))
    rows.append((f"iterations, {name}", "30", *(str(fit.iterations) for fit in fits)))
    return [*rows, (f"warnings, {name}", NONE, *(", ".join(fit.warnings) or "none" for fit in fits))]
