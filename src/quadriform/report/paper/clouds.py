"""A synthetic image of the paper's third kind."""

import numpy as np

from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.imaging.volume import Volume
from quadriform.shapes.voxels import voxels_inside

SCANNER = ((98, 100, 110), 0.926)
"""Voxels and their side in mm of the paper's third image, by the Dynamic Spatial Reconstructor (p. 47)."""
BRIGHTNESS = (40.0, 90.0, 200.0)
"""Background, muscle and blood with its contrast agent."""


def scanner_image() -> Volume:
    """The undeformed synthetic ventricle as the paper's scanner shows one: bright blood, dark muscle, blur, noise."""
    from scipy.ndimage import gaussian_filter

    shape, side = SCANNER
    model = SyntheticVentricle().model(0.0)
    # the centre of the heart is that of the image, whose first voxel is half its size away
    corner = model.mesh("epi").vertices.mean(axis=0) - side * (np.array(shape) - 1) / 2
    affine = np.diag([side, side, side, 1.0])
    affine[:3, 3] = corner
    volume = Volume(np.full(shape, BRIGHTNESS[0]), affine)
    # the outer wall first: the cavity is filled over it
    for name, value in zip(("epi", "endo"), BRIGHTNESS[1:]):
        mesh = model.mesh(name, 48)
        inside = voxels_inside(type(mesh)(volume.voxels(mesh.vertices), mesh.faces), shape)
        volume.values[inside] = value
    # noise of a reconstruction is correlated between neighbours, unlike that of a detector
    noise = np.random.default_rng(3).normal(0, 12.0, shape)
    return Volume(gaussian_filter(volume.values, 1.0) + gaussian_filter(noise, 0.7), affine)
