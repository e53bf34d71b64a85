"""Points of a ventricle from an image file: by labels of its parts, or by the bright wall of a perfusion image."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from quadriform.errors import OptionError, WarningKind
from quadriform.files.reading import named_in_errors
from quadriform.imaging.file_points import CONTENT, ReadOptions, Source, kind_of, with_stated_unit
from quadriform.imaging.image_points import slice_numbers
from quadriform.imaging.labels import Preset, parse_surface, preset_labels
from quadriform.imaging.object_choice import Labels
from quadriform.imaging.reading import frame_count, read_volume
from quadriform.imaging.ventricle import (
    HALF,
    PointAndDirection,
    VentriclePoints,
    labelled_tissue,
    ventricle_from_labels,
    ventricle_from_perfusion,
    ventricle_up_to,
)
from quadriform.imaging.volume import Volume
from quadriform.point_sets import PointSet
from quadriform.shapes.landmarks import Landmarks
from quadriform.words import listed

Rule = Labels | Preset


@dataclass(frozen=True)
class LabelledHeart:
    """Which labels of an image are the parts of a left ventricle.

    Attributes:
        endo: what the endocardium encloses, the cavity.
        epi: what the epicardium encloses, or the wall alone; None for the cavity alone.
    """

    endo: Rule
    epi: Rule | None = None
    option: ClassVar[str] = "--heart"
    goes_with: ClassVar[tuple[str, ...]] = ("--frame", "--region")
    # the base is where the image cuts the cavity
    noted: ClassVar[tuple[WarningKind, ...]] = (WarningKind.BORDER_CUT, WarningKind.ANISOTROPIC)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return ("endo",) if self.epi is None else ("endo", "epi")

    def points(self, volume: Volume, options: ReadOptions, base: PointAndDirection | None) -> VentriclePoints:
        """Return the points of both surfaces in an image.

        Raises:
            MaskError, DegenerateError, OptionError: labels are missing, or give no ventricle.
        """
        cavity, wall = self._parts(volume)
        region = options.segment.get("region")
        return ventricle_from_labels(volume, cavity=cavity, wall=wall, region=region, base=base)

    def points_of_frames(self, volumes: Sequence[Volume]) -> list[VentriclePoints]:
        """Return the points of all frames of one image, with the base at the end where most frames have it.

        Raises:
            MaskError, DegenerateError, OptionError: as `points`.
        """
        frames = [labelled_tissue(volume, *self._parts(volume), None) for volume in volumes]
        end, votes = Counter(frame.flat_end for frame in frames).most_common(1)[0]
        return [ventricle_up_to(frame, end if 2 * votes > len(volumes) else None) for frame in frames]

    def _parts(self, volume: Volume) -> tuple[Labels, Labels | None]:
        """The labels of the cavity and of the wall."""
        cavity = _labels(volume, self.endo)
        return Labels(cavity), None if self.epi is None else self._wall(cavity, _labels(volume, self.epi))

    def _wall(self, cavity: Sequence[int], enclosed: Sequence[int]) -> Labels:
        wall = tuple(label for label in enclosed if label not in cavity)
        if not wall:
            raise OptionError(
                f"option --heart: all labels of epi ({listed(enclosed)}) are labels of endo; expected those of the "
                "wall too, as in --heart endo=label:1 --heart epi=label:1+2"
            )
        return Labels(wall)


@dataclass(frozen=True)
class PerfusionHeart:
    """The bright wall of a left ventricle in a perfusion image, and the cavity inside it."""

    surfaces: ClassVar[tuple[str, ...]] = ("endo", "epi")
    option: ClassVar[str] = "--perfusion"
    goes_with: ClassVar[tuple[str, ...]] = ("--frame", "--region", "--threshold", "--seed")
    noted: ClassVar[tuple[WarningKind, ...]] = (WarningKind.OPEN_BASE, WarningKind.ANISOTROPIC)

    def points(self, volume: Volume, options: ReadOptions, base: PointAndDirection | None) -> VentriclePoints:
        """Return the points of both surfaces in an image.

        Raises:
            MaskError, OptionError: there is no wall, or it encloses no cavity.
        """
        threshold = options.select_above
        return ventricle_from_perfusion(
            volume,
            select=HALF if threshold is None else threshold,
            region=options.segment.get("region"),
            component=options.segment.get("component", "largest"),
            base=base,
        )


Heart = LabelledHeart | PerfusionHeart


@dataclass(frozen=True)
class VentricleSource:
    """Points of a ventricle from a file, and its base.

    Attributes:
        surfaces: name -> points of the surface.
        landmarks: the base, where there is one, and what it is.
    """

    surfaces: dict[str, Source]
    landmarks: Landmarks


def labelled_heart(texts: Sequence[str]) -> LabelledHeart:
    """Return which labels are the parts of a ventricle, from texts such as endo=label:1 and epi=label:1+2.

    Raises:
        OptionError: another form, another or a repeated name, or no cavity.
    """
    rules: dict[str, Rule] = {}
    for text in texts:
        name, rule = parse_surface(text)
        if name not in ("endo", "epi") or name in rules:
            raise OptionError(f"option --heart={text!r}: expected endo=... and, for the wall, epi=..., each once")
        rules[name] = rule
    if "endo" not in rules:
        raise OptionError("option --heart: epi without endo; expected the cavity too, as --heart endo=label:1")
    return LabelledHeart(**rules)


def check_image_options(heart: Heart, options: ReadOptions) -> None:
    """Refuse options that choose an object in an image in another manner.

    Raises:
        OptionError: naming both options.
    """
    given = [*options.of_images, *(["--columns"] if options.columns is not None else [])]
    for option in given:
        if option not in heart.goes_with:
            raise OptionError(f"options {heart.option} and {option} exclude each other; give one")


def read_ventricle(path: Path, heart: Heart, options: ReadOptions, base: PointAndDirection | None) -> VentricleSource:
    """Return the points of a ventricle from an image file.

    Args:
        path: of the image.
        heart: how its parts are found.
        options: frame, region, threshold and unit, where they are given.
        base: plane beyond which nothing is taken; None: as the image shows.

    Raises:
        OptionError: the file is no image.
        InputError, FileFormatError, FileLimitError, MaskError, DegenerateError: the image gives no ventricle.
    """
    _check_image(path, heart)
    with named_in_errors(path):
        volume = read_volume(path, options.frame, options.affine)
        found = heart.points(volume, options, base)
    return _source(path, volume, found, heart, options.unit)


def read_ventricle_frames(path: Path, heart: LabelledHeart, affine: str | None) -> list[VentricleSource]:
    """Return the points of a ventricle from each frame of a label image, in the order of time.

    Args:
        path: of the image.
        heart: which labels are its parts.
        affine: which transform of a NIfTI header.

    Raises:
        OptionError: the file is no image.
        InputError, FileFormatError, FileLimitError, MaskError, DegenerateError: the image gives no ventricle.
    """
    _check_image(path, heart)
    with named_in_errors(path):
        volumes = [read_volume(path, number, affine) for number in range(frame_count(path))]
        found = heart.points_of_frames(volumes)
    return [_source(path, volume, each, heart, None) for volume, each in zip(volumes, found)]


def _check_image(path: Path, heart: Heart) -> None:
    kind = kind_of(path)
    if kind in CONTENT or kind == "model":
        what = CONTENT.get(str(kind), "a model")
        raise OptionError(f"option {heart.option} goes with images, found the file of {what} {str(path)!r}")


def _source(path: Path, volume: Volume, found: VentriclePoints, heart: Heart, unit: str | None) -> VentricleSource:
    # with a base these are no defects of the fit, but what every stack of slices through a heart has
    noted = () if found.base is None else heart.noted
    warnings = {kind: text for kind, text in found.warnings.items() if kind not in noted}
    notes = tuple(f"{path}: {text}" for text in _notes(found, noted))
    noise, solids = found.noise or dict.fromkeys(found.clouds), {"endo": found.cavity}
    sources = {}
    for name, points in found.clouds.items():
        cloud = PointSet(points, noise=noise[name], solid=solids.get(name))
        source = Source(cloud, volume.space, volume.unit, warnings, notes, slice_numbers(volume, points), volume)
        sources[name] = with_stated_unit(source, unit, path)
    return VentricleSource(sources, found.landmarks)


def _notes(found: VentriclePoints, noted: Sequence[WarningKind]) -> list[str]:
    texts = [text for kind, text in found.warnings.items() if kind in noted]
    if left_out := found.record.get("left_out_voxels"):
        texts.append(f"{left_out} voxels of the cavity are apart from its largest component and left out")
    return texts


def _labels(volume: Volume, rule: Rule) -> tuple[int, ...]:
    chosen = preset_labels(volume, rule) if isinstance(rule, Preset) else rule
    return volume.label_values(chosen.values)
