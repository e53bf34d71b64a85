"""The choices of a refinement, checked once."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, choose
from quadriform.fitting.least_squares.regularisers import Regulariser
from quadriform.point_sets import PointSet, given_factor
from quadriform.points import Array, check_number, check_points
from quadriform.shapes.landmarks import BasePlane, check_base

Base = tuple[ArrayLike, ArrayLike] | ArrayLike | None
METHODS = ("tangent", "paper")
TANGENT_REGULARITIES = ("bending", "springs")
PAPER_REGULARITIES = ("svd", "svd-position", "springs", "springs-paper")
MATCHINGS = ("data-to-model", "model-to-data")


def check_box(box: object, alternative: str = "") -> tuple[int, int, int]:
    """Three counts of control points.

    Args:
        box: as given.
        alternative: what else is expected where it is given, for the message.

    Raises:
        OptionError: not three whole numbers from 2 to 20.
    """
    sides = tuple(box) if isinstance(box, (tuple, list)) else ()
    if len(sides) != 3 or not all(isinstance(n, (int, np.integer)) and 2 <= n <= 20 for n in sides):
        raise OptionError(f"option box={box!r} is out of range; expected three whole numbers from 2 to 20{alternative}")
    return int(sides[0]), int(sides[1]), int(sides[2])


def check_strength(strength: float | str) -> float | None:
    """A number >= 0, or None for "auto".

    Raises:
        OptionError: anything else.
    """
    if isinstance(strength, str):
        choose(strength, ("auto",), "strength")
        return None
    return check_number(strength, "strength", 0)


def _check_above_zero(value: float | None, option: str) -> None:
    if value is not None and not check_number(value, option, 0):
        raise OptionError(f"option {option}=0 is out of range; expected a number above 0, or None")


@dataclass(frozen=True)
class PaperOptions:
    """The choices of the paper's iteration; the defaults are the paper's own algorithm (3.3, 5).

    Attributes:
        box: control points along each axis.
        regularity: "svd", P7 by SVD (3.2.3), truncated by `strength` (P8); "springs-paper", P9 as printed;
            and three variations of ours: "springs" and a regulariser object, both on the displacement P - P0, and
            "svd-position", the SVD on P in place of its step.
        strength: for "svd" how many singular values are used (>= 1), or the fraction of the largest above which they
            are (< 1); for springs alpha / N of P9, N the model points. "auto": all singular values above rounding;
            alpha / N = 1e-7.
        matching: "data-to-model", the paper's, or "model-to-data".
        iterations: the largest number of iterations.
        tolerance: the stop test (3.3): stop when the RMS of X_{n+1} - X_n is below this fraction of the RMS radius of
            the points; None makes all iterations.
    """

    box: tuple[int, int, int] = (5, 5, 5)
    regularity: str | Regulariser = "svd"
    strength: float | str = "auto"
    matching: str = "data-to-model"
    iterations: int = 30
    tolerance: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "box", check_box(self.box))
        if isinstance(self.regularity, str):
            choose(self.regularity, PAPER_REGULARITIES, "regularity")
        check_strength(self.strength)
        choose(self.matching, MATCHINGS, "matching")
        whole = isinstance(self.iterations, (int, np.integer)) and not isinstance(self.iterations, bool)
        if not whole or self.iterations < 1:
            raise OptionError(f"option iterations={self.iterations!r} is out of range; expected a whole number >= 1")
        _check_above_zero(self.tolerance, "tolerance")


@dataclass(frozen=True)
class TangentOptions:
    """The choices of the refinement by tangent distance.

    Attributes:
        box: control points along each axis, or "auto": the smallest that reaches `max_error`.
        regularity: "bending", "springs", or a regulariser of one's own, on the displacement of the control points.
        strength: alpha per data point, or "auto": that of the largest marginal likelihood or, where residuals are
            correlated, a smaller one that predicts left-out patches of the surface better.
        robust: whether outliers are detected and down-weighted.
        base: where the data ends on purpose: a plane (point, direction to the missing side), or a loop (m, 3) of
            points along the edge; None when the surface should be covered.
        max_error: RMS distance to the inliers that box="auto" must reach, in the unit of the points.
    """

    box: tuple[int, int, int] | str = (5, 5, 5)
    regularity: str | Regulariser = "bending"
    strength: float | str = "auto"
    robust: bool = True
    base: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None
    max_error: float | None = None

    def __post_init__(self) -> None:
        if self.box != "auto":
            object.__setattr__(self, "box", check_box(self.box, ", or 'auto'"))
        if isinstance(self.regularity, str):
            choose(self.regularity, TANGENT_REGULARITIES, "regularity")
        if check_strength(self.strength) == 0:
            raise OptionError("option strength=0 leaves control points undetermined; expected a number above 0")
        if (self.box == "auto") != (self.max_error is not None):
            raise OptionError("options box='auto' and max_error go together: give both or neither")
        _check_above_zero(self.max_error, "max_error")

    def base_plane(self, clouds: Mapping[str, Array]) -> BasePlane | None:
        """The base as a plane in the world of the points.

        Raises:
            OptionError: `base` is neither a plane nor a loop, or no edge of the data.
        """
        if self.base is None:
            return None
        points = np.concatenate(list(clouds.values()))
        plane = BasePlane(*_plane(self.base, points.mean(axis=0)))
        check_base(plane, points)
        return plane


def lengths_of(sets: Mapping[str, PointSet], base: Base, max_error: float | None) -> dict[str, Any]:
    """The options that are lengths, given in the unit in which the points were given, in that which these have."""
    if base is None and max_error is None:
        return {"base": None, "max_error": None}
    factor = given_factor(sets.values())
    return {"base": scaled_base(base, factor), "max_error": max_error if max_error is None else factor * max_error}


def scaled_base(base: Base, factor: float) -> Base:
    """The base, as `TangentOptions` takes it, with its lengths times a factor; None without one.

    Raises:
        PointsError: not of points.
    """
    if base is None or factor == 1:
        return base
    if isinstance(base, tuple) and len(base) == 2:
        return factor * check_points(np.reshape(base[0], (1, -1)), "base")[0], base[1]
    return factor * check_points(base, "base")


def _plane(base: ArrayLike | tuple[ArrayLike, ArrayLike], centre: Array) -> tuple[Array, Array]:
    if isinstance(base, tuple) and len(base) == 2:
        point, direction = (check_points(np.reshape(row, (1, -1)), "base")[0] for row in base)
        length = float(np.linalg.norm(direction))
        if length == 0:
            raise OptionError("option base: the direction of the plane is zero")
        return point, direction / length
    loop = check_points(base, "base")
    if len(loop) < 3:
        raise OptionError(f"option base: a loop of {len(loop)} points; expected at least 3, or (point, direction)")
    middle = loop.mean(axis=0)
    direction = np.linalg.svd(loop - middle)[2][2]
    return middle, direction if (middle - centre) @ direction > 0 else -direction


def options_for(method: str, given: Mapping[str, object]) -> PaperOptions | TangentOptions:
    """The checked options of a method, from named choices; None stands for the default of the method.

    Raises:
        OptionError: unknown method, a choice that the method has not, or one out of its range.
    """
    choose(method, METHODS, "method")
    kind = PaperOptions if method == "paper" else TangentOptions
    known = kind.__dataclass_fields__
    chosen = {name: value for name, value in given.items() if value is not None}
    for name in chosen:
        if name not in known:
            raise OptionError(f"option {name} is not one of method={method!r}; expected {', '.join(known)}")
    return kind(**chosen)  # type: ignore[arg-type]
