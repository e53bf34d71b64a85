"""Figs. 13 to 18: slices of images, with the segmentation and the models over them."""

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from quadriform.fitting.result import flat, rms
from quadriform.imaging.volume import Volume
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, Remake, Row, beside, in_mm, listed, mm, shown, text, warnings
from quadriform.report.paper.scans import Scan
from quadriform.report.parts import image, legend, tiles
from quadriform.report.slices import slice_pictures
from quadriform.shapes.mesh import Mesh

MARGIN = 3
"""Voxels around what is shown."""
SLICES = 12


def images(key: str, scans: Mapping[str, Scan]) -> Remake:
    """Figs. 13 and 14: scans by the voxels that the paper states; its own images were never published."""
    sizes = listed([f"{_voxels(scan)} voxels of {_spacing(scan)} mm" for scan in scans.values()])
    real = any(scan.real for scan in scans.values())
    instead = "of other hearts" if real else f"of {text(key, 'stand_in')}, for no real data was given"
    rows = [(f"voxels, {scan.subject.name}", stated, *[_voxels(scan)] * 2) for stated, scan in scans.items()]
    return Remake(key, {"instead": instead, "sizes": sizes}, [_slices(key, scan) for scan in scans.values()], rows)


def _voxels(scan: Scan) -> str:
    return " x ".join(map(str, scan.volume.values.shape))


def _spacing(scan: Scan) -> str:
    return " x ".join(f"{step:.3g}" for step in scan.volume.spacing)


def _slices(key: str, scan: Scan) -> Markup:
    pictures, subject = _tiles(scan.volume, []), scan.subject
    size = {"voxels": _voxels(scan), "spacing": _spacing(scan), "count": len(pictures)}
    return shown(key, tiles(pictures, "small"), subject.source, subject=subject.name, **size)


def segmentation(material: Material) -> Remake:
    """Fig. 17."""
    scan, label = material.third, "Dice overlap in the region with the authors' labels, which the chain does not use"
    points, overlap = f"{len(scan.subject.cloud):,}", ""
    rows: list[Row] = [("points of the isosurface", "10,000", points, points)]
    if scan.overlap is not None:
        rows.append((label, NONE, *[f"{scan.overlap:.2f}"] * 2))
        overlap = f" In the region the segmented cavity overlaps the labels by {scan.overlap:.2f} (Dice)."
    words: dict[str, object] = {"points": points, "steps": scan.steps, "overlap": overlap}
    return Remake("17", words, [_overlay(scan, {"isosurface": (scan.outline, drawing.ORANGE)})], rows)


def _overlay(scan: Scan, outlines: Mapping[str, tuple[Mesh, str]]) -> Markup:
    meshes, colours = zip(*outlines.values())
    pictures = _tiles(_around(scan.volume, [*meshes, scan.outline]), meshes, colours)
    words = {"subject": scan.subject.name, "outlines": " and ".join(outlines)}
    key = legend(zip(outlines, colours))
    return shown("overlay", tiles(pictures, "small") + key, scan.subject.source, **words)


def _tiles(volume: Volume, meshes: Sequence[Mesh], colours: Sequence[str] = ()) -> list[tuple[str, Markup]]:
    found = slice_pictures(volume.values, volume.world_from_voxel, meshes, SLICES, colours)
    return [(f"slice {k}", image(data, f"slice {k}")) for k, data in found.items()]


def _around(volume: Volume, meshes: list[Mesh]) -> Volume:
    """The image near some surfaces; all slices, for their numbers."""
    voxels = np.concatenate([volume.voxels(mesh.vertices) for mesh in meshes])
    low, high = np.floor(voxels.min(axis=0)) - MARGIN, np.ceil(voxels.max(axis=0)) + MARGIN + 1
    size = volume.values.shape
    (i0, j0, _), (i1, j1, _) = np.clip([low, high], 0, size).astype(int).tolist()
    return volume.crop(((i0, i1), (j0, j1), (0, size[2])))


def overlaid(key: str, scan: Scan) -> Remake:
    """Figs. 15, 16 and 18."""
    paper, default = scan.subject.fits
    models = {  # the dark colour first: the light one is drawn over it, thinner
        "model, default": (default.model.mesh(resolution=40), drawing.BY_DEFAULT),
        'model, method="paper"': (paper.model.mesh(resolution=40), drawing.BY_PAPER),
    }
    pictures = [_overlay(scan, {"isosurface": (scan.outline, drawing.ORANGE)}), _overlay(scan, models)]
    words: dict[str, object] = {
        "paper": mm(paper.rms),
        "default": mm(default.rms),
        "compared": beside(default.rms, paper.rms),
        "steps": scan.steps,
        "note": scan.subject.note,
    }
    return Remake(key, words, pictures, _rows(scan))


def _rows(scan: Scan) -> list[Row]:
    name, fits = scan.subject.name, scan.subject.fits
    rows = [in_mm(f"error RMS, {name}", [fit.rms for fit in fits])]
    if scan.caps.any():
        measured = [rms(flat(fit.residuals)[~scan.caps]) for fit in fits]
        rows.append(in_mm(f"the same without the lids where the image or its region ends, {name}", measured))
    rows.append((f"iterations, {name}", "30", *(str(fit.iterations) for fit in fits)))
    return [*rows, warnings(name, fits)]
