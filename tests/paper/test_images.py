"""Section 5: from an image to the points, by threshold, largest component, closing and isosurface."""

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, generate_binary_structure

from quadriform.imaging.isosurface import isosurface
from quadriform.imaging.segmentation import segment
from quadriform.imaging.volume import Volume

SPACING = 2.0
RADIUS = 10.0


def ball():
    """Voxels within 10 of the middle."""
    return ((np.indices((32, 32, 32)) - 16.0) ** 2).sum(axis=0) < RADIUS**2


def image():
    """A bright ball with a crack half through it, and a bright speck in a corner, on a dark noisy ground."""
    bright = ball()
    bright[16:, :, 14] = False
    bright[1:4, 1:4, 1:4] = True
    return Volume(100.0 * bright + np.random.default_rng(0).normal(0, 5, bright.shape), np.diag([*[SPACING] * 3, 1.0]))


def test_an_object_of_an_image_becomes_its_points():
    """The speck is left out, the crack is bridged, and the points are as many voxels from the middle as the ball's."""
    found = segment(image(), select=50.0, component="largest", closing=1)
    cross = generate_binary_structure(3, 1)
    cracked = ball()
    cracked[16:, :, 14] = False
    np.testing.assert_array_equal(found.mask, binary_erosion(binary_dilation(cracked, cross), cross))
    assert (found.mask & ~cracked).sum() > 0.8 * (ball() & ~cracked).sum()
    points = isosurface(found.object_volume()).mesh.vertices
    from_middle = np.linalg.norm(points - SPACING * 16, axis=1) / SPACING
    assert np.quantile(np.abs(from_middle - RADIUS), 0.9) < 0.8
    np.testing.assert_allclose(points.mean(axis=0), SPACING * 16, atol=0.2 * SPACING)
