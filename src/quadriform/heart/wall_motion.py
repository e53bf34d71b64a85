"""The motion of the wall from end diastole to another frame, and its strain.

A point X before deformation is one material point in all frames. Between the reference and a frame the deformation
gradient is F = J_frame(X) J_reference(X)^-1, and Green's strain E = (F^T F - I) / 2 (Green-Lagrange; see Humphrey,
Cardiovascular Solid Mechanics, Springer 2002, chapter 3). The relative change of length of a fibre along a unit
vector N of the reference is |F N| - 1 = sqrt(1 + 2 N.E N) - 1.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quadriform.heart.axis import LongAxis
from quadriform.heart.twist import LEVELS, Slices
from quadriform.heart.wall import NODES, WEIGHTS, Wall
from quadriform.points import Array, unit_vectors
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane


@dataclass(frozen=True)
class ReferenceWall:
    """The wall at end diastole, the reference with which other frames are compared.

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
    def at(cls, wall: Wall, box: ControlBox, axis: LongAxis, plane: BasePlane | None) -> "ReferenceWall":
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
        # a Gauss point stands for a piece of its line, of the length weight times thickness. The cell about it is as
        # wide as the root of its volume over that length, and half of it lies below a plane through its middle
        depths = WEIGHTS * np.where(self.wall.crossing, 1.0, self.thickness)[:, None]
        size = np.sqrt(np.maximum(self.volumes, 1e-300) / depths)
        return np.clip(0.5 - heights / size, 0, 1)

    @property
    def areas(self) -> Array:
        """Area (n,) of the wall about each line at end diastole: volume over length."""
        return self.volumes.sum(axis=1) / np.maximum(self.thickness, 1e-300)

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


def deformation_gradient(reference: ControlBox, frame: ControlBox, origins: Array) -> Array:
    """Return F (n, 3, 3) from one frame to another, at points (n, 3) of the undeformed space that both have."""
    # J_frame J_reference^-1 by a solve with the transposes
    before = reference.jacobian(origins).transpose(0, 2, 1)
    after = frame.jacobian(origins).transpose(0, 2, 1)
    return np.asarray(np.linalg.solve(before, after).transpose(0, 2, 1), dtype=np.float64)


def green_strain(gradient: Array) -> Array:
    """Return Green's strain (F^T F - I) / 2, (n, 3, 3), from gradients (n, 3, 3)."""
    return (gradient.transpose(0, 2, 1) @ gradient - np.eye(3)) / 2


def local_axes(box: ControlBox, origins: Array, normals: Array, axis: Array) -> Array:
    """Return radial, circumferential and longitudinal unit vectors of the wall in a frame, rows of (n, 3, 3).

    Radial is the outward normal of the layer of the wall; circumferential is right-handed about the long axis;
    longitudinal is perpendicular to both, towards the base.

    Args:
        box: the frame's.
        origins: (n, 3), points before deformation.
        normals: (n, 3), of the layers there, before deformation.
        axis: (3,), unit, from apex to base, in the frame.
    """
    # normals transform by the inverse transpose of the Jacobian
    radial = unit_vectors(np.linalg.solve(box.jacobian(origins).transpose(0, 2, 1), normals[:, :, None])[:, :, 0])
    around = np.cross(axis, radial)
    # at the apex the normal is along the axis, and any direction across it is circumferential
    around = around / np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-12)
    return np.stack([radial, around, np.cross(radial, around)], axis=1)


def in_axes(strain: Array, axes: Array) -> Array:
    """Return components (n, 3, 3) of strains (n, 3, 3) along unit vectors, rows of (n, 3, 3)."""
    return axes @ strain @ axes.transpose(0, 2, 1)


def relative_lengthening(strain: Array) -> Array:
    """Return relative changes of length (..., 3) along the axes of Green strains (..., 3, 3): sqrt(1 + 2 E) - 1."""
    return np.sqrt(1 + 2 * np.diagonal(strain, axis1=-2, axis2=-1)) - 1
