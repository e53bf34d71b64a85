"""Options that several subcommands share, and groups of options as dataclasses."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, is_dataclass
from functools import partial, wraps
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin
from unicodedata import normalize

import typer

from quadriform.errors import OptionError, choose
from quadriform.words import numbers, ranges

if TYPE_CHECKING:
    from quadriform.imaging.file_points import ReadOptions

SHARED = {
    "space": "Coordinate frame of the output, LPS or RAS; only the signs of x and y differ. "
    "[default: that of the input, LPS for images]",
    "columns": "Tables and arrays: where the columns have no names, names for them from left to right, such as "
    "x,y,z,nx,ny,nz; where they have others, those of x, y and z.",
}
"""Help of options that subcommands take without a group."""
FLAGS = {"output": ("--output", "-o"), "as_json": ("--json",), "robust": ("--robust/--no-robust",)}
"""Flags that are not the name of the parameter after two dashes."""
SECTION = re.compile(r"^([A-Z][\w ]*):\n((?: {4}.*\n|\n)+)", re.MULTILINE)
ENTRY = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


@dataclass(frozen=True)
class Common:
    """What nearly all subcommands take.

    Attributes:
        strict: Refuse a result, or a model, that is unreliable (exit code 3); --strict=warned also one with warnings.
        force: Replace files that exist.
        as_json: Print JSON on stdout instead of a table.
    """

    strict: str | None = None
    force: bool = False
    as_json: bool = False


@dataclass(frozen=True)
class ObjectInImage:
    """How an object is chosen in an image.

    Images:
        label: Label image: the value, or several as 1,2 taken together; or the name of a segment.
        threshold: Grey image: a value, 'otsu', or a percentage of a percentile such as 50%p99.9 inside the region.
        region: Only these voxels: i0:i1,j0:j1,k0:k1, ends excluded.
        seed: The component at voxel i,j,k instead of the largest.
        closing: Close gaps of about this many voxels.
        fill_holes: Fill enclosed holes.
        frame: Which volume of a 4-D image, from 0.
        affine: NIfTI header: its sform, its qform, or the sizes in pixdim alone. [default: by what the header supports]
    """

    label: str | None = None
    threshold: str | None = None
    region: str | None = None
    seed: str | None = None
    closing: int | None = None
    fill_holes: bool = False
    frame: int | None = None
    affine: str | None = None

    def parse(self, border: str | None = None) -> "ReadOptions":
        """Return the options as an argument of `read_source`.

        Args:
            border: "open" or "close", where the border of the image cuts the object.

        Raises:
            OptionError: an option that cannot be read.
        """
        from quadriform.imaging.file_points import ReadOptions, parse_labels, parse_threshold

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
        return ReadOptions(labels, threshold, self.frame, given, border, self.affine)


def subcommand(function: Callable[..., None]) -> Callable[..., None]:
    """The same function as typer takes it, which knows no groups of options and reads no docstrings.

    - Parameters before the asterisk become arguments, the others options.
    - A parameter whose type is a dataclass stands for its fields.
    - The help of an option is its entry in the docstring of the function or of its dataclass: in a section such as
      Args, a line of `    name: text` with further lines indented by eight blanks. Without an entry it is that of
      `Common`, `ObjectInImage` or SHARED.
    - A section that is not called Args or Attributes is a panel of the help.

    Raises:
        TypeError: an option without help.
    """
    parameters = signature(function).parameters.values()
    # annotations are classes here: these modules do not postpone their evaluation
    groups: dict[str, Any] = {each.name: each.annotation for each in parameters if is_dataclass(each.annotation)}
    about = _described(Common) | _described(ObjectInImage) | {name: {"help": text} for name, text in SHARED.items()}
    about |= {name: entry for group in (*groups.values(), function) for name, entry in _described(group).items()}
    options: list[Parameter] = []
    for each in parameters:
        inner = signature(groups[each.name]).parameters.values() if each.name in groups else [each]
        # the fields of a group are options, though its constructor takes them in order
        as_argument = each.kind is Parameter.POSITIONAL_OR_KEYWORD
        options += [_for_typer(one, about, as_argument) for one in inner]

    @wraps(function)
    def run(**given: Any) -> None:
        """Call the function with its groups of options put together."""
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        function(**given)

    run.__signature__ = signature(function).replace(parameters=options)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in options}
    run.__doc__ = SECTION.split(f"{getdoc(function)}\n")[0]
    return run


def _described(documented: Any) -> dict[str, dict[str, Any]]:
    """Help and panel of each entry in the sections of a docstring."""
    return {
        name: {"help": " ".join(text.split()), "rich_help_panel": None if title in ("Args", "Attributes") else title}
        for title, body in SECTION.findall(f"{getdoc(documented)}\n")
        for name, text in ENTRY.findall(body)
    }


def _for_typer(parameter: Parameter, about: dict[str, dict[str, Any]], as_argument: bool) -> Parameter:
    """A parameter with its help; limits are in the annotation, such as `Annotated[int, {"min": 1}]`."""
    if parameter.name not in about:
        raise TypeError(f"{parameter.name}: an option without help; describe it in the docstring, or in SHARED")
    kind, limits = parameter.annotation, {}
    if get_origin(kind) is Annotated:
        kind, limits = get_args(kind)
    # an explicit name, because typer would add --no-... to a flag that is off
    names = FLAGS.get(parameter.name, ("--" + parameter.name.strip("_").replace("_", "-"),))
    make: Any = typer.Argument if as_argument else partial(typer.Option, *names, **limits)
    order = Parameter.POSITIONAL_OR_KEYWORD if as_argument else Parameter.KEYWORD_ONLY
    return parameter.replace(annotation=Annotated[kind, make(**about[parameter.name])], kind=order)


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
    # NFC and casefold: the coarsest of the common file systems
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
