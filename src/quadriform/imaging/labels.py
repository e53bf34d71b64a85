"""Surfaces of the heart from label images: the label conventions of public data sets, by name.

The endocardium encloses the cavity; the epicardium encloses the cavity and the wall, and not the right ventricle. An
image is checked against the convention before it is used.
"""

from dataclasses import dataclass

import numpy as np

from quadriform.errors import MaskError, OptionError, choose
from quadriform.imaging.object_choice import Labels
from quadriform.imaging.segments import LISTED
from quadriform.imaging.volume import Volume
from quadriform.imaging.voxel_faces import BACKGROUND, CAVITY, ENCLOSED, WALL, enclosed_fraction
from quadriform.words import first_of


@dataclass(frozen=True)
class Convention:
    """Labels of the parts of a heart in one data set.

    Attributes:
        cavity: of the left ventricle.
        myocardium: of the left ventricle.
        rv: cavity of the right ventricle; it may be missing from an image.
        only: whether images of the data set have no other labels.
    """

    cavity: int | str
    myocardium: int | str
    rv: int | str
    only: bool = True


@dataclass(frozen=True)
class Preset:
    """A surface by the convention of a data set.

    Attributes:
        data_set: one of PRESETS.
        surface: "endo", "epi" or "rv".
    """

    data_set: str
    surface: str


NAMES = Convention("heart_ventricle_left", "heart_myocardium", "heart_ventricle_right", only=False)
"""TotalSegmentator's names, which its files of several labels have in their headers."""
_LV_1 = (Convention(1, 2, 3),)
PRESETS: dict[str, tuple[Convention, ...]] = {
    "acdc": (Convention(3, 2, 1),),
    "ukbb": _LV_1,
    "mnms": _LV_1,
    "totalsegmentator": (Convention(3, 1, 5, only=False), Convention(46, 44, 48, only=False)),
}
"""Name of a data set -> its conventions. TotalSegmentator has one for its task heartchambers_highres, and one for the
task total of its first version; total of the second version has the heart as one label."""
SURFACES = ("endo", "epi", "rv")


def parse_surface(text: str) -> tuple[str, Labels | Preset]:
    """Return the name of a surface, and its labels or the data set whose convention they follow.

    Args:
        text: of the command line: `endo=label:1`, `epi=label:1+2`, `endo=label:NAME`, `endo=preset:acdc`.

    Raises:
        OptionError: another form, or a preset that has no such surface.
    """
    name, _, rule = text.partition("=")
    kind, _, value = rule.partition(":")
    if name and kind == "label":
        words = [word.strip() for word in value.split("+")]
        if all(word.isdecimal() for word in words):
            return name, Labels(tuple(int(word) for word in words))
        if any(letter.isalpha() for letter in value):
            return name, Labels((value.strip(),))
    if name and kind == "preset":
        return name, Preset(choose(value, tuple(PRESETS), "preset"), choose(name, SURFACES, "surface"))
    raise OptionError(
        f"surface {text!r}: expected name=label:1, name=label:1+2, name=label:NAME of a segment, or "
        f"name=preset:{'|'.join(PRESETS)}"
    )


def preset_labels(volume: Volume, preset: Preset) -> Labels:
    """Return the labels of a surface by the convention of a data set, when the image follows it.

    The image must have these labels, and no others where the data set has none; and the cavity must be enclosed by the
    wall, more than the right ventricle is.

    Raises:
        MaskError: the image follows none of the data set's conventions, or several.
    """
    known = PRESETS[choose(preset.data_set, tuple(PRESETS), "preset")]
    if preset.data_set == "totalsegmentator" and volume.segments:
        known = (NAMES,)
    faults = {convention: _convention_fault(volume, convention) for convention in known}
    valid = [convention for convention, fault in faults.items() if not fault]
    if len(valid) != 1:
        why = "; ".join(f"cavity {one.cavity}, myocardium {one.myocardium}: {fault}" for one, fault in faults.items())
        raise MaskError(
            f"the image does not follow the preset {preset.data_set!r}: {why or 'several of its numberings fit'}; name "
            "the labels with label:..."
        )
    one = valid[0]
    enclosed = {"endo": (one.cavity,), "epi": (one.cavity, one.myocardium), "rv": (one.rv,)}
    return Labels(enclosed[choose(preset.surface, SURFACES, "surface")])


def _convention_fault(volume: Volume, convention: Convention) -> str:
    """A sentence with what in an image contradicts a convention; empty where nothing does."""
    present = set(np.unique(volume.values).tolist()) - {0}  # 0 is the background
    try:
        cavity, myocardium = (volume.label_values((label,)) for label in (convention.cavity, convention.myocardium))
    except OptionError as error:
        return str(error)
    rv = volume.label_values((convention.rv,)) if _has(volume, convention.rv) else ()
    if not (present & set(cavity) and present & set(myocardium)):
        return f"one of them has no voxels; labels in the image: {_listed(present)}"
    if convention.only and (others := present - {*cavity, *myocardium, *rv}):
        return f"the image has other labels too: {_listed(others)}"
    # two data sets may have the same numbers for other parts: the cavity of the left ventricle is inside its wall
    left, right = (_enclosed_by(volume, part, myocardium) for part in (cavity, rv))
    if left < ENCLOSED or left <= right:
        beside = f", the right ventricle over {right:.0%}" if present & set(rv) else ""
        return f"the cavity meets the wall over {left:.0%} of its surface{beside}: it does not lie in the wall"
    return ""


def _has(volume: Volume, label: int | str) -> bool:
    return not isinstance(label, str) or any(segment.name == label for segment in volume.segments)


def _listed(labels: set[int]) -> str:
    return first_of([f"{label:g}" for label in sorted(labels)], LISTED)


def _enclosed_by(volume: Volume, part: tuple[int, ...], wall: tuple[int, ...]) -> float:
    """The fraction of the surface of a part that touches the wall; 0 where the part is empty."""
    inside = np.isin(volume.values, part)
    tissue = np.where(inside, CAVITY, np.where(np.isin(volume.values, wall), WALL, BACKGROUND)).astype(np.int8)
    return enclosed_fraction(tissue, volume.world_from_voxel)
