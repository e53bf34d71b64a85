"""The blood pool of a ventricle, from grey short-axis slices, a region and one voxel of blood."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.morphology import convex_hull_image

from quadriform.imaging.segmentation import Mask, otsu, segment
from quadriform.imaging.volume import Region, Volume, index_of


def blood_pool(volume: Volume, seed: Sequence[int], region: Region) -> Mask:
    """The cavity (i, j, k), where blood is bright: Otsu in each slice, opening, component of the seed, convex outline.

    Each slice has its own threshold, because the sensitivity of a surface coil decreases with depth. Slices are those
    across the axis with the largest spacing. They are filled to their convex outlines: papillary muscles count as
    cavity, as is usual for volumes.

    Args:
        volume: grey image with blood brighter than muscle.
        seed: voxel (i, j, k) of the whole image that is blood of this cavity.
        region: half-open ranges of voxels about the ventricle, with dark surroundings in every slice.

    Raises:
        MaskError: the seed is no blood.
    """
    axis = int(volume.spacing.argmax())  # slices of a short-axis stack are thicker than pixels
    inner = index_of(region)
    mask = np.zeros(volume.values.shape, dtype=bool)
    mask[inner] = _each_slice(volume.values[inner], axis, _opened_blood)
    found = segment(replace(volume, values=mask), select=0.5, region=region, component=seed).mask
    found[inner] = _each_slice(found[inner], axis, _convex_outline)
    return found


def _each_slice(values: NDArray[Any], axis: int, change: Callable[[NDArray[Any]], Mask]) -> Mask:
    changed = [change(image) for image in np.moveaxis(values, axis, 0)]
    return np.moveaxis(np.stack(changed), 0, axis)


def _opened_blood(image: NDArray[Any]) -> Mask:
    """The bright pixels of a slice after a morphological opening, which separates the cavity from what it touches."""
    bright = image > otsu(image) if np.ptp(image) else np.zeros(image.shape, dtype=bool)
    return ndimage.binary_opening(bright)


def _convex_outline(image: Mask) -> Mask:
    return convex_hull_image(image) if image.any() else image
