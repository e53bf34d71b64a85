"""An image, and the transform from its voxels to the world."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import AffineError, MaskError, OptionError, Warnings
from quadriform.files.metadata import check_space_and_unit
from quadriform.imaging.segments import Segment, values_of
from quadriform.points import Array, check_points
from quadriform.shapes.voxels import voxel_spacing
from quadriform.words import short_repr

Region = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""Half-open ranges of voxels, ((i0, i1), (j0, j1), (k0, k1))."""

SINGULAR = 1e-6
"""A transform is singular when its determinant is below this fraction of the product of its column lengths."""


@dataclass(frozen=True, repr=False)
class Volume:
    """A three-dimensional image.

    Attributes:
        values: (i, j, k), finite real numbers or booleans; this package never changes them.
        world_from_voxel: (4, 4), maps voxel centres (i, j, k, 1) to the world.
        space: coordinate frame of the world, "LPS", "RAS" or "unknown".
        unit: of lengths in the world, "mm", "m" or "unknown".
        warnings: of reading the file.
        segments: named parts of the file, as DICOM segmentations, .seg.nrrd and label tables of NIfTI do.
        is_label_map: whether the file states that its values are labels.

    Raises:
        MaskError: `values` have another shape or type, or NaN or infinite voxels.
        AffineError: `world_from_voxel` is not finite, singular or of another shape.
    """

    __repr__ = short_repr

    values: NDArray[Any]
    world_from_voxel: Array
    space: str = "LPS"
    unit: str = "mm"
    warnings: Warnings = field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    is_label_map: bool = False

    def __post_init__(self) -> None:
        values, affine = np.asarray(self.values), np.array(self.world_from_voxel, dtype=np.float64)
        _check_values(values)
        if fault := affine_fault(affine):
            raise AffineError(f"world_from_voxel: {fault}; found {affine.tolist()}")
        check_space_and_unit(self.space, self.unit)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "world_from_voxel", affine)

    @property
    def spacing(self) -> Array:
        """Distances between the centres of neighbouring voxels along i, j and k, (3,), from the full affine."""
        return voxel_spacing(self.world_from_voxel)

    def points_world(self, voxels: ArrayLike) -> Array:
        """Return world points (n, 3) of voxel coordinates (n, 3), which may lie between voxel centres.

        Raises:
            PointsError: `voxels` are not finite numbers of shape (n, 3).
        """
        return check_points(voxels, "voxels") @ self.world_from_voxel[:3, :3].T + self.world_from_voxel[:3, 3]

    def voxels(self, points: Array) -> Array:
        """Return voxel coordinates (n, 3) of world points (n, 3): the inverse of `points_world`."""
        affine = self.world_from_voxel
        return np.asarray(np.linalg.solve(affine[:3, :3], (points - affine[:3, 3]).T).T, dtype=np.float64)

    def label_values(self, labels: tuple[int | str, ...]) -> tuple[int, ...]:
        """Return the voxel values of labels, given as numbers or as names of segments.

        Raises:
            OptionError: no segment has this name, or several have it.
        """
        parts = (values_of(self.segments, label) for label in labels)
        return tuple(dict.fromkeys(value for part in parts for value in part))

    def crop(self, region: Region) -> Volume:
        """Return the part inside `region`, at the same position in the world.

        Raises:
            OptionError: `region` is empty or leaves the image.
        """
        region = check_region(region, self.values.shape)
        # voxel 0 of the crop is voxel `start` of the image
        start = np.array([low for low, _ in region], dtype=np.float64)
        affine = self.world_from_voxel.copy()
        affine[:3, 3] += affine[:3, :3] @ start
        return replace(self, values=self.values[index_of(region)], world_from_voxel=affine)


def check_region(region: Region | None, shape: tuple[int, ...]) -> Region:
    """Return `region`, or the whole image for None, when it is not empty and inside `shape`.

    Raises:
        OptionError: not three pairs of whole numbers, empty, or outside.
    """
    if region is None:
        region = ((0, shape[0]), (0, shape[1]), (0, shape[2]))
    pairs = np.array(region, dtype=object)
    whole = pairs.shape == (3, 2) and all(isinstance(bound, (int, np.integer)) for bound in pairs.flat)
    if not whole or not all(0 <= low < high <= size for (low, high), size in zip(pairs, shape)):
        raise OptionError(
            f"option region={region!r} does not fit an image of {shape} voxels; expected "
            "((i0, i1), (j0, j1), (k0, k1)) with 0 <= i0 < i1 <= the number of voxels"
        )
    (i0, i1), (j0, j1), (k0, k1) = pairs
    return (int(i0), int(i1)), (int(j0), int(j1)), (int(k0), int(k1))


def index_of(region: Region) -> tuple[slice, slice, slice]:
    """Return the index by which an array gives its part inside `region`."""
    (i0, i1), (j0, j1), (k0, k1) = region
    return slice(i0, i1), slice(j0, j1), slice(k0, k1)


def affine_fault(affine: Array) -> str:
    """Return a sentence with the fault of a (4, 4) transform from voxels to the world; empty when it has none."""
    if affine.shape != (4, 4):
        return f"expected shape (4, 4), found {affine.shape}"
    if not np.isfinite(affine).all():
        return "it has entries that are not finite"
    if not np.array_equal(affine[3], [0, 0, 0, 1]):
        return "expected 0 0 0 1 as its last row"
    # relative to the spacing, so that small voxels are not singular
    lengths = voxel_spacing(affine)
    if (lengths == 0).any() or abs(np.linalg.det(affine[:3, :3] / lengths)) < SINGULAR:
        return "it is singular: voxels have no volume"
    return ""


def _check_values(values: NDArray[Any]) -> None:
    if values.ndim != 3 or values.size == 0:
        raise MaskError(f"expected an image of shape (i, j, k) with voxels in it, found shape {values.shape}")
    if values.dtype.kind not in "biuf":
        raise MaskError(f"expected an image of real numbers, found type {values.dtype}")
    # integers have no NaN: no mask of the whole image is allocated
    bad = ~np.isfinite(values) if values.dtype.kind == "f" else np.zeros(1, dtype=bool)
    if bad.any():
        first = tuple(int(index[0]) for index in np.nonzero(bad))
        raise MaskError(
            f"{int(bad.sum())} of {values.size} voxels are NaN or infinite, the first at {first}; "
            "replace them by a background value first"
        )
