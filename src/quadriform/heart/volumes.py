"""Volumes: of a closed surface, and of what lies below a plane."""

import numpy as np

from quadriform.heart.base import BasePlane
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

DENSITY = 1.05
"""Of myocardium in g/ml, as in Lorenz et al., Normal human right and left ventricular mass, systolic function, and
gender differences by cine magnetic resonance imaging, J Cardiovasc Magn Reson 1999; 1: 7-21."""
RESOLUTION = 32


def volume_below(mesh: Mesh, plane: BasePlane | None) -> float:
    """Volume of the part of a body below a plane, in cubed units.

    The divergence theorem, every tetrahedron seen from a point on the plane: what closes the cut adds nothing. So a
    mesh that is open beyond the plane needs no lid either.

    Args:
        mesh: closed, or open only beyond the plane.
        plane: the base; None for all of it.
    """
    if plane is None:
        return mesh.volume()
    corners = (mesh.vertices - plane.point)[mesh.faces]
    share = _share_below(plane.heights(mesh.vertices)[mesh.faces])
    a, b, c = corners.transpose(1, 0, 2)
    return float(share @ np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)


def _share_below(heights: Array) -> Array:
    """Which share (m,) of each triangle's area lies below zero, by the heights (m, 3) of its corners."""
    below = heights <= 0
    count = below.sum(axis=1)
    alone = np.where(count == 1, below.argmax(axis=1), (~below).argmax(axis=1))
    one, two, three = (np.take_along_axis(heights, (alone[:, None] + k) % 3, axis=1)[:, 0] for k in range(3))
    mixed = (count == 1) | (count == 2)
    gaps = np.where(mixed, (one - two) * (one - three), 1.0)
    tip = one**2 / gaps  # both sides of the corner that stands alone are cut at the height's zero
    return np.select([count == 3, count == 2, count == 1], [np.ones(len(heights)), 1 - tip, tip], 0.0)


def volume(model: DeformableModel, surface: str, plane: BasePlane | None) -> float:
    """Volume of a model's surface below the base, in cubed units, from two meshes by Richardson's extrapolation."""
    coarse, fine = (volume_below(model.mesh(surface, n), plane) for n in (RESOLUTION, 2 * RESOLUTION))
    return fine + (fine - coarse) / 3


def section(mesh: Mesh, plane: BasePlane) -> Array:
    """Where a plane cuts a mesh: directed segments (2, m, 3), from their starts to their ends, in the world."""
    heights = plane.heights(mesh.vertices)[mesh.faces]
    cut = (heights > 0).any(axis=1) & (heights <= 0).any(axis=1)
    corners, heights = mesh.vertices[mesh.faces[cut]], heights[cut]
    after = np.roll(heights, -1, axis=1)
    rows = np.arange(len(heights))
    ends = []
    for crossing in ((heights <= 0) & (after > 0), (heights > 0) & (after <= 0)):
        side = crossing.argmax(axis=1)  # each triangle is left once upwards and once downwards
        low, high = corners[rows, side], corners[rows, (side + 1) % 3]
        share = heights[rows, side] / (heights[rows, side] - after[rows, side])
        ends.append(low + share[:, None] * (high - low))
    return np.stack(ends)


def section_centre(mesh: Mesh, plane: BasePlane) -> Array | None:
    """Centre of area (3,) of the section of a closed mesh with a plane; None where they do not meet."""
    starts, stops = section(mesh, plane) - plane.point
    if len(starts) == 0:
        return None
    doubled = np.cross(starts, stops) @ plane.direction
    return plane.point + doubled @ (starts + stops) / (3 * doubled.sum())
