"""Each point of an isosurface knows its slice: shifted slices take their own points along, and no others."""

import numpy as np
import pytest

from quadriform.imaging.image_points import BETWEEN, CAP, slice_axis, slice_numbers
from quadriform.imaging.isosurface import isosurface
from quadriform.imaging.volume import Volume

LONG = np.array([[1.2, -0.9, 0.4, -12.0], [0.9, 1.2, 0.3, 30.0], [-0.1, 0.2, 7.9, 5.0], [0, 0, 0, 1]])
"""Oblique, 1.5 x 1.5 x 7.9."""


def egg(shape=(30, 32, 9)):
    """An ellipsoid of ones that ends within the image; slices 2 to 7 cut it."""
    at = (np.moveaxis(np.indices(shape), 0, -1) - [13.2, 15.1, 4.4]) / [9, 11, 3.2]
    return ((at**2).sum(axis=-1) < 1).astype(np.uint8)


def numbered(values, affine=LONG):
    volume = Volume(values, affine)
    points = isosurface(volume).mesh.vertices
    return volume, points, slice_numbers(volume, points)


def test_points_of_outlines_have_their_slice_and_the_others_none():
    """Outlines lie in slices, other points half-way between two, those of caps beyond the first or the last outline."""
    volume, points, numbers = numbered(egg())
    along = volume.voxels(points)[:, 2]
    slices = np.flatnonzero(egg().any(axis=(0, 1)))
    assert set(numbers) == {CAP, BETWEEN, *slices}
    np.testing.assert_allclose(along[numbers >= 0], numbers[numbers >= 0], atol=1e-9)
    np.testing.assert_allclose(along[numbers < 0] % 1, 0.5, atol=1e-9)
    caps = along[numbers == CAP]
    assert (caps < slices[0]).sum() == egg()[:, :, slices[0]].sum()
    assert (caps > slices[-1]).sum() == egg()[:, :, slices[-1]].sum()
    assert ((along[numbers == BETWEEN] - slices[0]) * (slices[-1] - along[numbers == BETWEEN]) > 0).all()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
@pytest.mark.parametrize("mirror", [1, -1])
def test_the_axes_of_the_file_and_its_handedness_do_not_matter(order, mirror):
    """The same image with its axes in another order, or one of them turned over."""
    _, points, numbers = numbered(egg())
    values, affine = egg()[::mirror], LONG.copy()
    if mirror < 0:
        affine[:3, 3] += affine[:3, 0] * (len(values) - 1)
        affine[:3, 0] *= -1
    _, moved, other = numbered(values.transpose(order), affine[:, [*order, 3]])
    here, there = (np.lexsort(np.round(cloud, 6).T) for cloud in (points, moved))
    np.testing.assert_allclose(points[here], moved[there], atol=1e-5)
    assert np.array_equal(numbers[here], other[there])


def test_a_shifted_slice_takes_its_outline_along():
    """Each slice moved by whole voxels: the points of its number move by just that, in the world."""
    offsets = np.array([[0, 0], [0, 0], [1, -1], [2, 0], [0, 3], [-2, 1], [0, -1], [1, 1], [0, 0]])
    moved = np.stack([np.roll(egg()[:, :, k], offsets[k], axis=(0, 1)) for k in range(9)], axis=2)
    (_, before, own), (_, after, theirs) = numbered(egg()), numbered(moved)
    for k in range(2, 8):
        shift = LONG[:3, :2] @ offsets[k]
        here, there = (
            np.unique(np.round(cloud, 6), axis=0) for cloud in (before[own == k] + shift, after[theirs == k])
        )
        np.testing.assert_allclose(here, there, atol=2e-6)
        assert len(there) > 30


def test_the_axis_is_that_of_the_largest_spacing_and_of_equal_ones_the_last():
    assert slice_axis(LONG) == 2
    assert slice_axis(LONG[:, [2, 0, 1, 3]]) == 0
    assert slice_axis(np.diag([1.0, 1, 1, 1])) == 2
    assert slice_axis(np.diag([2.0, 2.0001, 1, 1])) == 1


def test_an_object_without_outlines_has_points_of_no_slice():
    """It fills its slices, and ends between two of them."""
    values = np.zeros((4, 4, 6))
    values[:, :, 2:4] = 1
    assert set(numbered(values)[2]) == {CAP}
