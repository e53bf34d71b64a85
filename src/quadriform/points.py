"""Input checks: whatever users pass becomes checked float64 arrays here, once; centre-and-scale and its undoing."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import DegenerateError, OptionError, PointsError

Array = NDArray[np.float64]
Named = TypeVar("Named")


class Movable(Protocol):
    """A shape that can be scaled about the origin and shifted."""

    def transformed(self, scale: float, offset: Array) -> Self:
        """The shape scaled, then shifted by (3,)."""


Shape = TypeVar("Shape", bound=Movable)

DISTINCT = 1e-12
"""Points closer than this share of the cloud's RMS radius count as one."""
ENOUGH = 100_000
"""Points by which it is decided whether a cloud is flat."""
LARGEST = 1e30
"""No coordinate, length or weight may be larger in any unit, so that products of them stay finite."""
SCALES = (1e-25, 1e25)
"""RMS radii of clouds that can be fitted, in any unit."""
COARSE = 1e-2
"""Steps of single precision that may make a body flat, relative to its extent."""
FLAT = 1e-6
"""A smallest singular value below this share of the largest is a plane, a line or a point."""


def check_points(points: ArrayLike, what: str = "points") -> Array:
    """Return `points` as a finite float64 array of shape (n, 3); the input is never changed.

    Args:
        points: anything with rows x, y, z; (3, 3) is taken as three rows.
        what: the name that an error message uses.

    Raises:
        PointsError: wrong type or shape, no points, masked or not finite values, or coordinates beyond 1e30.
    """
    array = _as_numbers(points, what)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "; try points.T" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise PointsError(f"{what}: expected an array of shape (n, 3), found {array.shape}{hint}")
    if len(array) == 0:
        raise PointsError(f"{what}: there are no points; expected at least one row x, y, z")
    # One comparison of extremes is faster than a test of every number; NaN fails it.
    if not (array.min() >= -LARGEST and array.max() <= LARGEST):  # of NaN neither holds
        _refuse_rows(array, what)
    return np.ascontiguousarray(array, dtype=np.float64)


def _refuse_rows(array: Array, what: str) -> None:
    bad, fault = ~np.isfinite(array).all(axis=1), "are not finite"
    if not bad.any():
        bad = (np.abs(array) > LARGEST).any(axis=1)
        fault = f"are out of range: expected coordinates up to {LARGEST:g} in any unit"
    raise PointsError(
        f"{what}: {int(bad.sum())} of {len(array)} rows {fault}, the first at index {int(bad.argmax())} "
        f"({array[bad.argmax()]}); remove or repair them first"
    )


def _as_numbers(values: ArrayLike, what: str) -> Array:
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if isinstance(values, np.ma.MaskedArray) and np.ma.getmaskarray(values).any():
        raise PointsError(f"{what}: a masked array with masked values; drop those rows or fill them first")
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise PointsError(f"{what}: rows of unequal length; expected (n, 3)") from error
    if array.dtype.kind not in "iuf":
        raise PointsError(f"{what}: expected real numbers, found {_what_else(array)}")
    if array.dtype.kind in "iu" and array.size and np.abs(np.atleast_1d(array).astype(object)).max() > 2**53:
        raise PointsError(f"{what}: whole numbers above 2^53 cannot be kept exactly; shift them first")
    with np.errstate(over="ignore"):
        return array.astype(np.float64, copy=False)


def _what_else(array: NDArray[Any]) -> str:
    """What was given in place of numbers, and which functions make points of it."""
    first = next(iter(array.ravel()), None)
    if array.ndim < 2 and isinstance(first, str | os.PathLike):
        return "a path; only fit reads files: take read_points(path), of an image points_from_image(read_volume(path))"
    if hasattr(first, "world_from_voxel"):
        return "an image; take points_from_image(image).points, of the labels of a heart ventricle_from_labels"
    return f"type {array.dtype}"


def unit_vectors(vectors: NDArray[Any]) -> Array:
    """Vectors (..., 3) divided by their lengths; zero vectors stay."""
    return np.asarray(vectors / np.maximum(lengths(vectors), 1e-300)[..., None], dtype=np.float64)


def lengths(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., 3), by columns: along rows of three NumPy's sums take several times as long."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def outer_squares(vectors: Array) -> Array:
    """The matrices v v' (n, 3, 3) of vectors (n, 3)."""
    return vectors[:, :, None] * vectors[:, None, :]


def rms_length(vectors: Array) -> float:
    """Root of the mean square length of vectors (..., 3)."""
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))


def rigid_motion(points: Array, targets: Array, weights: Array | None = None) -> tuple[Array, Array]:
    """Rotations (..., 3, 3) and shifts (..., 3) that move points (..., n, 3) to targets (..., n, 3) by least squares.

    By the singular value decomposition of their products (Kabsch, Acta Crystallographica A 32: 922-923, 1976).

    Args:
        points: one cloud, or several.
        targets: corresponding points.
        weights: (..., n), not all zero; None for equal ones.
    """
    counts = np.ones(points.shape[:-1]) if weights is None else weights
    counts = (counts / counts.sum(axis=-1, keepdims=True))[..., None, :]
    middle, centre = counts @ points, counts @ targets  # (..., 1, 3)
    products = np.swapaxes(targets - centre, -1, -2) @ (np.swapaxes(counts, -1, -2) * (points - middle))
    u, _, vt = np.linalg.svd(products)
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[..., None]  # no reflection
    rotation = u @ vt
    return rotation, (centre - middle @ np.swapaxes(rotation, -1, -2))[..., 0, :]


def fixed_array(values: ArrayLike, name: str, shape: tuple[int, ...] | None = None) -> Array:
    """A read-only float64 copy of finite numbers up to 1e30, of a shape where one is given.

    Raises:
        OptionError: naming the argument, what was expected and what was found.
    """
    array = np.array(values, dtype=np.float64)
    if (shape and array.shape != shape) or not (np.abs(array) <= LARGEST).all():
        expected = f" of shape {shape}" if shape else ""
        found = f"shape {array.shape}, largest {np.abs(array).max(initial=0):g}"
        raise OptionError(f"{name}: expected finite numbers{expected} up to {LARGEST:g}, found {found}")
    array.setflags(write=False)
    return array


def check_weights(weights: ArrayLike | None, n: int) -> Array:
    """Return non-negative finite weights of shape (n,), all one for None.

    Raises:
        PointsError: wrong length, negative, not finite or all zero.
    """
    if weights is None:
        return np.broadcast_to(np.ones(1), n)
    array = _as_numbers(weights, "weights")
    if array.shape != (n,):
        raise PointsError(f"weights: expected shape ({n},), found {array.shape}")
    if not ((array >= 0) & (array <= LARGEST)).all() or not array.any():
        raise PointsError(f"weights: expected finite values >= 0, up to {LARGEST:g}, that are not all zero")
    return array


NOT_NEGATIVE = 1e-9
"""Eigenvalues of a covariance may be negative by this fraction of the largest: rounding."""


def check_noise(noise: ArrayLike | None, n: int, what: str = "noise") -> Array | None:
    """Return covariances (n, 3, 3) of the measurement of n points; None for None.

    Args:
        noise: a standard deviation, one for each point (n,), or covariances (n, 3, 3), in the unit of the points.
        n: number of points.
        what: the name that an error message uses.

    Raises:
        PointsError: another shape, a standard deviation that is not positive and finite, or a matrix that is no
            covariance: not symmetric, with a negative eigenvalue, or zero.
    """
    if noise is None:
        return None
    array = _as_numbers(noise, what)
    if array.shape in ((), (n,)):
        if not ((array > 0) & (array <= LARGEST)).all():
            found = "not finite" if not np.isfinite(array).all() else f"{np.min(array):g} to {np.max(array):g}"
            raise PointsError(f"{what}: expected standard deviations above 0 in the unit of the points, found {found}")
        return np.broadcast_to(array[..., None, None] ** 2 * np.eye(3), (n, 3, 3))
    if array.shape != (n, 3, 3):
        raise PointsError(
            f"{what}: expected a number, {n} standard deviations, or covariances of shape ({n}, 3, 3), "
            f"found shape {array.shape}"
        )
    return _covariances(array, what)


def _covariances(array: Array, what: str) -> Array:
    """The same matrices (n, 3, 3), if each is a covariance."""
    size = np.abs(array).max(axis=(1, 2))
    sized = (size > 0) & (size <= LARGEST**2)  # false for NaN
    scaled = np.where(sized[:, None, None], array, np.eye(3)) / np.where(sized, size, 1.0)[:, None, None]
    symmetric = np.abs(scaled - scaled.transpose(0, 2, 1)).max(axis=(1, 2)) <= NOT_NEGATIVE
    valid = sized & symmetric & (np.linalg.eigvalsh(scaled)[:, 0] >= -NOT_NEGATIVE)
    if not valid.all():
        raise PointsError(
            f"{what}: {int((~valid).sum())} of {len(array)} matrices are no covariances, the first at index "
            f"{int((~valid).argmax())}; expected symmetric ones without negative eigenvalues, not zero, and finite"
        )
    return array


def by_name(given: Mapping[Any, Named], what: str) -> dict[str, Named]:
    """Return the same values under names that are text.

    Args:
        given: name -> value; a name that is no text, such as a number, is written as one.
        what: the name that an error message uses.

    Raises:
        OptionError: two names that are written alike, such as 1 and "1", or a name that UTF-8 cannot hold.
    """
    result: dict[str, Named] = {}
    for name, value in given.items():
        text = str(name)
        if text in result:
            raise OptionError(f"{what}: two names are both written {text!r}; expected a name of its own for each")
        if any("\ud800" <= letter <= "\udfff" for letter in text):
            raise OptionError(
                f"{what}: the name {text!r} has half of a surrogate pair; expected text that UTF-8 can hold"
            )
        result[text] = value
    return result


def for_each(names: Collection[str], given: Mapping[Any, Named] | Named, what: str) -> dict[str, Named]:
    """Return a value for each name: those of a mapping, or the same one for all.

    Raises:
        OptionError: a mapping with other names.
    """
    values: dict[str, Named] = by_name(given, what) if isinstance(given, Mapping) else dict.fromkeys(names, given)
    if values.keys() != set(names):
        raise OptionError(f"{what} {sorted(values)} and points {sorted(names)} must have the same names")
    return values


def check_number(value: float, option: str, low: float, high: float = np.inf) -> float:
    """Return `value` as a float when it lies in [low, high].

    Raises:
        OptionError: not a number, or out of the range.
    """
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else np.nan
    if not low <= number <= high:
        raise OptionError(f"option {option}={value!r} is out of range; expected a number from {low:g} to {high:g}")
    return number


def check_spread(points: Array, needed: int) -> None:
    """Refuse clouds that no closed surface can be fitted to.

    Raises:
        DegenerateError: fewer than `needed` distinct points, or all of them on one plane, line or point.
    """
    step = len(points) // ENOUGH
    if step > 1:  # what spreads among some of a very large cloud spreads among all
        try:
            return check_spread(np.ascontiguousarray(points[::step]), needed)
        except DegenerateError:
            pass
    frame = Frame.of(points)
    if not SCALES[0] < frame.scale < SCALES[1]:
        if len(np.unique(points, axis=0)) == 1:
            raise DegenerateError(f"zero extent: all {len(points)} points are equal")
        raise PointsError(
            f"points: the size is out of range (RMS radius {frame.scale:g}); expected {SCALES[0]:g} to {SCALES[1]:g}, "
            "so choose another unit"
        )
    local = frame.to_local(points)
    distinct = _distinct(local[: 10 * needed])
    if distinct < needed:
        distinct = _distinct(local)
    # the singular values of R are those of all points, and R is 3 x 3
    singular = np.linalg.svd(np.linalg.qr(local, mode="r"), compute_uv=False)
    rank = int((singular > FLAT * singular[0]).sum())
    if distinct >= 4 and rank < 3:
        shape = {1: "collinear", 2: "coplanar"}[rank]
        raise DegenerateError(
            f"points are {shape} (rank {rank} of 3); expected points around a solid body{_precision_hint(points)}"
        )
    if distinct < needed:
        raise DegenerateError(f"{distinct} distinct points; expected at least {needed}, one for each parameter")


def _precision_hint(points: Array) -> str:
    """A hint for a message where single precision far from the origin may have made the points flat."""
    single, largest = points.astype(np.float32), float(np.abs(points).max())
    step = float(np.spacing(np.float32(largest)))
    if not (single == points).all() or step < COARSE * float(np.ptp(points, axis=0).max()):
        return ""
    return f"; neighbouring float32 values at {largest:.3g} are {step:.1e} apart: subtract an offset before storing"


def _distinct(local: Array) -> int:
    return len(np.unique(np.round(local / DISTINCT), axis=0))


@dataclass(frozen=True)
class Frame:
    """Centre and scale of a cloud: lengths inside are divided by its RMS radius.

    Attributes:
        centre: (3,), mean of the points, in their unit.
        scale: RMS distance of the points to the centre, in their unit.
    """

    centre: Array
    scale: float

    @classmethod
    def of(cls, points: Array) -> "Frame":
        """Frame of (n, 3) points."""
        centre = points.mean(axis=0)
        largest = float(np.abs(points - centre).max())
        if largest == 0:
            return cls(centre, 0.0)
        scaled = (points - centre) / largest  # squares of 1e-160 would vanish
        return cls(centre, largest * float(np.sqrt((scaled**2).sum(axis=1).mean())))

    def to_local(self, points: Array) -> Array:
        """Points (n, 3) in the centred, unit-free frame."""
        return (points - self.centre) / self.scale

    def to_world(self, points: Array) -> Array:
        """Points (n, 3) back in the unit of the data."""
        return points * self.scale + self.centre

    def shape_to_local(self, shape: Shape) -> Shape:
        """A superquadric, box or model in the centred, unit-free frame."""
        return shape.transformed(1 / self.scale, -self.centre / self.scale)

    def shape_to_world(self, shape: Shape) -> Shape:
        """A superquadric, box or model back in the unit of the data."""
        return shape.transformed(self.scale, self.centre)
