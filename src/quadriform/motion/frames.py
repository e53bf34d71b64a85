"""Checks of the input of `track`: frames of points with their noise, bases, times, and slice numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import OptionError, PointsError, QuadriformError, choose
from quadriform.fitting.options import Base, TangentOptions, scaled_base
from quadriform.point_sets import ALONE, Given, PointSet, given_factor, point_sets
from quadriform.points import Array, by_name
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.splines import TimeBasis

MOST_KNOTS = 12
"""Most knots in time, enough for the cycle of a heart. Of fewer frames there are as many knots, evenly spaced."""

MOST_SLICES = 2.0**53
"""Slice numbers are below this one: floats beyond it are not exact."""

SliceNumbers = Sequence[Mapping[str, ArrayLike] | ArrayLike]
Noises = float | Mapping[str, ArrayLike] | Sequence[Mapping[str, ArrayLike] | ArrayLike]
Frames = list[dict[str, Array]]
"""For each frame name -> (n, 3) points."""
Covariances = list[dict[str, Array]]
"""For each frame name -> (n, 3, 3) of its points; empty where they are not known."""
Sets = list[dict[str, PointSet]]


def checked_frames(frames: Sequence[Given], noise: Noises | None) -> Sets:
    """The points of each frame by name, with what is known of their noise.

    Raises:
        PointsError, DegenerateError, OptionError: naming the frame that cannot be fitted.
    """
    if len(frames) < 2:
        raise OptionError(f"frames: expected two or more, found {len(frames)}; a single one is for fit")
    known = noise if isinstance(noise, Sequence | np.ndarray) else [noise] * len(frames)
    if len(known) != len(frames):
        raise OptionError(f"noise: expected a number or one entry for each of {len(frames)} frames, found {len(known)}")
    result: Sets = []
    for number, (frame, each_noise) in enumerate(zip(frames, known)):
        try:
            given = point_sets(frame, noise=each_noise)
            result.append({name: each.in_metric_unit() for name, each in given.items()})
        except PointsError as error:
            raise type(error)(f"frame {number}: {error}") from error
        if result[-1].keys() != result[0].keys():
            raise OptionError(f"frame {number} has the surfaces {sorted(result[-1])}, frame 0 has {sorted(result[0])}")
    return result


def covariances(sets: Sets) -> Covariances:
    """Covariances of the points of each frame by name; none where those of any frame or surface are not known."""
    found = [{name: each.noise for name, each in frame.items() if each.noise is not None} for frame in sets]
    # without the noise of the others it is not known how much their points count beside these
    whole = all(len(known) == len(frame) for known, frame in zip(found, sets))
    return found if whole else [{} for _ in sets]


def planes_of_frames(base: Base | Sequence[Base | None], sets: Sets) -> list[BasePlane | None]:
    """The base of each frame, from one for all or a list with an entry for each; a tuple or an array is one base.

    Raises:
        OptionError: naming the frame whose entry is no base of its points.
    """
    every = base if isinstance(base, list) else [base] * len(sets)
    if len(every) != len(sets):
        raise OptionError(
            f"base: expected (point, direction), or a list with an entry for each of {len(sets)} frames, found "
            f"{len(every)} entries"
        )
    found: list[BasePlane | None] = []
    for number, (each, frame) in enumerate(zip(every, sets)):
        try:
            given = None if each is None else scaled_base(each, given_factor(frame.values()))
            found.append(TangentOptions(base=given).base_plane({name: of.points for name, of in frame.items()}))
        except QuadriformError as error:
            raise type(error)(f"frame {number}: {error}") from error
    return found


def checked_times(times: ArrayLike | None, count: int) -> Array:
    """Times (F,) of the frames: 0, 1, 2 ... unless given.

    Raises:
        OptionError: not one for each frame, or not increasing.
    """
    given = np.arange(count) if times is None else np.asarray(times)
    at = given.astype(np.float64)
    if at.shape != (count,) or not np.isfinite(at).all():
        raise OptionError(f"times: expected {count} finite numbers, one a frame, found {given!r}")
    late = np.flatnonzero(np.diff(at) <= 0)
    if len(late):
        one = late[0]
        raise OptionError(f"times: frame {one + 1} at {at[one + 1]:g} does not come after frame {one} at {at[one]:g}")
    return at


def time_basis(times: Array, period: float | str | None) -> TimeBasis:
    """The splines of a motion that repeats after a period, or of one that does not.

    Raises:
        OptionError: a period that is shorter than the frames.
    """
    mean_step = float(times[-1] - times[0]) / (len(times) - 1)
    if isinstance(period, str):
        choose(period, ("auto",), "period")
        period = mean_step * len(times)  # the frame after the last would be the first again
    count = min(len(times), MOST_KNOTS)
    if period is None:
        return TimeBasis(np.linspace(times[0], times[-1], count))
    if not period > times[-1] - times[0]:
        raise OptionError(
            f"period={period}: expected more than the {times[-1] - times[0]:g} between first and last frame"
        )
    return TimeBasis(times[0] + np.arange(count) * period / count, float(period))


def checked_slices(
    slices: SliceNumbers | None, clouds: Frames, strategy: str
) -> list[dict[str, NDArray[np.int64]]] | None:
    """The slice number of each point by frame and surface, or None.

    Raises:
        OptionError: not one whole number for each point, or another strategy than "cycle".
    """
    if slices is None:
        return None
    if strategy != "cycle":
        raise OptionError(f"option slices is not one of strategy={strategy!r}; use strategy='cycle'")
    if len(slices) != len(clouds):
        raise OptionError(f"slices: expected one entry for each of {len(clouds)} frames, found {len(slices)}")
    result: list[dict[str, NDArray[np.int64]]] = []
    for number, (given, frame) in enumerate(zip(slices, clouds)):
        numbers = by_name(given, "slices") if isinstance(given, Mapping) else {ALONE: given}
        if unknown := numbers.keys() - frame.keys():
            raise OptionError(f"slices: frame {number} has no surface {min(unknown)!r}; expected {sorted(frame)}")
        result.append({})
        for name, cloud in frame.items():
            if name not in numbers:
                raise OptionError(
                    f"slices: frame {number}: expected a slice number of each point of {name}, found none"
                )
            result[-1][name] = _whole_numbers(numbers[name], len(cloud), f"slices: frame {number}, {name}")
    return result


def _whole_numbers(given: ArrayLike, count: int, what: str) -> NDArray[np.int64]:
    """Whole numbers (count,) of any type of numbers, so that those of a table, which are floats, need no conversion."""
    try:
        found = np.asarray(given)
        numbers = found.astype(np.float64)
    except (TypeError, ValueError):
        raise OptionError(f"{what}: expected {count} whole numbers, found {given!r:.60}") from None
    if found.shape != (count,):
        raise OptionError(f"{what}: expected {count} whole numbers, one a point, found {found.shape}")
    wrong = found.dtype.kind not in "iuf" or ~(np.abs(numbers) < MOST_SLICES) | (numbers != np.round(numbers))
    if np.any(wrong):
        one = np.argmax(np.broadcast_to(wrong, found.shape))
        raise OptionError(f"{what}: expected whole numbers below 2^53, found {found[one]!r} for point {one}")
    return found.astype(np.int64)
