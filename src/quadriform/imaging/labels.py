"""Which labels of a label image are which surface of the heart: the conventions of public data sets, by name.

The endocardium encloses the cavity; the epicardium encloses the cavity and the wall. To sum all labels, the right
ventricle's too, is the mistake that these names are to spare.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from quadriform.errors import InputError, MaskError, OptionError, choose
from quadriform.files.reading import PathLike, quoted
from quadriform.imaging.reading import read_volume
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.volume import Volume


def surface_labels(cavity: Iterable[int], myocardium: Iterable[int], rv: Iterable[int] = ()) -> dict[str, Labels]:
    """Labels of one's own: from a surface ("endo", "epi", and "rv" where it has labels) to what it encloses.

    Args:
        cavity: of the left ventricle, with the papillary muscles or without: as the labels are.
        myocardium: of the left ventricle.
        rv: cavity of the right ventricle.

    Raises:
        OptionError: no label for a part, or one label for two.
    """
    cavity, myocardium, rv = tuple(cavity), tuple(myocardium), tuple(rv)
    together = (*cavity, *myocardium, *rv)
    if not cavity or not myocardium or len(set(together)) < len(together):
        raise OptionError(
            f"labels cavity={cavity}, myocardium={myocardium}, rv={rv}: expected one or more for cavity and "
            "myocardium, and each label once"
        )
    surfaces = {"endo": Labels(cavity), "epi": Labels((*cavity, *myocardium))}
    return surfaces | ({"rv": Labels(rv)} if rv else {})


_LV_1 = surface_labels(cavity=(1,), myocardium=(2,), rv=(3,))

PRESETS: dict[str, dict[str, Labels]] = {
    "acdc": surface_labels(cavity=(3,), myocardium=(2,), rv=(1,)),
    "ukbb": _LV_1,
    "mnms": _LV_1,
    "totalsegmentator": _LV_1,
}
"""From the name of a data set to surfaces and their labels; totalsegmentator as `read_structures` numbers them."""

STRUCTURES = {"heart_ventricle_left": 1, "heart_myocardium": 2, "heart_ventricle_right": 3}
"""From TotalSegmentator's files, one a structure, to our labels."""


def parse_surface(text: str) -> tuple[str, Labels]:
    """Read what the terminal is told of a surface: `endo=label:1`, `epi=label:1+2` or `endo=preset:acdc`.

    Returns:
        The name of the surface, and its labels.

    Raises:
        OptionError: another form, or a preset that has no such surface.
    """
    name, _, rule = text.partition("=")
    kind, _, value = rule.partition(":")
    if name and kind == "label":
        words = [word.strip() for word in value.split("+")]
        if all(word.isdecimal() for word in words):
            return name, Labels(tuple(int(word) for word in words))
    if name and kind == "preset":
        surfaces = PRESETS[choose(value, tuple(PRESETS), "preset")]
        return name, surfaces[choose(name, tuple(surfaces), "surface")]
    raise OptionError(f"surface {text!r}: expected name=label:1, name=label:1+2 or name=preset:{'|'.join(PRESETS)}")


def read_structures(folder: PathLike) -> Volume:
    """Read TotalSegmentator's masks of the ventricles, a NIfTI file for each structure, as one label image.

    Args:
        folder: with heart_ventricle_left.nii.gz, heart_myocardium.nii.gz and, where there is one,
            heart_ventricle_right.nii.gz.

    Returns:
        Cavity 1, myocardium 2, right ventricle 3: the labels of the preset "totalsegmentator".

    Raises:
        InputError: a file is missing.
        MaskError: the files have different grids, a mask is empty, or two masks share voxels.
        QuadriformError: as `quadriform.imaging.reading.read_volume`.
    """
    files = {name: Path(folder) / f"{name}.nii.gz" for name in STRUCTURES}
    missing = [file.name for name, file in files.items() if not file.is_file()]
    if set(missing) - {"heart_ventricle_right.nii.gz"}:
        raise InputError(f"{quoted(folder)}: expected {', '.join(f.name for f in files.values())}; missing: {missing}")
    masks = {name: read_volume(file) for name, file in files.items() if file.is_file()}
    first = masks["heart_ventricle_left"]
    values = np.zeros(first.values.shape, dtype=np.uint8)
    for name, mask in masks.items():
        _check_mask(mask, first, files[name])
        inside = mask.values != 0
        if taken := int((values[inside] != 0).sum()):
            raise MaskError(f"{quoted(files[name])}: {taken} voxels are of another structure too; expected none")
        values[inside] = STRUCTURES[name]
    return Volume(values, first.world_from_voxel, first.space, first.unit, first.warnings)


def _check_mask(mask: Volume, first: Volume, file: Path) -> None:
    if mask.values.shape != first.values.shape:
        raise MaskError(
            f"{quoted(file)}: {mask.values.shape} voxels; expected {first.values.shape} as in the left ventricle's file"
        )
    apart = np.abs(mask.world_from_voxel - first.world_from_voxel)[:3] @ (*first.values.shape, 1)
    if apart.max() > 0.1 * first.spacing.min():
        raise MaskError(f"{quoted(file)}: lies {apart.max():.3g} mm off the left ventricle's grid; expected the same")
    if not mask.values.any():
        raise MaskError(f"{quoted(file)}: the mask is empty")
