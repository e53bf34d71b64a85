"""Strain of the wall between two frames, from the gradients of the control boxes.

A point X before deformation is one material point in all frames. Between the reference and a frame the deformation
gradient is F = J_frame(X) J_reference(X)^-1, and Green's strain E = (F^T F - I) / 2 (Green-Lagrange; see Humphrey,
Cardiovascular Solid Mechanics, Springer 2002, chapter 3). The relative change of length of a fibre along a unit
vector N of the reference is |F N| - 1 = sqrt(1 + 2 N.E N) - 1.
"""

import numpy as np

from quadriform.points import Array, unit_vectors
from quadriform.shapes.control_box import ControlBox


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
