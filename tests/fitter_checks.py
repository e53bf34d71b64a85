"""What is true of every fitter: a list of short checks, each of one truth, and `Fitter`, which they take.

Surfaces are compared, never parameters. A check raises AssertionError where its truth does not hold.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from shapes_made import gap, turned

from quadriform.errors import WarningKind
from quadriform.points import Frame
from quadriform.shapes.model import DeformableModel

TURN = turned(1)
FAR = 1e10


@dataclass(frozen=True)
class Fitter:
    """A way to fit.

    Attributes:
        clouds: arrays (n, 3), one for each surface or frame.
        fit: makes a result with `status` and `warnings` of as many clouds.
        surfaces: for each cloud the model in a result that is of it, and the name of its surface there.
        rows: for each cloud what a result says of each of its points, (n,).
        tolerance: how near the surfaces of two fits to one problem are, of the RMS radius.
    """

    clouds: list[np.ndarray]
    fit: Callable[[list], Any]
    surfaces: Callable[[Any], list[tuple[DeformableModel, str]]]
    rows: Callable[[Any], list[np.ndarray]]
    tolerance: float = 1e-7

    @cached_property
    def plain(self) -> Any:
        """The result for the clouds as they are."""
        return self.fit(self.clouds)

    def of(self, change: Callable[[np.ndarray], Any]) -> Any:
        """The result for clouds that are all changed alike."""
        return self.fit([change(cloud) for cloud in self.clouds])

    def vertices(self, found: Any) -> np.ndarray:
        """Points of all surfaces of a result, (m, 3)."""
        return np.concatenate([model.mesh(name, 6).vertices for model, name in self.surfaces(found)])

    def bytes_of(self, found: Any) -> bytes:
        """Surfaces, rows and words of a result: equal when it is the same to the last bit."""
        numbers = [self.vertices(found), *self.rows(found)]
        return b"".join(each.tobytes() for each in numbers) + repr(sorted(found.warnings.items())).encode()

    def apart(self, one: Any, other: Any) -> float:
        """Largest distance between the surfaces of two results, of their RMS radius."""
        pairs = zip(self.surfaces(one), self.surfaces(other), strict=True)
        return max(gap(a, b, name) for (a, name), (b, _) in pairs)

    def off(self, found: Any, carry: Callable[[np.ndarray], np.ndarray]) -> float:
        """Largest distance of the plain surfaces, carried along, to those of a result, of the RMS radius."""
        largest = 0.0
        for (before, name), (after, _) in zip(self.surfaces(self.plain), self.surfaces(found), strict=True):
            points = carry(before.mesh(name, 6).vertices)
            largest = max(largest, np.abs(after.distance(points, name)).max() / Frame.of(points).scale)
        return largest


def twice_is_the_same_and_the_input_is_left_alone(fitter: Fitter) -> None:
    """To the last bit, whatever the global random state, which stays as it was.

    Arrays stay as they were during the fit, and the result has no part of them.
    """
    first, given = fitter.bytes_of(fitter.plain), [cloud.copy() for cloud in fitter.clouds]
    before = hashlib.sha256(b"".join(map(np.ndarray.tobytes, given))).digest()
    state = np.random.get_state()
    try:
        np.random.seed(20)
        drawn = np.random.get_state()[1].copy()
        found = fitter.fit(given)
        np.testing.assert_array_equal(np.random.get_state()[1], drawn)
    finally:
        np.random.set_state(state)
    assert hashlib.sha256(b"".join(map(np.ndarray.tobytes, given))).digest() == before
    for cloud in given:
        cloud[:] = np.nan
    assert fitter.bytes_of(found) == first


def order_does_not_matter(fitter: Fitter) -> None:
    found = fitter.of(lambda cloud: cloud[::-1])
    assert fitter.apart(found, fitter.plain) < fitter.tolerance
    for one, other in zip(fitter.rows(found), fitter.rows(fitter.plain), strict=True):
        np.testing.assert_allclose(one[::-1], other, atol=1e-4 * np.abs(other).max())


def surfaces_move_with_their_points_also_mirrored_and_in_another_unit(fitter: Fitter) -> None:
    def carry(points: np.ndarray) -> np.ndarray:
        return 1e-3 * (points * [1, -1, 1] @ TURN.T + [500.0, -30, 12])

    found = fitter.of(carry)
    assert fitter.off(found, carry) < fitter.tolerance
    assert found.warnings.keys() == fitter.plain.warnings.keys()


DRESSES: dict[str, Callable[[np.ndarray], Any]] = {
    "18 longdouble, 21 Fortran order": lambda cloud: np.asfortranarray(cloud.astype(np.longdouble)),
    "19 list": np.ndarray.tolist,
    "19 __array__, 22 big endian": lambda cloud: Table(cloud.astype(">f8")),
    "21 every second row, negative strides, read-only": lambda cloud: np.frombuffer(
        np.repeat(cloud[::-1, ::-1], 2, axis=0).tobytes()
    ).reshape(-1, 3)[::-2, ::-1],
}


class Table:
    """What a table of another library offers to NumPy."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype)


def dress_does_not_matter(fitter: Fitter) -> None:
    """The same numbers give the same bytes; several dresses at once where there are several clouds."""
    dresses, count = list(DRESSES.values()), len(fitter.clouds)
    for first in range(0, len(dresses), count):
        worn = [dresses[(first + i) % len(dresses)] for i in range(count)]
        found = fitter.fit([dress(cloud) for dress, cloud in zip(worn, fitter.clouds)])
        assert fitter.bytes_of(found) == fitter.bytes_of(fitter.plain)


def single_precision_is_near(fitter: Fitter) -> None:
    found = fitter.of(lambda cloud: cloud.astype(np.float32))
    largest = max(np.abs(cloud).max() / Frame.of(cloud).scale for cloud in fitter.clouds)
    assert fitter.apart(found, fitter.plain) < 1e-6 * max(1, largest)


def surfaces_are_near_their_points(fitter: Fitter) -> None:
    found = fitter.plain
    for cloud, (model, name), rows in zip(fitter.clouds, fitter.surfaces(found), fitter.rows(found), strict=True):
        assert np.sqrt((model.distance(cloud, name) ** 2).mean()) < 0.05 * Frame.of(cloud).scale
        assert rows.shape == (len(cloud),)


def warnings_are_named(fitter: Fitter) -> None:
    """Far from the origin digits are lost: that is said, by a known kind with a sentence, and no number is NaN."""
    found = fitter.of(lambda cloud: cloud + FAR)
    assert found.status == "warned" and "PRECISION_LOSS" in found.warnings
    for kind, sentence in found.warnings.items():
        assert isinstance(kind, WarningKind) and sentence
    assert np.isfinite(fitter.vertices(found)).all()
    assert all(np.isfinite(each).all() for each in fitter.rows(found))
    assert (fitter.plain.status == "ok") == (not fitter.plain.warnings)


def callers_may_let_numpy_raise(fitter: Fitter) -> None:
    with np.errstate(all="raise"):
        assert fitter.bytes_of(fitter.fit(fitter.clouds)) == fitter.bytes_of(fitter.plain)


CHECKS = [
    twice_is_the_same_and_the_input_is_left_alone,
    order_does_not_matter,
    surfaces_move_with_their_points_also_mirrored_and_in_another_unit,
    dress_does_not_matter,
    single_precision_is_near,
    surfaces_are_near_their_points,
    warnings_are_named,
    callers_may_let_numpy_raise,
]
