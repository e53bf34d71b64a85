"""What may be given as points to fit: arrays, meshes, and several of these by name."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, PointsError
from quadriform.points import by_name, check_points
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.mesh_points import mesh_points

Given = ArrayLike | Mesh | Mapping[str, ArrayLike | Mesh]


def without_meshes(points: Given, weights: object = None) -> tuple[Any, tuple[str, ...]]:
    """The same points with those of its surface in place of each mesh, and a note on each mesh that was sampled.

    Args:
        points: (n, 3), a mesh (ours, or what has `vertices` and `faces` as one of trimesh), or several by name.
        weights: of the points; None where all count the same.

    Raises:
        OptionError: weights beside a mesh, whose points are chosen here.
        PointsError: a mesh whose triangles are not what they must be.
    """
    named = by_name(points, "points") if isinstance(points, Mapping) else {"": points}
    meshes = {name: _mesh(each) for name, each in named.items() if hasattr(each, "vertices") and hasattr(each, "faces")}
    if meshes and weights is not None:
        raise OptionError("weights: go with points, found a mesh, of which each part of the area counts the same")
    taken = {name: mesh_points(mesh) for name, mesh in meshes.items()}
    clouds = dict(named) | {name: cloud for name, (cloud, _) in taken.items()}
    notes = tuple(f"{name}: {note}" if name else note for name, (_, note) in taken.items() if note)
    return clouds if isinstance(points, Mapping) else clouds[""], notes


def _mesh(given: Any) -> Mesh:
    vertices, faces = check_points(given.vertices, "mesh, vertices"), np.asarray(given.faces)
    whole = faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind in "iu"
    if not whole or (faces.size and not 0 <= faces.min() <= faces.max() < len(vertices)):
        raise PointsError(
            f"mesh, faces: expected (m, 3) indices of {len(vertices)} vertices, found {faces.dtype} {faces.shape}"
        )
    return Mesh(vertices, faces.astype(np.int64))
