"""A body whose inside is known, as voxels, and the overlap of the inside of a surface with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array
from quadriform.shapes.comparison import is_closed
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.voxels import voxels_inside
from quadriform.words import short_repr

MOST = 128
"""Most voxel centres along an axis that are counted, enough for three digits; of more every second, third ... one."""
FOLLOWED, DISPLACED = 0.97, 0.9
"""Least Dice of a body and the surface that was fitted to it: volumes can be wrong by several per cent below. Voxel
centres are inside or not, so that smooth bodies reach 0.99 by any voxels. Slices of a heart from different breaths
are displaced by millimetres against each other, which no smooth surface follows; 0.95 is usual then."""
CHANCE = 2.0
"""Standard deviations of a difference of volumes that are put down to chance: voxels are inside or not."""


@dataclass(frozen=True)
class Overlap:
    """Of a body and the inside of a surface, counted in voxel centres.

    Attributes:
        dice: Dice's coefficient, from 0 (apart) to 1.
        larger: by which fraction of the body's volume that of the surface is larger, negative where it is smaller.
        uncertain: of that, what is put down to chance.
    """

    dice: float
    larger: float
    uncertain: float

    @classmethod
    def of(cls, body: NDArray[np.bool_], enclosed: NDArray[np.bool_]) -> Overlap:
        """From which voxels are of the body, and which the surface encloses, of the same shape."""
        of_body, inside, differ = int(body.sum()), int(enclosed.sum()), int((body ^ enclosed).sum())
        total = of_body + inside
        # voxels on either side of the surface are in the wrong place as often here as there
        size = max(of_body, 1)
        return cls(1 - differ / total if total else 0.0, (inside - of_body) / size, CHANCE * differ**0.5 / size)


@dataclass(frozen=True, repr=False)
class Solid:
    """The inside of a body.

    Attributes:
        filled: (i, j, k) bool, which voxels have their centre inside.
        world_from_voxel: (4, 4).
        is_whole: whether all of the body lies in these voxels; otherwise nothing is known outside of them.
        least_dice: of a surface that follows the body.
    """

    __repr__ = short_repr

    filled: NDArray[np.bool_]
    world_from_voxel: Array
    is_whole: bool = True
    least_dice: float = FOLLOWED

    @classmethod
    def of_mesh(cls, mesh: Mesh) -> Solid | None:
        """The inside of a mesh; None where it is open, or flat."""
        extent = np.ptp(mesh.vertices, axis=0) if len(mesh.faces) else np.zeros(3)
        if not extent.min() > 0 or not is_closed(mesh):
            return None
        low, voxel = mesh.vertices.min(axis=0), float(extent.max()) / MOST
        shape = tuple(np.ceil(extent / voxel).astype(int))
        affine = np.diag([voxel] * 3 + [1.0])
        affine[:3, 3] = low + voxel / 2
        return cls(voxels_inside(Mesh((mesh.vertices - affine[:3, 3]) / voxel, mesh.faces), shape), affine)

    def scaled(self, factor: float) -> Solid:
        """The body with its lengths times a factor."""
        return replace(self, world_from_voxel=np.diag([factor] * 3 + [1.0]) @ self.world_from_voxel)

    def overlap(self, mesh: Mesh, base: BasePlane | None) -> Overlap:
        """The overlap of the body and the inside of a closed mesh.

        Args:
            mesh: in the world.
            base: only voxels on this side of it count.
        """
        affine = self.world_from_voxel
        vertices = np.asarray(np.linalg.solve(affine[:3, :3], (mesh.vertices - affine[:3, 3]).T).T, dtype=np.float64)
        axes = self._axes(vertices)
        body = self._at(axes)
        # mesh coordinates in which the voxels that are counted have whole numbers from 0
        low, step = (np.array([float(getattr(each, name)) for each in axes]) for name in ("start", "step"))
        enclosed = voxels_inside(Mesh((vertices - low) / step, mesh.faces), body.shape)
        if base is not None:
            counts = self._heights(axes, base) <= 0
            body, enclosed = body & counts, enclosed & counts
        return Overlap.of(body, enclosed)

    def _axes(self, vertices: Array) -> list[range]:
        """The voxels along each axis that are compared: around both bodies, where it is known what is inside."""
        axes = []
        for axis, size in enumerate(self.filled.shape):
            own = np.flatnonzero(self.filled.any(axis=tuple({0, 1, 2} - {axis})))
            first, last = (int(own[0]), int(own[-1])) if len(own) else (0, size - 1)
            # of a surface that reaches far beyond the body a part is enough
            far = last - first + 1
            low = int(np.clip(np.floor(vertices[:, axis].min()), first - far, first))
            high = int(np.clip(np.ceil(vertices[:, axis].max()), last, last + far))
            if not self.is_whole:
                low, high = max(low, 0), min(high, size - 1)
            axes.append(range(low, high + 1, (high - low) // MOST + 1))
        return axes

    def _at(self, axes: list[range]) -> NDArray[np.bool_]:
        """Whether voxels, by their numbers along each axis, are filled; those beyond the grid are not."""
        numbers = [np.array(each) for each in axes]
        found = np.zeros([len(each) for each in axes], dtype=np.bool_)
        within = [np.flatnonzero((each >= 0) & (each < size)) for each, size in zip(numbers, self.filled.shape)]
        found[np.ix_(*within)] = self.filled[np.ix_(*(each[kept] for each, kept in zip(numbers, within)))]
        return found

    def _heights(self, axes: list[range], base: BasePlane) -> Array:
        """Heights of voxel centres, by their numbers along each axis, above a base."""
        i, j, k = np.ix_(*axes)
        a, b, c = base.direction @ self.world_from_voxel[:3, :3]
        return a * i + b * j + c * k + base.direction @ (self.world_from_voxel[:3, 3] - base.point)
