"""A stack of label images whose slices were shifted by known amounts: tracking finds them."""

import numpy as np
import pytest

import quadriform as qf
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.slice_numbers import BETWEEN, slice_numbers
from quadriform.imaging.volume import Volume

TURN = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
PIXEL, APART, SLICES = 2.0, 8.0, 9
GRID = np.eye(4)
GRID[:3] = np.column_stack([TURN * [PIXEL, PIXEL, APART], [-40.0, -50, -20]])
OFFSETS = np.zeros((SLICES, 2))
OFFSETS[3:7] = [[1, -0.5], [-3, 1.5], [3, -1.5], [-1, 0.5]]
"""Of the slices in their planes, in mm along both axes. No mean, trend or bend: the model would move with these."""


def labels(size):
    """A ventricle that the first slice cuts, each slice moved by its offset."""
    at = (np.moveaxis(np.indices((36, 36, SLICES)), 0, -1) - [17.5, 17.5, 0.0]) * [PIXEL, PIXEL, APART]
    at[..., :2] -= OFFSETS
    return Volume(((at / size) ** 2).sum(axis=-1) < 1, GRID)


@pytest.mark.slow
def test_the_shifts_of_slices_of_an_image_are_found():
    clouds, numbers = [], []
    for size in ((26, 24, 62), (22, 20, 58)):
        volume = labels(size)
        points = points_from_image(volume, select=0.5).points
        of = slice_numbers(volume, points)
        clouds.append(points[of != BETWEEN])
        numbers.append(of[of != BETWEEN])
    found = qf.track(clouds, slices=numbers, box=(3, 3, 3), strength=1e-5)
    shifts = np.array([TURN.T @ shift for shift in found.shifts.values()])
    assert list(found.shifts) == list(range(8))  # the ninth slice is empty
    np.testing.assert_allclose(shifts[:, 2], 0, atol=1e-9)
    counts = np.bincount(np.concatenate(numbers))
    np.testing.assert_allclose(counts @ shifts, 0, atol=1e-3 * counts.sum())
    np.testing.assert_allclose(shifts[:, :2], -OFFSETS[:8], atol=0.1 * PIXEL)
