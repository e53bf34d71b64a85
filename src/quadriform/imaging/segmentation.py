"""One object in an image: threshold or labels, a connected component, closing, holes (paper 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import DegenerateError, MaskError, OptionError, WarningKind, Warnings
from quadriform.imaging.object_choice import Labels, Percentile, Select, choose_object, counted
from quadriform.imaging.segments import described
from quadriform.imaging.volume import Region, Volume, check_region, index_of
from quadriform.imaging.voxel_faces import border_cut_text
from quadriform.points import check_number
from quadriform.words import short_repr

Mask = NDArray[np.bool_]

ANISOTROPIC = 4.0
"""Ratio of the largest to the smallest spacing above which ANISOTROPIC is reported."""

Component = Literal["largest", "all"] | Sequence[int]
"""Which connected component is kept; a seed is a voxel (i, j, k) of the whole image."""


@dataclass(frozen=True, repr=False)
class Segmentation:
    """An object, and the threshold and components by which it was found.

    Attributes:
        mask: (i, j, k) bool, of the whole image; False outside the region.
        volume: the whole image.
        region: the voxels that were used.
        threshold: values above it were the object; None for labels.
        component_voxels: sizes of all components found, largest first, before closing.
        components_kept: how many of them `mask` contains.
        hole_voxels: in enclosed holes after closing; part of `mask` when filled.
        warnings: BORDER_CUT, ANISOTROPIC.
        notes: what was assumed about the object, one sentence each.
    """

    __repr__ = short_repr

    mask: Mask
    volume: Volume
    region: Region
    threshold: float | None
    component_voxels: tuple[int, ...]
    components_kept: int
    hole_voxels: int
    warnings: Warnings
    notes: tuple[str, ...] = ()

    def object_volume(self) -> Volume:
        """Return the mask inside the region, as an image of 0 and 1 at its position in the world."""
        whole = Volume(self.mask.view(np.uint8), self.volume.world_from_voxel, self.volume.space, self.volume.unit)
        return whole.crop(self.region)


def segment(
    volume: Volume,
    *,
    select: Select = "auto",
    region: Region | None = None,
    component: Component = "largest",
    connectivity: Literal[6, 26] = 26,
    closing: int = 0,
    fill_holes: bool = False,
) -> Segmentation:
    """Return one object of an image: threshold, component, closing, in the order of the paper (section 5).

    Args:
        volume: grey image, mask or label image.
        select: a value, `Percentile(fraction, of)`, "otsu" or `Labels(values)`; "auto" decides by the whole image, as
            `choose_object` does.
        region: half-open ranges of voxels ((i0, i1), (j0, j1), (k0, k1)); None is the whole image. Nothing
            outside it is used, by Otsu and percentiles neither, and its edge counts as a border.
        component: "largest", "all", or a voxel (i, j, k) of the component.
        connectivity: 26 joins voxels that share a corner, 6 only those that share a face.
        closing: number of dilations, then of erosions, with the 6-connected cross.
        fill_holes: fill what the object encloses.

    Raises:
        MaskError: nothing or everything is the object, labels are missing or not whole, the seed is background, or
            "auto" finds several objects and none is chosen.
        DegenerateError: the object is one voxel, or one slice thick.
        OptionError: an option is unknown or out of its range.
    """
    _check_options(component, connectivity, closing)
    region = check_region(region, volume.values.shape)
    select, notes = choose_object(volume) if select == "auto" else (select, ())
    inner = volume.crop(region)
    found, threshold = _select(inner, select)
    _check_selected(found, inner.values, threshold)
    kept, sizes, n_kept = _keep(found, component, connectivity, region)
    kept = _close(kept, closing)  # section 5
    holes = _holes(kept)
    if fill_holes:
        kept |= holes
    _check_object(kept, inner.values, threshold)

    mask = np.zeros(volume.values.shape, dtype=bool)
    mask[index_of(region)] = kept
    warnings = volume.warnings | _warnings_of(kept, inner)
    return Segmentation(mask, volume, region, threshold, sizes, n_kept, int(holes.sum()), warnings, notes)


def _check_options(component: Component, connectivity: int, closing: int) -> None:
    named = isinstance(component, str) and component in ("largest", "all")
    if not named and (isinstance(component, str) or len(component) != 3 or not _whole(*component)):
        raise OptionError(f"option component={component!r}; expected 'largest', 'all' or a voxel (i, j, k)")
    if connectivity not in (6, 26):
        raise OptionError(f"option connectivity={connectivity!r}; expected 6 or 26")
    if not _whole(closing) or closing < 0:
        raise OptionError(f"option closing={closing!r}; expected a whole number of steps >= 0")


def _whole(*numbers: object) -> bool:
    return all(isinstance(number, (int, np.integer)) and not isinstance(number, bool) for number in numbers)


def _select(inner: Volume, select: Select) -> tuple[Mask, float | None]:
    if isinstance(select, Labels):
        labels = inner.label_values(select.values)
        if select.values and not labels:
            raise MaskError(
                f"the segment {', '.join(map(str, select.values))} has no voxels; {described(inner.segments)}"
            )
        return _labelled(inner.values, labels), None
    threshold = _threshold(inner.values, select)
    return inner.values > threshold, threshold


def _threshold(values: NDArray[Any], select: float | Percentile | str) -> float:
    if isinstance(select, Percentile):
        fraction = check_number(select.fraction, "fraction", 0.0)
        return fraction * float(np.percentile(values, check_number(select.of, "of", 0.0, 100.0)))
    if select == "otsu":
        return otsu(values)
    if isinstance(select, str):
        raise OptionError(f"option select={select!r}; expected a number, a Percentile, Labels, 'otsu' or 'auto'")
    return check_number(select, "select", -np.inf)


def otsu(values: NDArray[Any]) -> float:
    """Return Otsu's threshold of all values, exact for every type (Otsu 1979).

    Raises:
        MaskError: there is only one value.
    """
    from skimage.filters import threshold_otsu

    present, counts = counted(values)
    if len(present) == 1:
        raise MaskError(f"all voxels are {present[0]:g}: there is no object and background to distinguish")
    # by a count of each value, for skimage would put floats into 256 bins
    return float(threshold_otsu(hist=(counts, present.astype(np.float64))))


def _labelled(values: NDArray[Any], labels: Sequence[int]) -> Mask:
    if not labels or not _whole(*labels):
        raise OptionError(f"option Labels({labels!r}); expected one or more whole numbers")
    if values.dtype.kind == "f" and not np.array_equal(values, np.round(values)):
        raise MaskError(f"not a label image: {int((values != np.round(values)).sum())} values are not whole numbers")
    missing = [int(label) for label in labels if not (values == label).any()]
    if missing:
        raise MaskError(f"no voxel has the label {', '.join(map(str, missing))}; {_describe(values)}")
    return np.isin(values, labels)


def _keep(found: Mask, component: Component, connectivity: int, region: Region) -> tuple[Mask, tuple[int, ...], int]:
    """The requested component, the sizes of all, and how many are kept."""
    from scipy import ndimage

    labels, n = ndimage.label(found, ndimage.generate_binary_structure(3, 1 if connectivity == 6 else 3))
    counts = np.bincount(labels.ravel(), minlength=n + 1)[1:]  # 0 is the background
    sizes = tuple(int(size) for size in np.sort(counts)[::-1])
    if component == "all":
        return found, sizes, n
    kept = int(counts.argmax()) + 1 if component == "largest" else _label_at(labels, component, region)
    return labels == kept, sizes, 1


def _label_at(labels: NDArray[Any], seed: Sequence[int] | str, region: Region) -> int:
    voxel = tuple(int(n) for n in seed)
    if not all(low <= n < high for n, (low, high) in zip(voxel, region)):
        raise OptionError(f"option component={voxel}: this voxel is outside the region {region}")
    label = int(labels[tuple(n - low for n, (low, _) in zip(voxel, region))])
    if label == 0:
        raise MaskError(f"the seed voxel {voxel} is background; choose a voxel of the object")
    return label


def _close(mask: Mask, steps: int) -> Mask:
    """Closing on a padded image, so that the border does not erode the object."""
    from scipy import ndimage

    if steps == 0:
        return mask
    cross = ndimage.generate_binary_structure(3, 1)  # 6-connected
    closed = ndimage.binary_closing(np.pad(mask, steps), cross, iterations=steps)
    return closed[(slice(steps, -steps),) * 3]


def _holes(mask: Mask) -> Mask:
    """Background that is not 6-connected to the outside."""
    from scipy import ndimage

    return ndimage.binary_fill_holes(mask) & ~mask


def _check_selected(found: Mask, values: NDArray[Any], threshold: float | None) -> None:
    rule = "these labels" if threshold is None else f"above the threshold {threshold:g}"
    if not found.any():
        raise MaskError(f"the mask is empty: no voxel is {rule}; {_describe(values)}")
    if found.all():
        raise MaskError(f"the mask is full: all {found.size} voxels are {rule}; {_describe(values)}")


def _check_object(mask: Mask, values: NDArray[Any], threshold: float | None) -> None:
    _check_selected(mask, values, threshold)
    # extents of the bounding box: a body needs two voxels along each axis
    extent = tuple(int(np.ptp(index)) + 1 for index in np.nonzero(mask))
    if extent == (1, 1, 1):
        raise DegenerateError("the object is one voxel; expected a body of several voxels along each axis")
    if 1 in extent:
        raise DegenerateError(f"the object is one slice thick ({' x '.join(map(str, extent))} voxels); expected a body")


def _describe(values: NDArray[Any]) -> str:
    """A sentence with the values of an image, and their counts where there are at most 20."""
    present, counts = counted(values)
    if len(present) > 20:
        return f"the values run from {present[0]:g} to {present[-1]:g}"
    return "values and voxels: " + ", ".join(f"{value:g}: {n}" for value, n in zip(present, counts))


def _warnings_of(mask: Mask, volume: Volume) -> Warnings:
    """BORDER_CUT and ANISOTROPIC of an object in an image."""
    warnings: Warnings = {}
    if cut := border_cut_text(mask, volume.world_from_voxel):
        warnings[WarningKind.BORDER_CUT] = cut
    ratio = float(volume.spacing.max() / volume.spacing.min())
    if ratio > ANISOTROPIC:
        spacing = " x ".join(f"{step:.3g}" for step in volume.spacing)
        warnings[WarningKind.ANISOTROPIC] = (
            f"voxels of {spacing}, {ratio:.1f} to 1: the surface is coarse along one axis"
        )
    return warnings
