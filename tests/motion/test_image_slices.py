"""Stacks of label images whose slices were shifted by known amounts, or were not: tracking finds just that."""

import numpy as np

import quadriform as qf
from quadriform.imaging.image_points import BETWEEN, points_from_image, slice_numbers
from quadriform.imaging.volume import Volume

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


def test_the_shifts_of_slices_of_an_image_are_found():
    """But for the part that is smooth along the stack, which the model follows itself."""
    clouds, numbers = stack(OFFSETS)
    shifts = found_shifts(clouds, numbers)
    smooth = np.polynomial.polynomial.polyvander(np.arange(len(shifts)), 3)
    rough = OFFSETS - smooth @ np.linalg.lstsq(smooth, OFFSETS, rcond=None)[0]
    np.testing.assert_allclose(shifts[:, :2].mean(axis=0), 0, atol=1e-3)
    np.testing.assert_allclose(shifts[:, 2], 0, atol=0.01 * PIXEL)
    np.testing.assert_allclose(shifts[:, :2], -rough, atol=0.15 * PIXEL)
    assert np.abs(rough).max() > PIXEL


def test_a_bent_ventricle_in_slices_that_did_not_move_is_not_straightened():
    shifts = found_shifts(*stack(0 * OFFSETS, bend=8.0))
    assert np.abs(shifts).max() < 0.25 * PIXEL
