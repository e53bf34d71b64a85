"""Points from a file of any kind, with notes of what was assumed, and the input files of a model for its record."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.columns import MILLIMETRES, unit_of
from quadriform.errors import FileFormatError, InputError, OptionError, WarningKind, Warnings, choose
from quadriform.files.guide_points import is_guide_points
from quadriform.files.meshes import read_mesh_or_points, read_space_and_unit
from quadriform.files.points import read_point_set
from quadriform.files.reading import named_in_errors, sha256_of, visible_files
from quadriform.files.save_and_load import content_of
from quadriform.imaging.formats import image_format, is_pair, pair_of
from quadriform.point_sets import UNITS, PointSet, precision_loss
from quadriform.shapes.mesh_points import mesh_points
from quadriform.shapes.record import InputFile
from quadriform.shapes.solid import Solid
from quadriform.shapes.spaces import rotation_between
from quadriform.words import numbers

if TYPE_CHECKING:
    from quadriform.imaging.labels import Preset
    from quadriform.imaging.object_choice import Labels, Select
    from quadriform.imaging.segmentation import Segmentation
    from quadriform.imaging.volume import Volume

SpaceAndUnit = tuple[str, str]
"""Space ("LPS", "RAS" or "unknown") and unit of lengths ("mm", "m" or "unknown")."""

CONTENT = {"mesh": "a mesh", "points": "points"}
IMAGE_OPTIONS = {"labels": "--label", "threshold": "--threshold", "frame": "--frame", "border": "--border"}
SEGMENT_OPTIONS = {"region": "--region", "component": "--seed", "closing": "--closing", "fill_holes": "--fill-holes"}
"""Argument -> option of the command line; both choose an object in an image."""
PERCENTILE = re.compile(r"(?:(\d+(?:\.\d+)?)%)?p(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class ReadOptions:
    """The choices by which points are read from a file, most of them for images; None: decided by the file's content.

    Attributes:
        labels: values of a label image or names of segments, taken together.
        threshold: a value, "otsu", or (fraction, percentile).
        frame: of a four-dimensional image.
        segment: arguments for `segment` as they are: region, component, closing, fill_holes.
        border: "open" or "close".
        affine: which transform of a NIfTI header: "sform", "qform" or "pixdim".
        preset: a surface by the label convention of a data set, against which the image is checked.
        columns: of a table or an array, as `read_points` takes them.
        unit: of the lengths of a file that states none: "mm", "m", "um" and so on.
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

    @property
    def of_images(self) -> list[str]:
        """The given options that do not apply to points and meshes, as the command line names them."""
        found = [option for name, option in IMAGE_OPTIONS.items() if getattr(self, name) is not None]
        return found + [option for name, option in SEGMENT_OPTIONS.items() if self.segment.get(name)]

    @property
    def select_above(self) -> "Select | None":
        """The threshold as an argument of `segment`."""
        from quadriform.imaging.object_choice import Percentile

        return Percentile(*self.threshold) if isinstance(self.threshold, tuple) else self.threshold  # type: ignore[return-value]

    def with_label(self, label: str) -> "ReadOptions":
        """Return the same options with other labels."""
        return replace(self, labels=parse_labels(label))

    def with_surface(self, rule: "Labels | Preset") -> "ReadOptions":
        """Return the same options with the labels of a surface, or with the preset."""
        from quadriform.imaging.labels import Preset

        return replace(self, preset=rule) if isinstance(rule, Preset) else replace(self, labels=rule.values)


def parse_labels(text: str) -> tuple[int | str, ...]:
    """Return numbers between commas, or one text with the names of segments, which are known when the image is read.

    Raises:
        OptionError: no numbers, and no name.
    """
    if any(letter.isalpha() for letter in text):  # a name may contain commas and digits
        return (text,)
    return numbers(text, text.count(",") + 1, "--label")


def parse_threshold(text: str) -> float | str | tuple[float, float]:
    """Return a value, "otsu", or (fraction, percentile) of a text such as 50%p99.9.

    Raises:
        OptionError: another text.
    """
    if text == "otsu":
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
    """Points of a file, and what the file states about them.

    Attributes:
        cloud: the points in `unit` and `space` with what is known of them, as an argument of `fit`; its factor is that
            by which lengths in the unit of the file became lengths in `unit`.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        warnings: of the reading.
        notes: what was assumed, one sentence each.
        slice_of_point: (n,) the slice of each point of an image, as `slice_numbers` counts them.
        image: from which the points were taken.
    """

    cloud: PointSet
    space: str = "unknown"
    unit: str = "unknown"
    warnings: Warnings = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    slice_of_point: NDArray[np.int64] | None = None
    image: "Volume | None" = None


def kind_of(path: Path) -> Literal["image", "mesh", "points", "model"] | None:
    """Return the kind of content of a file; None for others, and for a folder without DICOM files.

    Images are recognised as `read_volume` does, other files as `content_of` does.
    """
    if image_format(path) is not None:
        return "image"
    return None if path.is_dir() else content_of(path)


def has_points(path: Path) -> bool:
    """Return whether `fit` and `track` take points from a file."""
    return kind_of(path) in ("image", "mesh", "points")


def files_of(path: Path) -> list[Path]:
    """Return the files of an input: itself, both of a pair, or those of a folder without hidden and empty ones."""
    if path.is_dir():
        return [file for file in visible_files(path) if file.stat().st_size > 0]
    return list(pair_of(path)) if is_pair(path) and path.is_file() else [path]


def read_source(path: Path, options: ReadOptions) -> Source:
    """Return the points of a table, an array, a mesh or an image; of a mesh with few vertices, of its whole surface.

    Raises:
        InputError, FileFormatError, FileLimitError, AffineError, MaskError, PointsError, DegenerateError: it
            gives no points.
        OptionError: an option that does not go with this kind of file, or out of its range.
    """
    kind = kind_of(path)
    if kind in ("image", "mesh") and options.columns is not None:
        raise OptionError(f"option --columns goes with tables and arrays, found the {kind} {str(path)!r}")
    if kind in ("mesh", "points") and (given := options.of_images):
        raise OptionError(f"option {given[0]} goes with images, found the file of {CONTENT[kind]} {str(path)!r}")
    if kind == "image":
        return with_stated_unit(_from_image(path, options), options.unit, path)
    if kind == "mesh":
        return with_stated_unit(_from_mesh(path), options.unit, path)
    if kind == "model":
        raise FileFormatError(f"{str(path)!r}: expected points, a mesh or an image, found a model")
    return _from_table(path, options)


def _from_mesh(path: Path) -> Source:
    mesh = read_mesh_or_points(path)
    points, note = mesh_points(mesh)
    # sampled points have all digits; the vertices show the precision of the file
    warnings = precision_loss(mesh.vertices.tolist(), mesh.vertices) if note else {}
    notes = (f"{path}: {note}",) if note else ()
    return Source(PointSet(points, solid=Solid.of_mesh(mesh)), *read_space_and_unit(path), warnings, notes)


def _from_table(path: Path, options: ReadOptions) -> Source:
    if options.columns is None and is_guide_points(path):
        raise InputError(
            f"{str(path)!r}: holds contours of several surfaces, not points of one; follow their frames by track, or "
            "take the points of each surface by read_guide_points in Python"
        )
    found = read_point_set(path, options.columns)
    found = replace(found, unit=_stated_unit(found.unit, options.unit, path)).in_metric_unit()
    notes = tuple(f"{path}: {note}" for note in found.notes)
    warnings = precision_loss(found.number_type, found.points)
    return Source(PointSet(found.points, found.normals, factor=found.factor), "unknown", found.unit, warnings, notes)


def with_stated_unit(source: Source, unit: str | None, path: Path) -> Source:
    """Return an image's or a mesh's points, as they are, with the unit of --unit where the file states none.

    Raises:
        InputError: the file states another.
        OptionError: a unit that is not known, or other than mm and m.
    """
    stated = _stated_unit(source.unit, unit, path)
    if stated not in UNITS:
        raise OptionError(f"option --unit={unit!r}: of images and meshes expected mm or m")
    return replace(source, unit=stated)


def _stated_unit(of_file: str, unit: str | None, path: Path) -> str:
    """The unit of a file's lengths: that of --unit, which must be that of the file where this has one."""
    if unit is None:
        return of_file
    stated = choose(unit_of(unit) or unit, tuple(MILLIMETRES), "--unit")
    if of_file not in ("unknown", stated):
        raise InputError(f"{str(path)!r}: option --unit={unit!r} contradicts the file, which has {of_file}")
    return stated


def read_object(path: Path, options: ReadOptions) -> tuple["Volume", dict[str, Any], tuple[str, ...]]:
    """Return an image, the arguments of `segment` that choose the object in it, and notes of what was assumed."""
    from quadriform.imaging.reading import read_volume

    volume = read_volume(path, options.frame, options.affine)
    select, note = _select(volume, options)
    return volume, {"select": select, **options.segment}, note


def kept_note(segmentation: "Segmentation") -> tuple[str, ...]:
    """Return a note where components of the object were left out."""
    found, kept = len(segmentation.component_voxels), segmentation.components_kept
    return (f"kept {kept} of {found} connected components; --seed chooses another",) if found > kept else ()


def common_space_and_unit(sources: Mapping[str, Source]) -> SpaceAndUnit:
    """Return space and unit of all sources, by name of their surface.

    Raises:
        InputError: they differ.
    """
    found = {(source.space, source.unit) for source in sources.values()}
    if len(found) > 1:
        listed = ", ".join(f"{name} in {source.space} {source.unit}" for name, source in sources.items())
        raise InputError(f"the surfaces differ in space or unit ({listed}); transform them to one first")
    return found.pop()


def space_and_unit_of(path: Path, columns: str | None = None) -> SpaceAndUnit:
    """Return space and unit of a mesh; of a table or an array, the unit in the names of its columns."""
    kind = kind_of(path)
    if kind == "mesh":
        return read_space_and_unit(path)
    return "unknown", read_point_set(path, columns).in_metric_unit().unit if kind == "points" else "unknown"


def space_to_write(requested: str | None, found: str) -> str:
    """Return the space to write in: the requested one, else that of the input.

    Raises:
        InputError: one was requested, and that of the input is unknown.
    """
    if requested is None:
        return found
    rotation_between(found, requested)  # raises where the space of the input is unknown
    return requested


def _from_image(path: Path, options: ReadOptions) -> Source:
    from quadriform.imaging.image_points import outer_side, points_from_image, slice_numbers

    with named_in_errors(path):
        volume, arguments, notes = read_object(path, options)
        if options.border is not None:
            arguments["border"] = options.border
        found = points_from_image(volume, **arguments)
        # the outer side encloses more than the wall: what is compared with the fit is the object that was chosen
        solid = found.solid
        found = outer_side(found) if WarningKind.HOLLOW in found.warnings else found
    notes = tuple(f"{path}: {note}" for note in notes + kept_note(found.segmentation))
    cloud = PointSet(found.points, noise=found.noise, solid=solid)
    slice_of_point = slice_numbers(volume, found.points)
    return Source(cloud, volume.space, volume.unit, found.warnings, notes, slice_of_point, volume)


def _select(volume: "Volume", options: ReadOptions) -> tuple[Any, tuple[str, ...]]:
    """The argument `select` of `segment`, and notes of what was assumed where no option was given."""
    from quadriform.imaging.labels import preset_labels
    from quadriform.imaging.object_choice import Labels, choose_object

    if options.preset is not None:
        return preset_labels(volume, options.preset), ()
    if options.labels is not None:
        return Labels(options.labels), ()
    threshold = options.select_above
    return choose_object(volume) if threshold is None else (threshold, ())


# --- input files of a record ---------------------------------------------------------------------------------------


def input_files(found: Mapping[str, Sequence[Path]], frame: int | None = None) -> tuple[InputFile, ...]:
    """Return the input files of a record.

    Args:
        found: surface, or "" for all, -> its files; of several files each is one frame, in their order.
        frame: which frame was taken of one file with several.

    Raises:
        InputError, FileFormatError: a file cannot be read.
    """
    every = dict.fromkeys(path for files in found.values() for path in files)
    hashes = {path: sha256_of(*files_of(path)) for path in every}
    return tuple(
        InputFile(_name(path), hashes[path], surface, number if len(files) > 1 else frame)
        for surface, files in found.items()
        for number, path in enumerate(files)
    )


def title_of(files: Sequence[Path], most: int = 3) -> str:
    """Return the names of input files as a title, the first `most` of them."""
    return ", ".join(map(_name, files[:most])) + (" ..." if len(files) > most else "")


def without_folders(notes: Iterable[str], files: Iterable[Path]) -> tuple[str, ...]:
    """Return notes with the name of a file in place of its path at their beginning; each note once."""
    names = {f"{path}: ": f"{_name(path)}: " for path in files}
    return tuple(dict.fromkeys(_shortened(note, names) for note in notes))


def _shortened(note: str, names: Mapping[str, str]) -> str:
    for long, short in names.items():
        if note.startswith(long):
            return short + note.removeprefix(long)
    return note


def _name(path: Path) -> str:
    return path.name or path.resolve().name
