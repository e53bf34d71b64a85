"""Stacks of label images whose slices were shifted by known amounts, or were not: tracking finds just that."""

import numpy as np
import pytest

import quadriform as qf
from quadriform.imaging.image_points import BETWEEN, points_from_image, slice_numbers
from quadriform.imaging.volume import Volume
from quadriform.motion.slice_shifts import SlicePlanes

TURN = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
PIXEL, APART, SLICES = 2.0, 8.0, 9
GRID = np.eye(4)
GRID[:3] = np.column_stack([TURN * [PIXEL, PIXEL, APART], [-40.0, -50, -20]])
OFFSETS = np.random.default_rng(5).normal(scale=2, size=(SLICES - 1, 2))
"""mm, of the slices in their planes; the ninth slice is empty."""


def stack(offsets, bend=0.0):
    """Outlines and caps of a ventricle at two times, with their slices; the first slice cuts it, its axis may bend."""
    clouds, numbers = [], []
    for size in ((26, 24, 62), (22, 20, 58)):
        at = (np.moveaxis(np.indices((44, 44, SLICES)), 0, -1) - [21.5, 21.5, 0.0]) * [PIXEL, PIXEL, APART]
        at[:, :, : len(offsets), :2] -= offsets
        at[..., 0] -= bend * ((at[..., 2] / 30 - 1) ** 2 - 0.4)
        volume = Volume(((at / size) ** 2).sum(axis=-1) < 1, GRID)
        points = points_from_image(volume, select=0.5).points
        of = slice_numbers(volume, points)
        clouds.append({"endo": points[of != BETWEEN]})
        numbers.append({"endo": of[of != BETWEEN]})
    return clouds, numbers


def found_shifts(clouds, numbers):
    """(S, 3), along the axes of the image."""
    found = qf.track(clouds, slices=numbers, box=(3, 3, 3), strength=1e-5)
    assert list(found.shifts) == list(range(SLICES - 1))
    return np.array([TURN.T @ shift for shift in found.shifts.values()])


def weights(numbers):
    """Points of each slice, (S,), as shares."""
    together = np.concatenate([frame["endo"] for frame in numbers])
    counts = np.bincount(together[together >= 0])
    return counts / counts.sum()


def test_the_shifts_of_slices_of_an_image_are_found():
    """But for the part that is smooth along the stack, which the model follows itself."""
    clouds, numbers = stack(OFFSETS)
    shifts, shares = found_shifts(clouds, numbers), weights(numbers)
    smooth = np.polynomial.polynomial.polyvander(np.arange(len(shares)), 3)
    root = np.sqrt(shares)[:, None]
    rough = OFFSETS - smooth @ np.linalg.lstsq(root * smooth, root * OFFSETS, rcond=None)[0]
    np.testing.assert_allclose(shares @ shifts, 0, atol=1e-3)
    np.testing.assert_allclose(shifts[:, 2], 0, atol=1e-9)
    np.testing.assert_allclose(shifts[:, :2], -rough, atol=0.15 * PIXEL)
    assert np.abs(rough).max() > PIXEL


def test_a_bent_ventricle_in_slices_that_did_not_move_is_not_straightened():
    shifts = found_shifts(*stack(0 * OFFSETS, bend=8.0))
    assert np.abs(shifts).max() < 0.25 * PIXEL


@pytest.mark.parametrize("crossed", [False, True])
def test_what_is_held_is_smooth_along_a_stack_and_the_mean_of_slices_that_cross(crossed):
    """Sums whose weights are the points of the slices times a power of the height: up to the third, or the zeroth."""
    clouds, numbers = stack(0 * OFFSETS)
    if crossed:
        points = np.concatenate([clouds[0]["endo"], clouds[1]["endo"]])
        clouds[0]["endo"] = np.concatenate([clouds[0]["endo"], points[np.abs(points[:, 0] - points[0, 0]) < 3]])
        more = len(clouds[0]["endo"]) - len(numbers[0]["endo"])
        numbers[0]["endo"] = np.concatenate([numbers[0]["endo"], np.full(more, 20)])
    planes = SlicePlanes.of(clouds, numbers)
    held = planes.unobservable()
    assert held.shape == (2 * len(planes.numbers), 3 if crossed else 12)
    inside = np.linalg.lstsq(held, np.eye(len(held)), rcond=None)[0]
    height = planes.centres[:, 2] - planes.centres[:, 2].mean()
    for power in range(5):
        shift = height**power / np.abs(height**power).max()
        along = np.einsum("s,a,ska->sk", planes.counts * shift, TURN[0], planes.axes).ravel()
        missed = np.abs(held @ (inside @ along) - along).max() / np.abs(along).max()
        assert (missed < 1e-9) == (power == 0 or (power <= 3 and not crossed))
