"""Meshes of a population whose vertices correspond: checked, aligned, and a model of their mean."""

from collections.abc import Mapping, Sequence

import numpy as np

from quadriform.errors import InputError
from quadriform.fitting.fit import fit
from quadriform.point_sets import ALONE
from quadriform.points import Array, by_name, check_points
from quadriform.priors.alignment import aligned_rigidly, centred
from quadriform.priors.features import Features
from quadriform.shapes.closest import closest_on
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

Meshes = dict[str, Mesh]
"""The surfaces of one member of a population by name."""
CONVERGED = 1e-12
"""Change of the mean in a step, relative to its size, at which the alignment ends."""
STEPS = 100


def meshes_by_name(number: int, shape: Mesh | Mapping[str, Mesh]) -> Meshes:
    """Return the meshes of one shape by name; a single one is called "surface".

    Raises:
        InputError: the shape of this number has no meshes, or something else than meshes.
    """
    meshes = {ALONE: shape} if isinstance(shape, Mesh) else by_name(shape, "meshes")
    for name, mesh in meshes.items():
        if not isinstance(mesh, Mesh):
            raise InputError(f"mesh {number}, {name}: expected a Mesh, found {type(mesh).__name__}")
    if not meshes:
        raise InputError(f"mesh {number}: expected one or more surfaces, found none")
    return meshes


def corresponding_vertices(shapes: Sequence[Meshes]) -> Array:
    """Return the vertices (len(shapes), n, 3) of shapes, one surface after the other.

    Raises:
        InputError: other surfaces, other numbers of vertices or other triangles than those of the first shape.
        PointsError: vertices that are not finite.
    """
    first = shapes[0]
    for number, shape in enumerate(shapes):
        if shape.keys() != first.keys():
            raise InputError(f"mesh {number}: expected the surfaces {', '.join(first)}, found {', '.join(shape)}")
        for name, mesh in first.items():
            _check_correspondence(number, name, shape[name], mesh)
    return np.array([_vertices(number, shape, tuple(first)) for number, shape in enumerate(shapes)])


def _check_correspondence(number: int, name: str, mesh: Mesh, first: Mesh) -> None:
    expected, found = len(first.vertices), len(mesh.vertices)
    if found != expected:
        raise InputError(
            f"mesh {number}, {name}: expected {expected} vertices, as many as in mesh 0, found {found}; vertices of "
            "all meshes must correspond by their numbers. Fit a model to each mesh and learn from the models instead"
        )
    if not np.array_equal(mesh.faces, first.faces):
        raise InputError(
            f"mesh {number}, {name}: its triangles have other vertices than those of mesh 0, so that vertices do not "
            "correspond by their numbers. Fit a model to each mesh and learn from the models instead"
        )


def _vertices(number: int, shape: Meshes, names: tuple[str, ...]) -> Array:
    return np.concatenate([check_points(shape[name].vertices, f"mesh {number}, {name}") for name in names])


def procrustes(vertices: Array) -> Array:
    """Return vertices (s, n, 3) of s shapes after the rigid motions that bring them to their common mean.

    Generalised Procrustes analysis: shapes are aligned to the mean, and the mean is computed again, until it does not
    change. The first shape determines the orientation.
    """
    mean = centred(vertices[0])
    for _ in range(STEPS):
        points = np.array([aligned_rigidly(each, mean) for each in vertices])
        before, mean = mean, points.mean(axis=0)
        if np.linalg.norm(mean - before) <= CONVERGED * np.linalg.norm(mean):
            break
    return points


def mean_model(mean: Array, first: Meshes, counts: tuple[int, int, int]) -> tuple[DeformableModel, Features]:
    """Return the model fitted to the mean shape, and the features over points of it, one for each vertex.

    It is fitted as other data is, so that it has no folds where a fit has none. The points are those before
    deformation whose deformed positions are nearest to the vertices.

    Args:
        mean: (n, 3), vertices of the mean shape, one surface after the other.
        first: a member, whose names and numbers of vertices are taken.
        counts: control points along each axis.

    Raises:
        DegenerateError: the vertices of a surface have no extent in three dimensions.
    """
    ends = np.cumsum([len(mesh.vertices) for mesh in first.values()])[:-1]
    parts = dict(zip(first, np.split(mean, ends)))
    # all vertices belong to the population, so none is an outlier
    model = fit(parts, box=counts, robust=False).model
    feet = [closest_on(model.surfaces[name], model.box, part).origins for name, part in parts.items()]
    rest = model.box.with_control_points(model.box.rest)
    return model, Features(rest, np.concatenate(feet))
