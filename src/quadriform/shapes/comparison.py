"""Distances between two surfaces, overlap of their insides, and differences of the parameters of two models.

Of a model its first surface is compared; `alone` selects another one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from quadriform.errors import DegenerateError, InputError, OptionError
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.voxels import voxels_inside
from quadriform.words import short_repr

Surface = DeformableModel | Mesh

RESOLUTION = 64
"""Of the meshes that stand for models: chords of a sphere are within 2e-4 of its radius."""
SAMPLES = 20_000
"""Points on each surface."""
NEAREST = 16
"""Nearest points of the other surface to whose triangles a distance is taken exactly; 8 can miss slivers at an edge."""
AT_ONCE = 1000
"""Points whose triangles are held at the same time: what they take stays in the cache."""
VOXELS = 128
"""Of the common grid, along its longest side."""
HALF_ROTATIONS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
"""Diagonals of the rotations that carry every superquadric onto itself."""


@dataclass(frozen=True, repr=False)
class Distances:
    """Distances from evenly spread points of one surface to another, in the unit of the data.

    Attributes:
        mean: their mean.
        rms: root of the mean square.
        percentile_95: 95 % of the points are at most so far away.
        largest: the one-sided Hausdorff distance, as far as these points and all vertices show it.
    """

    __repr__ = short_repr

    mean: float
    rms: float
    percentile_95: float
    largest: float


@dataclass(frozen=True, repr=False)
class ParameterDifference:
    """Parameters of a second model minus those of a first.

    Attributes:
        control_points: RMS length of the differences, in the unit of the data.
        semi_axes: (3,), in the unit of the data.
        exponents: (2,).
        translation: (3,), in the unit of the data.
        rotation: angle in radians of the smallest rotation from one to the other; those by 180 degrees about the
            superquadric's own axes change nothing and do not count.
    """

    __repr__ = short_repr

    control_points: float
    semi_axes: Array
    exponents: Array
    translation: Array
    rotation: float


@dataclass(frozen=True)
class _Samples:
    """Points of a mesh.

    Attributes:
        points: (k, 3), the even ones first, then the vertices, then the triangles' centres, lest one be too small to
            be found.
        triangle: (k,), one in which each lies.
        corners: (m, 3, 3), of the triangles.
        n_outer: how many points, from the first, are even ones or vertices.
    """

    points: Array
    triangle: NDArray[np.int64]
    corners: Array
    n_outer: int


def alone(model: DeformableModel, surface: str | None = None) -> DeformableModel:
    """The model with one of its surfaces: that of the name, or the only one there is, whatever it is called.

    Raises:
        OptionError: the model has several surfaces, and none is named or none has the name.
    """
    if surface in model.surfaces or len(model.surfaces) > 1:
        if surface is None:
            raise OptionError(f"surface: expected one of {', '.join(map(repr, model.surfaces))}, found none named")
        return replace(model, surfaces={surface: model.superquadric(surface)})
    return model


def surface_distances(a: Surface, b: Surface) -> tuple[Distances, Distances]:
    """Distances from the first surface to the second, and from the second to the first.

    Each has 20,000 points, evenly spread over the area of a surface; each distance is the exact one to the nearest
    triangle among those of the 16 nearest points of the other surface (as in Cignoni, Rocchini and Scopigno, Metro:
    measuring error on simplified surfaces, Computer Graphics Forum 1998; 17: 167-174, but with a tree in place of a
    grid).

    Args:
        a: a model, or a mesh, open or closed.
        b: another, in the same frame and unit.

    Raises:
        DegenerateError: a mesh has no area.
    """
    one, two = (_sampled(_mesh(shape)) for shape in (a, b))
    return _to_surface(one, two), _to_surface(two, one)


def dice(a: Surface, b: Surface) -> float:
    """Dice's overlap `2 |A and B| / (|A| + |B|)`, from 0 (apart) to 1 (the same), counted in a common grid.

    The grid has 128 voxels along its longest side, so that bodies as large as it come out to about 0.001.

    Args:
        a: a closed model or mesh.
        b: another, in the same frame and unit.

    Raises:
        InputError: a surface is open, or too small beside the other to be counted.
    """
    meshes = [_mesh(shape) for shape in (a, b)]
    if not all(map(is_closed, meshes)):
        raise InputError("overlap: expected two closed surfaces with an inside, found an open one")
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    low, extent = vertices.min(axis=0), np.ptp(vertices, axis=0)
    voxel = extent.max() / VOXELS
    shape = tuple(np.maximum(np.ceil(extent / voxel), 1).astype(int))
    one, two = (voxels_inside(Mesh((mesh.vertices - low) / voxel - 0.5, mesh.faces), shape) for mesh in meshes)
    if not (one.any() and two.any()):
        raise InputError(
            f"overlap: a surface contains no voxel of side {voxel:.3g}; the other one is too large beside it"
        )
    return float(2 * (one & two).sum() / (one.sum() + two.sum()))


def enclosed_volume(shape: Surface) -> float | None:
    """Volume inside a model's surface or a mesh, in cubed units, for either winding; None where it is open."""
    if not is_closed(_mesh(shape)):
        return None
    return abs(shape.volume())


def is_closed(mesh: Mesh) -> bool:
    """Whether every edge occurs as often in one direction as in the other; vertices of equal position count as one."""
    number = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)
    return Mesh(mesh.vertices, number[mesh.faces]).is_closed()


def parameter_difference(a: DeformableModel, b: DeformableModel) -> ParameterDifference | None:
    """The differences of the parameters of two models; None where the shapes of their boxes or the kinds differ.

    Neither control points nor superquadrics are unique: nearly the same surface can have quite different parameters.

    Args:
        a: a model.
        b: another, in the same frame and unit.
    """
    one, two = a.superquadric(), b.superquadric()
    if a.box.control_points.shape != b.box.control_points.shape or one.kind != two.kind:
        return None
    rotations = one.rotation.T @ two.rotation * HALF_ROTATIONS[:, None, :]
    return ParameterDifference(
        _rms(np.linalg.norm(b.box.control_points - a.box.control_points, axis=-1)),
        two.semi_axes - one.semi_axes,
        two.exponents - one.exponents,
        two.translation - one.translation,
        float(Rotation.from_matrix(rotations).magnitude().min()),
    )


def _mesh(shape: Surface) -> Mesh:
    return shape if isinstance(shape, Mesh) else shape.mesh(resolution=RESOLUTION)


def _sampled(mesh: Mesh) -> _Samples:
    """Points at equal steps of the area, each at random (always the same) in its triangle."""
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    total = np.cumsum(areas)
    if not total[-1] > 0:
        raise DegenerateError(f"surface: expected triangles with an area, found {len(areas)} without any")
    # Equal steps of the cumulated area spread the samples evenly, whatever the triangles.
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES * total[-1]
    triangle = np.searchsorted(total, steps).astype(np.int64)
    root, along = np.random.default_rng(0).random((2, SAMPLES))
    root = np.sqrt(root)  # even over the triangle's area
    weights = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    corners = mesh.vertices[mesh.faces]
    vertices, first = np.unique(mesh.faces, return_index=True)
    points = [np.einsum("kc,kcx->kx", weights, corners[triangle]), mesh.vertices[vertices], corners.mean(axis=1)]
    triangles = np.concatenate([triangle, first // 3, np.arange(len(corners))])
    return _Samples(np.concatenate(points), triangles, corners, SAMPLES + len(vertices))


def _to_surface(source: _Samples, target: _Samples) -> Distances:
    """Distances of one surface's points to the triangles of the other's nearest points."""
    points, tree, found = source.points[: source.n_outer], cKDTree(target.points), []
    for start in range(0, len(points), AT_ONCE):
        part = points[start : start + AT_ONCE]
        # The nearest triangle contains one of the nearest samples, or is beside it.
        nearest = target.triangle[tree.query(part, k=NEAREST)[1]].reshape(-1)
        every = _to_triangles(np.repeat(part, NEAREST, axis=0), target.corners[nearest])
        found.append(every.reshape(-1, NEAREST).min(axis=1))
    distances = np.concatenate(found)
    even = distances[:SAMPLES]
    return Distances(float(even.mean()), _rms(even), float(np.percentile(even, 95)), float(distances.max()))


def _to_triangles(points: Array, corners: Array) -> Array:
    """Distance of each point (n, 3) to its own triangle (n, 3, 3): to the plane above the triangle, else to an edge."""
    position = np.ascontiguousarray(points.T)  # each coordinate in one piece: faster than rows
    first, second, third = np.ascontiguousarray(corners.transpose(1, 2, 0))
    normal = np.cross(second - first, third - first, axis=0)
    squared = _dot(normal, normal)
    above, to_edges = squared > 0, np.full(len(points), np.inf)
    for start, stop in ((first, second), (second, third), (third, first)):
        edge, offset = stop - start, position - start
        length = _dot(edge, edge)
        along = _dot(offset, edge) / np.maximum(length, 1e-300)
        aside = offset - np.clip(along, 0, 1) * edge
        to_edges = np.minimum(to_edges, _dot(aside, aside))
        # The foot of the perpendicular lies inside where it is on the inner side of all edges.
        above &= _dot(np.cross(edge, offset, axis=0), normal) >= 0
    to_plane = np.abs(_dot(position - first, normal)) / np.sqrt(np.maximum(squared, 1e-300))
    return np.where(above, to_plane, np.sqrt(to_edges))


def _dot(u: Array, v: Array) -> Array:
    return np.einsum("in,in->n", u, v)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
