"""Options that several verbs share, spelled once."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated
from unicodedata import normalize

import typer

from quadriform.errors import OptionError, choose

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
Unit = Annotated[
    str | None, typer.Option(help="Unit of the lengths of a file that names none: mm, m; of tables also cm, um ...")
]

IMAGE = "Images"
Label = Annotated[
    str | None,
    typer.Option(
        help="Label image: the value, or several as 1,2 taken together; or the name of a segment.",
        rich_help_panel=IMAGE,
    ),
]
Affine = Annotated[
    str | None,
    typer.Option(
        help="NIfTI header: its sform, its qform, or the sizes in pixdim alone. [default: by what the header supports]",
        rich_help_panel=IMAGE,
    ),
]
Threshold = Annotated[
    str | None,
    typer.Option(
        help="Grey image: a value, 'otsu', or a share of a percentile such as 50%p99.9 inside the region.",
        rich_help_panel=IMAGE,
    ),
]
Region = Annotated[
    str | None, typer.Option(help="Only these voxels: i0:i1,j0:j1,k0:k1, ends excluded.", rich_help_panel=IMAGE)
]
Seed = Annotated[
    str | None, typer.Option(help="The component at voxel i,j,k instead of the largest.", rich_help_panel=IMAGE)
]
Closing = Annotated[int | None, typer.Option(help="Close gaps of about this many voxels.", rich_help_panel=IMAGE)]
FillHoles = Annotated[bool, typer.Option("--fill-holes", help="Fill enclosed holes.", rich_help_panel=IMAGE)]
Border = Annotated[
    str | None,
    typer.Option(help="Where the object is cut by the image border: close or open.", rich_help_panel=IMAGE),
]
Frame = Annotated[int | None, typer.Option(help="Which volume of a 4-D image, from 0.", rich_help_panel=IMAGE)]


def check_space(text: str | None) -> str | None:
    """The frame of the world that --space names, or None.

    Raises:
        OptionError: another word.
    """
    from quadriform.shapes.spaces import SPACES

    return None if text is None else choose(text, SPACES, "--space")


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
            pair = (
                repr(str(path)) if path == before else f"{str(before)!r} and {str(path)!r}, which differ in case only"
            )
            raise OptionError(f"{what} would both write to {pair}; rename one, or write them one by one")


def surface_file(name: str, suffix: str) -> str:
    """File name for a surface of a model: surface.ply, or surface-endo.ply for one with a name of its own.

    Raises:
        OptionError: a name that no file can safely have.
    """
    if not name or not all(letter.isalnum() or letter in "_-" for letter in name):
        raise OptionError(f"surface {name!r}: expected a name of letters, digits, - and _")
    return f"surface{suffix}" if name == "surface" else f"surface-{name}{suffix}"
