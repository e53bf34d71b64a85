"""The blood pool of a ventricle, from grey short-axis slices, a region and one voxel of blood."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.imaging.segmentation import Mask, Segmentation, check_steps, otsu, segment, segment_warnings
from quadriform.imaging.volume import Region, Volume, check_region, slices


def blood_pool(
    volume: Volume, *, seed: Sequence[int], region: Region | None = None, opening: int = 1, papillaries: bool = True
) -> Segmentation:
    """Return the cavity, where blood is bright: Otsu in each slice, opening, component of the seed, convex outline.

    Each slice has its own threshold, because the sensitivity of a surface coil decreases with depth. Slices are those
    across the axis with the largest spacing.

    Args:
        volume: grey image with blood brighter than muscle.
        seed: voxel (i, j, k) of the whole image that is blood of this cavity.
        region: half-open ranges of voxels about the ventricle, ending at the base; nothing outside it is used.
            It should contain dark surroundings as well as blood in every slice. BORDER_CUT names its faces that the
            cavity touches.
        opening: number of erosions, then of dilations, in each slice, that separate the cavity from what it touches.
        papillaries: papillary muscles count as cavity, as is usual for volumes: each slice is filled to its convex
            outline. Otherwise only enclosed holes are filled.

    Raises:
        MaskError: the seed is no blood.
        DegenerateError: the cavity is one slice thick.
        OptionError: the region leaves the image, the seed leaves the region, or `opening` is no number of steps.
    """
    check_steps(opening, "opening")
    inner = slices(check_region(region, volume.values.shape))
    axis = int(volume.spacing.argmax())  # slices of a short-axis stack are thicker than pixels
    mask = np.zeros(volume.values.shape, dtype=bool)
    mask[inner] = _each_slice(volume.values[inner], axis, lambda image: _opened(_bright(image), opening))
    found = segment(replace(volume, values=mask), select=0.5, region=region, component=seed)
    cavity = np.zeros_like(mask)
    cavity[inner] = _each_slice(found.mask[inner], axis, lambda image: _filled(image, papillaries))
    warnings = volume.warnings | segment_warnings(cavity[inner], volume.crop(found.region))
    return replace(found, mask=cavity, volume=volume, threshold=None, warnings=warnings)


def _each_slice(values: NDArray[Any], axis: int, change: Any) -> Mask:
    changed = [change(image) for image in np.moveaxis(values, axis, 0)]
    return np.moveaxis(np.stack(changed), 0, axis)


def _bright(image: NDArray[Any]) -> Mask:
    return image > otsu(image) if np.ptp(image) else np.zeros(image.shape, dtype=bool)


def _opened(image: Mask, steps: int) -> Mask:
    from scipy import ndimage

    return ndimage.binary_opening(image, iterations=steps) if steps else image


def _filled(image: Mask, convex: bool) -> Mask:
    from scipy import ndimage
    from skimage.morphology import convex_hull_image

    if convex and image.any():
        return convex_hull_image(image)
    return ndimage.binary_fill_holes(image)
