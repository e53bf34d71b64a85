"""Volume of a closed surface, and of its part below a plane; its section with the plane."""

import numpy as np

from quadriform.points import Array
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh, corners, richardson
from quadriform.shapes.model import DeformableModel

DENSITY = 1.05
"""Of myocardium in g/ml, as in Lorenz et al., Normal human right and left ventricular mass, systolic function, and
gender differences by cine magnetic resonance imaging, J Cardiovasc Magn Reson 1999; 1: 7-21."""
RESOLUTION = 32
"""Of the coarse mesh; the fine one has twice as many quads along each edge."""


def volume_below(mesh: Mesh, plane: BasePlane | None) -> float:
    """Return the volume of the part of a body below a plane, in cubed units.

    By the divergence theorem it is the sum of the signed tetrahedra between a point on the plane and the triangles of
    the part's surface. The section with the plane contributes nothing, since that point lies in it. A triangle that the
    plane cuts counts by the fraction of its area below the plane. So triangles beyond the plane are not needed.

    Args:
        mesh: closed, or open only beyond the plane.
        plane: the base; None for all of it.
    """
    if plane is None:
        return mesh.volume()
    below = _fraction_below(plane.heights(mesh.vertices)[mesh.faces])
    a, b, c = corners(mesh.vertices - plane.point, mesh.faces)
    return float(below @ np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)


def _fraction_below(heights: Array) -> Array:
    """The fraction (m,) of the area of each triangle below zero, by the heights (m, 3) of its corners.

    Where one corner h1 is alone on its side of the plane, the plane cuts off a triangle of the fraction
    h1 / (h1 - h2) h1 / (h1 - h3) of the area there.
    """
    below = heights <= 0
    count = below[:, 0].astype(np.int64) + below[:, 1] + below[:, 2]
    fraction = (count == 3).astype(np.float64)
    mixed = np.flatnonzero((count == 1) | (count == 2))
    heights, single = heights[mixed], count[mixed] == 1
    alone = np.where(single, below[mixed].argmax(axis=1), (~below[mixed]).argmax(axis=1))
    one, two, three = (np.take_along_axis(heights, (alone[:, None] + k) % 3, axis=1)[:, 0] for k in range(3))
    tip = one**2 / ((one - two) * (one - three))
    fraction[mixed] = np.where(single, tip, 1 - tip)
    return fraction


def volume(model: DeformableModel, surface: str, plane: BasePlane | None, resolution: int = RESOLUTION) -> float:
    """Return the volume of a surface below the base, in cubed units, by Richardson's extrapolation of two meshes.

    Args:
        model: the model.
        surface: name.
        plane: the base; None for the whole closed surface.
        resolution: of the coarse mesh.
    """
    # the error of a mesh is proportional to the squared edge length
    return richardson(*(volume_below(model.mesh(surface, n), plane) for n in (resolution, 2 * resolution)))


def section(mesh: Mesh, plane: BasePlane) -> Array:
    """Return the section of a mesh with a plane: directed segments (2, m, 3), from start to end, in the world."""
    heights = plane.heights(mesh.vertices)
    a, b, c = (heights > 0)[mesh.faces.T]
    faces = mesh.faces[(a != b) | (b != c)]
    triangles, heights = mesh.vertices[faces], heights[faces]
    after = np.roll(heights, -1, axis=1)
    rows = np.arange(len(heights))
    ends = []
    for crossing in ((heights <= 0) & (after > 0), (heights > 0) & (after <= 0)):
        side = crossing.argmax(axis=1)  # the outline of a triangle crosses the plane once upwards and once downwards
        low, high = triangles[rows, side], triangles[rows, (side + 1) % 3]
        fraction = heights[rows, side] / (heights[rows, side] - after[rows, side])
        ends.append(low + fraction[:, None] * (high - low))
    return np.stack(ends)


def section_centre(mesh: Mesh, plane: BasePlane) -> Array | None:
    """Return the centre of area (3,) of the section of a closed mesh with a plane; None where they do not meet."""
    starts, stops = section(mesh, plane) - plane.point
    if len(starts) == 0:
        return None
    # the polygon as signed triangles from a point of the plane (shoelace formula)
    doubled = np.cross(starts, stops) @ plane.direction
    return plane.point + doubled @ (starts + stops) / (3 * doubled.sum())
