"""From a file of any kind to points, with everything that was assumed on the way said."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.columns import MILLIMETRES, unit_of
from quadriform.errors import FileFormatError, InputError, OptionError, Warnings, choose
from quadriform.files.guide_points import is_guide_points
from quadriform.files.meshes import read_marks, read_mesh_or_points
from quadriform.files.points import read_point_set
from quadriform.files.reading import naming
from quadriform.files.save_and_load import content_of
from quadriform.fitting.diagnostics import precision_loss
from quadriform.imaging.formats import image_format, is_pair, pair_of
from quadriform.point_sets import PointSet
from quadriform.points import Array
from quadriform.shapes.mesh_points import mesh_points
from quadriform.shapes.spaces import turn_between
from quadriform.words import numbers, ranges

if TYPE_CHECKING:
    from quadriform.imaging.labels import Preset
    from quadriform.imaging.segmentation import Segmentation
    from quadriform.imaging.selection import Labels
    from quadriform.imaging.volume import Volume

SpaceAndUnit = tuple[str, str]
"""Frame of the world and unit, each maybe "unknown"."""

FOUND = {"mesh": "a mesh", "points": "points"}
OF_IMAGES = {"labels": "--label", "threshold": "--threshold", "frame": "--frame", "border": "--border"}
OF_SEGMENT = {"region": "--region", "component": "--seed", "closing": "--closing", "fill_holes": "--fill-holes"}
"""From arguments to the options of the command line, which choose an object in an image."""
PERCENTILE = re.compile(r"(?:(\d+(?:\.\d+)?)%)?p(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class ImageOptions:
    """How a file becomes points, above all an image; None leaves a choice to the file or to the library.

    Attributes:
        labels: values of a label image or names of segments, taken together.
        threshold: a value, "otsu", or (share, percentile).
        frame: of a four-dimensional image.
        segment: arguments for `segment` as they are: region, component, closing, fill_holes.
        border: "open" or "close".
        affine: which transform of a NIfTI header: "sform", "qform" or "pixdim".
        preset: a surface by the convention of a data set, which the image is checked against.
        columns: of a table or an array, as `read_points` takes them.
        unit: of the lengths of a file that names none: "mm", "m", "um" and so on.
    """

    labels: tuple[int | str, ...] | None = None
    threshold: float | str | tuple[float, float] | None = None
    frame: int | None = None
    segment: dict[str, Any] = field(default_factory=dict)
    border: str | None = None
    affine: str | None = None
    preset: "Preset | None" = None
    columns: str | None = None
    unit: str | None = None

    @classmethod
    def parse(
        cls,
        label: str | None,
        threshold: str | None,
        region: str | None,
        seed: str | None,
        closing: int | None,
        fill_holes: bool,
        border: str | None,
        frame: int | None,
        affine: str | None = None,
    ) -> "ImageOptions":
        """From the words on the command line.

        Raises:
            OptionError: a word that cannot be read, or a label and a threshold at once.
        """
        if label is not None and threshold is not None:
            raise OptionError("options --label and --threshold exclude each other; give one")
        segment: dict[str, Any] = {"fill_holes": fill_holes}
        if region is not None:
            segment["region"] = ranges(region, "--region")
        if seed is not None:
            segment["component"] = numbers(seed, 3, "--seed")
        if closing is not None:
            segment["closing"] = closing
        return cls(_labels(label), _threshold(threshold), frame, segment, border, affine)

    @property
    def of_images(self) -> list[str]:
        """Options that were given and mean nothing for points and meshes, as the command line calls them."""
        found = [option for name, option in OF_IMAGES.items() if getattr(self, name) is not None]
        return found + [option for name, option in OF_SEGMENT.items() if self.segment.get(name)]

    def with_label(self, label: str) -> "ImageOptions":
        """The same with other labels."""
        return replace(self, labels=_labels(label))

    def with_surface(self, rule: "Labels | Preset") -> "ImageOptions":
        """The same with the labels of a surface, or the preset that has them."""
        from quadriform.imaging.labels import Preset

        return replace(self, preset=rule) if isinstance(rule, Preset) else replace(self, labels=rule.values)


def _labels(text: str | None) -> tuple[int | str, ...] | None:
    """Numbers with commas between, or names; which name is meant is decided by the names in the image."""
    if text is None or not text.strip():
        return None if text is None else numbers(text, 1, "--label")
    if any(letter.isalpha() for letter in text):
        return (text,)
    return numbers(text, text.count(",") + 1, "--label")


def _threshold(text: str | None) -> float | str | tuple[float, float] | None:
    if text is None or text == "otsu":
        return text
    if found := PERCENTILE.fullmatch(text):
        return float(found[1] or 100) / 100, float(found[2])
    try:
        return float(text)
    except ValueError as error:
        raise OptionError(
            f"option --threshold={text!r}: expected a number, otsu, or a percentile as p99 or 50%p99.9"
        ) from error


@dataclass(frozen=True)
class Source:
    """Points and what is known about them.

    Attributes:
        points: (n, 3), in `unit` and `space`.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        warnings: of the reading.
        notes: what was assumed, one sentence each.
        slices: (n,) the slice of each point of an image, as `slice_numbers` counts them.
        image: from which the points came.
        normals: (n, 3) that a table or an array has, or None.
    """

    points: Array
    space: str = "unknown"
    unit: str = "unknown"
    warnings: Warnings = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    slices: NDArray[np.int64] | None = None
    image: "Volume | None" = None
    normals: Array | None = None

    @property
    def cloud(self) -> PointSet:
        """The points as `fit` takes them, with their normals."""
        return PointSet(self.points, self.normals)


def kind_of(path: Path) -> Literal["image", "mesh", "points", "model"] | None:
    """What a file is; None for others, and for a folder without DICOM files, which would make it an image.

    Images are told by their content, as `read_volume` tells them, other files as `content_of` tells them.
    """
    if image_format(path) is not None:
        return "image"
    return None if path.is_dir() else content_of(path)


def fits(path: Path) -> bool:
    """Whether `fit` and `track` read a file."""
    return kind_of(path) in ("image", "mesh", "points")


def files_of(path: Path) -> list[Path]:
    """The files that an input stands for: itself, both of a pair, or those of a folder, but hidden and empty ones."""
    if path.is_dir():
        inside = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
        return [file for file in inside if file.stat().st_size > 0]
    return list(pair_of(path)) if is_pair(path) and path.is_file() else [path]


def read_source(path: Path, options: ImageOptions) -> Source:
    """Read points from a table, an array, a mesh or an image; of a mesh with few vertices from its whole surface.

    Raises:
        InputError, FileFormatError, FileLimitError, DegenerateError: the file gives no points.
    """
    kind = kind_of(path)
    if kind in ("image", "mesh") and options.columns is not None:
        raise OptionError(f"option --columns goes with tables and arrays, found the {kind} {str(path)!r}")
    if kind in ("mesh", "points") and (given := options.of_images):
        raise OptionError(f"option {given[0]} goes with images, found the file of {FOUND[kind]} {str(path)!r}")
    if kind == "image":
        return _in_unit(_from_image(path, options), options.unit, path)
    if kind == "mesh":
        return _in_unit(_from_mesh(path), options.unit, path)
    if kind == "model":
        raise FileFormatError(f"{str(path)!r}: expected points, a mesh or an image, found a model")
    return _from_table(path, options)  # refuses unknown suffixes


def _from_mesh(path: Path) -> Source:
    mesh = read_mesh_or_points(path)
    points, note = mesh_points(mesh)
    if note is None:
        return Source(points, *read_marks(path))
    lost = precision_loss(mesh.vertices.tolist(), mesh.vertices)  # the points between them have all their digits
    return Source(points, *read_marks(path), lost, (f"{path}: {note}",))


def _from_table(path: Path, options: ImageOptions) -> Source:
    if options.columns is None and is_guide_points(path):
        raise InputError(
            f"{str(path)!r}: holds contours of several surfaces, not points of one; follow their frames by track, or "
            "take the points of each surface by read_guide_points in Python"
        )
    found = read_point_set(path, options.columns)
    found = _said_unit(found, options.unit, path).in_metric_unit()
    notes = tuple(f"{path}: {note}" for note in found.notes)
    warnings = precision_loss(found.number_type, found.points)
    return Source(found.points, unit=found.unit, warnings=warnings, notes=notes, normals=found.normals)


def _in_unit(source: Source, unit: str | None, path: Path) -> Source:
    """The points of an image or a mesh in the unit that was said, where it names none itself."""
    found = _said_unit(PointSet(source.points, unit=source.unit), unit, path)
    if found.unit not in ("mm", "m", "unknown"):
        raise OptionError(f"option --unit={unit!r}: of images and meshes expected mm or m")
    return replace(source, unit=found.unit)


def _said_unit(found: PointSet, unit: str | None, path: Path) -> PointSet:
    if unit is None:
        return found
    said = choose(unit_of(unit) or unit, tuple(MILLIMETRES), "--unit")
    if found.unit not in ("unknown", said):
        raise InputError(f"{str(path)!r}: option --unit={unit!r} contradicts the file, which has {found.unit}")
    return replace(found, unit=said)


def read_object(path: Path, options: ImageOptions) -> tuple["Volume", dict[str, Any], tuple[str, ...]]:
    """An image, the arguments that choose the object in it, and what was assumed."""
    from quadriform.imaging.reading import read_volume

    volume = read_volume(path, options.frame, options.affine)
    select, note = _select(volume, options)
    return volume, {"select": select, **options.segment}, note


def kept_note(segmentation: "Segmentation") -> tuple[str, ...]:
    """What is said when components of the object were left out."""
    found, kept = len(segmentation.component_voxels), segmentation.components_kept
    return (f"kept {kept} of {found} connected components; --seed chooses another",) if found > kept else ()


def space_and_unit_of(path: Path, columns: str | None = None) -> SpaceAndUnit:
    """Frame of the world and unit of a mesh; of a table or an array the unit in the names of its columns."""
    kind = kind_of(path)
    if kind == "mesh":
        return read_marks(path)
    return "unknown", read_point_set(path, columns).in_metric_unit().unit if kind == "points" else "unknown"


def space_to_write(asked: str | None, found: str) -> str:
    """The frame of the world to write in: the one that was asked for, else that of the input.

    Raises:
        InputError: one was asked for, and that of the input is unknown.
    """
    if asked is None:
        return found
    turn_between(found, asked)  # refuses
    return asked


def _from_image(path: Path, options: ImageOptions) -> Source:
    from quadriform.imaging.image_points import points_from_image
    from quadriform.imaging.slice_numbers import slice_numbers

    with naming(path):
        volume, arguments, notes = read_object(path, options)
        if options.border is not None:
            arguments["border"] = options.border
        found = points_from_image(volume, **arguments)
    notes = tuple(f"{path}: {note}" for note in notes + kept_note(found.segmentation))
    numbers = slice_numbers(volume, found.points)
    return Source(found.points, volume.space, volume.unit, found.warnings, notes, numbers, volume)


def _select(volume: "Volume", options: ImageOptions) -> tuple[Any, tuple[str, ...]]:
    """How the object is chosen, as `segment` takes it, and what was assumed where nothing was said."""
    from quadriform.imaging.labels import preset_labels
    from quadriform.imaging.object_choice import choose_object
    from quadriform.imaging.selection import Labels, Percentile

    if options.preset is not None:
        return preset_labels(volume, options.preset), ()
    if options.labels is not None:
        return Labels(options.labels), ()
    if isinstance(options.threshold, tuple):
        return Percentile(*options.threshold), ()
    if options.threshold is not None:
        return options.threshold, ()
    return choose_object(volume)
