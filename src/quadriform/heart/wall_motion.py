"""The motion of the wall from end diastole to another frame."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quadriform.heart.axis import LongAxis
from quadriform.heart.base import BasePlane
from quadriform.heart.strain import deformation_gradient, green_strain, in_axes, local_axes
from quadriform.heart.twist import LEVELS, Slices
from quadriform.heart.wall import NODES, WEIGHTS, Wall
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox


@dataclass(frozen=True)
class MovingWall:
    """The wall at end diastole, with which other frames are compared.

    Attributes:
        wall: its lines.
        box: at end diastole.
        axis: the long axis then.
        origins: (n, 4, 3), the lines' Gauss points before deformation.
        axes: (n, 4, 3, 3), radial, circumferential, longitudinal at end diastole.
        thickness: (n,), of the lines at end diastole.
        volumes: (n, 4), volume about each at end diastole, 0 beyond the base.
        slices: the two slices of the twist.
    """

    wall: Wall
    box: ControlBox
    axis: LongAxis
    origins: Array
    axes: Array
    thickness: Array
    volumes: Array
    slices: Slices

    @classmethod
    def at(cls, wall: Wall, box: ControlBox, axis: LongAxis, plane: BasePlane | None) -> "MovingWall":
        """Return the wall in the frame of end diastole; what lies beyond the base plane does not count."""
        origins = np.stack([wall.at(depth) for depth in NODES], axis=1)
        axes = [local_axes(box, wall.at(depth), wall.normals_at(depth), axis.direction) for depth in NODES]
        volumes = wall.volumes(box)
        thickness, slices = wall.thickness(box), Slices.cut(wall, box, axis)
        whole = cls(wall, box, axis, origins, np.stack(axes, axis=1), thickness, volumes, slices)
        return whole if plane is None else replace(whole, volumes=volumes * whole.fraction_below(plane))

    def fraction_below(self, plane: BasePlane) -> Array:
        """Return the fraction (n, 4) of the volume about each Gauss point that lies below a plane at end diastole.

        A cell that the plane cuts counts in part, so that means are continuous in the plane.
        """
        heights = plane.heights(self.box.deform(self.origins.reshape(-1, 3))).reshape(self.volumes.shape)
        depths = WEIGHTS * np.where(self.wall.crossing, 1.0, self.thickness)[:, None]
        # width of a cell across the wall's lines: square root of volume over depth
        size = np.sqrt(np.maximum(self.volumes, 1e-300) / depths)
        return np.clip(0.5 - heights / size, 0, 1)

    @property
    def areas(self) -> Array:
        """Area (n,) of the wall about each line at end diastole: volume over length."""
        return self.volumes.sum(axis=1) / np.where(self.wall.crossing, 1.0, self.thickness)

    def strain(self, box: ControlBox) -> Array:
        """Return Green's strain (n, 4, 3, 3) of a frame against end diastole, along the local axes."""
        gradient = deformation_gradient(self.box, box, self.origins.reshape(-1, 3))
        return in_axes(green_strain(gradient), self.axes.reshape(-1, 3, 3)).reshape(self.axes.shape)

    def mean(self, values: Array, fractions: Array | NDArray[np.bool_]) -> Array:
        """Return the mean of values (n, 4, ...) over the fractions (n, 4) or (n, 1) of the volume of the wall."""
        weights = self.volumes * fractions  # of end diastole, so that all frames average the same tissue
        return np.tensordot(weights, values, 2) / weights.sum()

    def between_slices(self) -> Array:
        """Return the fraction (n, 4) of the wall between the apical and the basal slice at end diastole."""
        low, high = (self.fraction_below(self.axis.plane(level)) for level in LEVELS)
        return high - low  # cells that a level cuts count in part
