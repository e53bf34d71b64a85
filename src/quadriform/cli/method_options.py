"""Options of `quadriform fit` that choose how the model is fitted, and how they are read."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.cli.options import decimals
from quadriform.errors import OptionError
from quadriform.words import after_number, numbers

if TYPE_CHECKING:
    from quadriform.points import Array


@dataclass(frozen=True)
class MethodChoice:
    """Which model is fitted, and how.

    Method:
        kind: ellipsoid (any superellipsoid), toroid, hyperboloid1 or hyperboloid2.
        method: tangent, or paper: Bardinet, Cohen and Ayache 1998. [default: tangent]
        box: Control points along each axis, or auto with --max-error. [default: 5,5,5]
        regularity: bending or springs; for paper svd (P7, the default), springs-paper (P9), springs (on displacements).
        strength: Regularisation weight per data point: a number, or auto; for svd the number of singular values, or
            their smallest fraction of the largest.

    Method tangent:
        max_error: RMS distance that --box auto must reach.
        robust: Detect outliers and down-weight them. [default: robust]
        base: Where the data ends on purpose: a point and the direction to the missing side, as x,y,z/nx,ny,nz, or a
            file with a loop of points along the edge, in the frame of the input.
        viewpoint: Position of the sensor as x,y,z, in the frame of the input: the body is not in the
            space that it saw to be empty.
        support: Plane that the body does not pass, such as the table below it, as x,y,z/nx,ny,nz.
        noise: Standard deviation of the points, in their unit, in place of that of images; the estimated noise is at
            least as large.
        prior: Prior of shape, .npz, as written by quadriform prior: pose and shape are those of a member of its
            population; in place of --kind, --box, --regularity and --strength.

    Method paper:
        matching: data-to-model or model-to-data.
        iterations: Largest number of iterations. [default: 30]
        tolerance: Stop when the surface moves by less than this fraction of the RMS radius of the points.
    """

    kind: str | None = None
    method: str | None = None
    box: str | None = None
    regularity: str | None = None
    strength: str | None = None
    max_error: float | None = None
    robust: bool | None = None
    base: str | None = None
    viewpoint: str | None = None
    support: str | None = None
    noise: str | None = None
    prior: str | None = None
    matching: str | None = None
    iterations: int | None = None
    tolerance: float | None = None

    def options(self) -> dict[str, Any]:
        """The arguments for `quadriform.fit` that were given.

        Raises:
            OptionError, FileFormatError: an option that cannot be read, or a loop that cannot.
        """
        given = {name: value for name, value in asdict(self).items() if value is not None}
        return given | {name: read(given[name]) for name, read in READERS.items() if name in given}


def parse_noise(text: str) -> float:
    """The standard deviation of `--noise`, in the unit of the points.

    Raises:
        OptionError: no number, or none that a standard deviation can be.
    """
    from quadriform.files.numbers import to_number
    from quadriform.points import LARGEST

    number = to_number(text)
    if number is None or not 0 < number <= LARGEST:
        raise OptionError(
            f"option --noise={text!r}: expected a standard deviation above 0 in the unit of the points, such as 0.5"
        )
    return number


def known_noise(each: "Sequence[Array | None]", unit: str, given: float | None, factor: float) -> str:
    """A phrase on the known noise of points: the number of `--noise`, or the errors of image points.

    Args:
        each: covariances (n, 3, 3) of the points of each surface, or None.
        unit: of the points.
        given: a standard deviation, in the unit of the file.
        factor: by which lengths in the unit of the file became lengths in `unit`.
    """
    import numpy as np

    if given is not None:
        return f"{factor * given:g}{after_number(unit)}, by --noise"
    known = [noise for noise in each if noise is not None]
    if len(known) < len(each):
        return "nothing"
    # of an edge of a voxel, along which the error is uniform
    largest = float(np.sqrt(max(np.trace(noise, axis1=1, axis2=2).max() for noise in known)))
    return f"up to {largest:.3g}{after_number(unit)} along the edges of voxels"


def _box(text: str) -> tuple[int, ...] | str:
    return text if text == "auto" else numbers(text, 3, "--box")


def _strength(text: str) -> float | str:
    try:
        # words such as auto go to the fit, which knows and names those that are allowed
        return float(text)
    except ValueError:
        return text


def _base(text: str) -> Any:
    """A plane (point, direction) from x,y,z/nx,ny,nz; anything that is not numbers is a file with a loop."""
    from quadriform.files import read_points

    try:
        rows = tuple(decimals(row, "--base") for row in text.split("/"))
    except OptionError:
        return read_points(Path(text))
    return _plane(rows, f"--base={text!r}: expected x,y,z/nx,ny,nz, or a file of points")


def _support(text: str) -> tuple[list[float], ...]:
    rows = tuple(decimals(row, "--support") for row in text.split("/"))
    return _plane(rows, f"--support={text!r}: expected x,y,z/nx,ny,nz")


def parse_prior(text: str) -> Any:
    """The prior of a file.

    Raises:
        FileFormatError: no prior, or a damaged one.
    """
    from quadriform.files.priors import read_prior

    return read_prior(Path(text))


def _plane(rows: tuple[list[float], ...], fault: str) -> tuple[list[float], ...]:
    if [len(row) for row in rows] != [3, 3]:
        raise OptionError(f"option {fault}")
    return rows


READERS: dict[str, Callable[[str], Any]] = {
    **{"box": _box, "strength": _strength, "base": _base, "support": _support, "noise": parse_noise},
    "prior": parse_prior,
    "viewpoint": partial(decimals, option="--viewpoint", count=3),
}
"""How the texts of options are read; the values of others are taken as they are."""
