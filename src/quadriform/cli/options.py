"""Options that several subcommands share, and groups of options as dataclasses."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, is_dataclass
from functools import partial, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from unicodedata import normalize

import typer

from quadriform.errors import OptionError, choose
from quadriform.words import numbers, ranges

if TYPE_CHECKING:
    from quadriform.imaging.file_points import ImageOptions

image_option = partial(typer.Option, rich_help_panel="Images")
Json = Annotated[bool, typer.Option("--json", help="Print JSON on stdout instead of a table.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Strict = Annotated[bool, typer.Option("--strict", help="Refuse a result, or a model, with warnings (exit code 3).")]
Space = Annotated[
    str | None,
    typer.Option(
        help="Frame of the world of what is written, LPS or RAS; only the signs of x and y differ. "
        "[default: that of the input, LPS for images]"
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Tables and arrays: where the columns have no names, names for them from left to right, such as "
        "x,y,z,nx,ny,nz; where they have others, those of x, y and z."
    ),
]
Affine = Annotated[
    str | None,
    image_option(
        help="NIfTI header: its sform, its qform, or the sizes in pixdim alone. [default: by what the header supports]"
    ),
]
Frame = Annotated[int | None, image_option(help="Which volume of a 4-D image, from 0.")]


@dataclass(frozen=True)
class Common:
    """What nearly all subcommands take."""

    strict: Strict = False
    force: Force = False
    as_json: Json = False


@dataclass(frozen=True)
class ObjectInImage:
    """How an object is chosen in an image."""

    label: Annotated[
        str | None,
        image_option(help="Label image: the value, or several as 1,2 taken together; or the name of a segment."),
    ] = None
    threshold: Annotated[
        str | None,
        image_option(
            help="Grey image: a value, 'otsu', or a percentage of a percentile such as 50%p99.9 inside the region."
        ),
    ] = None
    region: Annotated[str | None, image_option(help="Only these voxels: i0:i1,j0:j1,k0:k1, ends excluded.")] = None
    seed: Annotated[str | None, image_option(help="The component at voxel i,j,k instead of the largest.")] = None
    closing: Annotated[int | None, image_option(help="Close gaps of about this many voxels.")] = None
    fill_holes: Annotated[bool, image_option("--fill-holes", help="Fill enclosed holes.")] = False
    frame: Frame = None
    affine: Affine = None

    def parse(self, border: str | None = None) -> "ImageOptions":
        """Return the options as an argument of `read_source`.

        Args:
            border: "open" or "close", where the border of the image cuts the object.

        Raises:
            OptionError: an option that cannot be read.
        """
        from quadriform.imaging.file_points import ImageOptions, parse_labels, parse_threshold

        if self.label is not None and self.threshold is not None:
            raise OptionError("options --label and --threshold exclude each other; give one")
        labels = None if self.label is None else parse_labels(self.label)
        threshold = None if self.threshold is None else parse_threshold(self.threshold)
        segment = {
            "fill_holes": self.fill_holes,
            "region": None if self.region is None else ranges(self.region, "--region"),
            "component": None if self.seed is None else numbers(self.seed, 3, "--seed"),
            "closing": self.closing,
        }
        given = {name: value for name, value in segment.items() if value is not None}
        return ImageOptions(labels, threshold, self.frame, given, border, self.affine)


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The same subcommand with the fields of its dataclass parameters as options: typer knows no groups."""
    parameters = signature(command).parameters.values()
    groups: dict[str, Any] = {each.name: each.annotation for each in parameters if is_dataclass(each.annotation)}
    options: list[Parameter] = []
    for each in parameters:
        options += _options_of(groups[each.name]) if each.name in groups else [each]

    @wraps(command)
    def run(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    run.__signature__ = signature(command).replace(parameters=options)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in options}
    return run


def _options_of(group: Any) -> list[Parameter]:
    return [
        Parameter(each.name, Parameter.KEYWORD_ONLY, default=each.default, annotation=each.type)
        for each in fields(group)
    ]


def check_space(text: str | None) -> str | None:
    """The frame of the world that --space names, or None.

    Raises:
        OptionError: another frame.
    """
    from quadriform.shapes.spaces import SPACES

    return None if text is None else choose(text, SPACES, "--space")


def decimals(text: str, option: str, count: int | None = None) -> list[float]:
    """Numbers between commas.

    Args:
        text: the numbers.
        option: named in the error.
        count: how many are expected; None for any.

    Raises:
        OptionError: not numbers, or not `count` of them.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values or count not in (None, len(values)):
        expected = "" if count is None else f"{count} "
        raise OptionError(f"option {option}={text!r}: expected {expected}numbers between commas")
    return values


def stem(path: Path) -> str:
    """The name of a file without its suffix, .nii.gz counting as one."""
    name = path.name
    return name[: -len(".nii.gz")] if name.lower().endswith(".nii.gz") else path.stem


def check_file_names(paths: Iterable[Path], what: str) -> None:
    """Refuse outputs that are one file, also where a file system ignores case or how accents are coded.

    Raises:
        OptionError: naming the two.
    """
    seen: dict[str, Path] = {}
    for path in paths:
        before = seen.setdefault(normalize("NFC", str(path).casefold()), path)
        if before is not path:
            differ = f"{str(before)!r} and {str(path)!r}, which differ in case only"
            pair = repr(str(path)) if path == before else differ
            raise OptionError(f"{what} would both write to {pair}; rename one, or write them one by one")


def surface_file(name: str, suffix: str) -> str:
    """File name for a surface of a model: surface.ply, or surface-endo.ply for one with a name of its own.

    Raises:
        OptionError: a name that no file can safely have.
    """
    if not name or not all(letter.isalnum() or letter in "_-" for letter in name):
        raise OptionError(f"surface {name!r}: expected a name of letters, digits, - and _")
    return f"surface{suffix}" if name == "surface" else f"surface-{name}{suffix}"
