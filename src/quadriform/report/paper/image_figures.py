"""Figs. 13 to 18: slices of images, with the segmentation and the models over them."""

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from quadriform.fitting.outcome import flat, rms
from quadriform.imaging.volume import Volume
from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, Remake, Row, beside, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import Scan
from quadriform.report.parts import image
from quadriform.report.slices import slices_png
from quadriform.shapes.mesh import Mesh

STAND_IN = " Without real data this page has a stand-in: {}."
COLUMNS = 6
MARGIN = 3
"""Voxels around what is shown."""


def first_images(results: Results) -> Remake:
    """Fig. 13."""
    scans = _distinct(results.brain, results.first, results.second)
    return Remake(
        "Fig. 13",
        "slices of SPECT images",
        "p. 48",
        "slices of two SPECT images, of 64 x 64 x 64 and of 64 x 64 x 21 voxels (p. 47).",
        [_slices(scan) for scan in scans],
        [],
        _which(results, "the brain, fine and coarse"),
    )


def third_image(results: Results) -> Remake:
    """Fig. 14."""
    return Remake(
        "Fig. 14",
        "slices of a scanner's image",
        "p. 48",
        "slices of an image of 98 x 100 x 110 voxels of 0.926 mm by the Dynamic Spatial Reconstructor.",
        [_slices(results.third)],
        [],
        _which(results, "a synthetic ventricle in an image of the same size, with blur and noise"),
    )


def _distinct(*scans: Scan) -> list[Scan]:
    return list({id(scan): scan for scan in scans}.values())


def _which(results: Results, stand_in: str) -> str:
    """The paper's own images were never published."""
    text = "the paper's images are not public."
    return text + (" These are other hearts." if results.real else STAND_IN.format(stand_in))


def _slices(scan: Scan) -> Markup:
    volume, name = scan.volume, scan.subject.name
    sizes = " x ".join(map(str, volume.values.shape))
    words = f"The {name}: {sizes} voxels of {' x '.join(f'{step:.3g}' for step in volume.spacing)} mm."
    return shown(drawing.grey_picture(_montage(volume), words), words, scan.subject.source)


def _montage(volume: Volume) -> Figure:
    """Twelve even slices along the third axis."""
    shape, steps = volume.values.shape, volume.spacing
    levels = np.unique(np.linspace(0, shape[2] - 1, 14).round().astype(int)[1:-1])
    rows = -(-len(levels) // COLUMNS)
    figure = Figure(figsize=(11, 11 / COLUMNS * rows * shape[1] * steps[1] / (shape[0] * steps[0])))
    low, high = np.percentile(volume.values, [1, 99.5])
    for place, k in enumerate(levels):
        axes = figure.add_subplot(rows, COLUMNS, place + 1)
        grey = volume.values[:, :, k].T
        axes.imshow(grey, cmap="gray", origin="lower", vmin=low, vmax=high, aspect=steps[1] / steps[0])
        axes.set_axis_off()
    figure.subplots_adjust(0, 0, 1, 1, 0.02, 0.02)
    return figure


def first_overlay(results: Results) -> Remake:
    """Fig. 15."""
    what = "the epicardium of the first SPECT image: segmented surface above, model below"
    return _overlaid("Fig. 15", "first image", "p. 49", what, _distinct(results.brain, results.first))


def second_overlay(results: Results) -> Remake:
    """Fig. 16."""
    what = "the same for the coarser SPECT image"
    return _overlaid("Fig. 16", "second image", "p. 49", what, [results.second])


def segmentation(results: Results) -> Remake:
    """Fig. 17."""
    scan = results.third
    near, words = _around(scan.volume, scan.outlines), f"The {scan.subject.name}: the segmented surfaces over slices."
    picture = image(slices_png(near.values, near.world_from_voxel, scan.outlines, "", 8), words)
    return Remake(
        "Fig. 17",
        "segmentation of the cavity",
        "p. 49",
        "the segmented endocardium over slices of the scanner's image.",
        [shown(picture, words, scan.subject.source)],
        [],
        f"made by: {scan.steps}.",
    )


def third_overlay(results: Results) -> Remake:
    """Fig. 18."""
    what = "the model of the endocardium over slices of the scanner's image"
    return _overlaid("Fig. 18", "third image", "p. 50", what, [results.third])


def _overlay(scan: Scan) -> Markup:
    subject, name = scan.subject, scan.subject.surface
    outlines = scan.outlines if name not in scan.outlines else {f"isosurface, {name}": scan.outlines[name]}
    models = {'model, method="paper"': subject.paper, "model, default": subject.default}
    meshes = dict(outlines) | {key: fit.model.mesh(name, 40) for key, fit in models.items()}
    words = f"The {subject.name}: segmented surface and both models over slices."
    near = _around(scan.volume, meshes)
    data = slices_png(near.values, near.world_from_voxel, meshes, "", 8)
    return shown(image(data, words), words, subject.source)


def _around(volume: Volume, meshes: Mapping[str, Mesh]) -> Volume:
    """The image near some surfaces; all slices, for their numbers."""
    voxels = np.concatenate([volume.voxels(mesh.vertices) for mesh in meshes.values()])
    low, high = np.floor(voxels.min(axis=0)) - MARGIN, np.ceil(voxels.max(axis=0)) + MARGIN + 1
    size = volume.values.shape
    (i0, j0, _), (i1, j1, _) = np.clip([low, high], 0, size).astype(int).tolist()
    return volume.crop(((i0, i1), (j0, j1), (0, size[2])))


def _overlaid(name: str, which: str, page: str, what: str, scans: list[Scan]) -> Remake:
    """The last of the scans stands in the place of the paper's."""
    scan = scans[-1]
    paper, default = (fit.rms for fit in scan.subject.fits)
    return Remake(
        name,
        f"model over slices, {which}",
        page,
        f"{what}; 5 x 5 x 5 control points, 11 parameters, 30 iterations (p. 48). Agreement is shown, not measured.",
        [_overlay(each) for each in scans],
        [row for each in scans for row in _rows(each)],
        f"measured here: beside the error of the paper's method that of the default is {beside(default, paper)}. "
        f"The points: {scan.steps}. {scan.subject.note}",
    )


def _rows(scan: Scan) -> list[Row]:
    name, fits = scan.subject.name, scan.subject.fits
    rows: list[Row] = [(f"error RMS, {name}", NONE, *(mm(fit.rms) for fit in fits))]
    if scan.caps is not None:
        measured = (mm(rms(flat(fit.residuals)[~scan.caps])) for fit in fits)
        rows.append((f"the same without the lids where the image cuts the {name}", NONE, *measured))
    return [*rows, (f"iterations, {name}", "30", *(str(fit.iterations) for fit in fits))]
