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


@dataclass(frozen=True, repr=False)
class Solid:
    """The inside of a body.

    Attributes:
        filled: (i, j, k) bool, which voxels have their centre inside.
        world_from_voxel: (4, 4).
        is_whole: whether all of the body lies in these voxels; otherwise nothing is known outside of them.
    """

    __repr__ = short_repr

    filled: NDArray[np.bool_]
    world_from_voxel: Array
    is_whole: bool = True

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

    def dice(self, mesh: Mesh, base: BasePlane | None) -> float:
        """Dice's overlap of the body and the inside of a closed mesh, from 0 (apart) to 1, counted in voxel centres.

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
        total = int(body.sum()) + int(enclosed.sum())
        return 2 * int((body & enclosed).sum()) / total if total else 0.0

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
