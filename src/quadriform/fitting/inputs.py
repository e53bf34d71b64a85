"""What may be given as points to fit: arrays, meshes, data frames, and several of these by name."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadriform.columns import Chosen
from quadriform.errors import OptionError, PointsError, choose
from quadriform.fitting.result import ALONE
from quadriform.point_sets import PointSet, point_set, unit_normals
from quadriform.points import Array, by_name, check_points, check_spread
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.mesh_points import mesh_points

UNITS = ("mm", "m", "unknown")

One = ArrayLike | Mesh | PointSet
Given = One | Mapping[str, One]


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


def point_sets(points: Any, columns: Chosen = None, normals: Any = None) -> dict[str, PointSet]:
    """Checked points by name with what is known of them; a single cloud is called "surface".

    Args:
        points: as `point_set` takes them, or several by name.
        columns: of all of them, as `point_set` takes it.
        normals: (n, 3) in place of those of the points, or by name; None leaves these.

    Raises:
        PointsError, DegenerateError, OptionError: a cloud cannot be fitted, or there is none.
    """
    given = by_name(points, "points") if isinstance(points, Mapping) else {ALONE: points}
    if not given:
        raise OptionError("points: an empty mapping; expected at least one named cloud")
    single = given.keys() == {ALONE}
    sets = {n: point_set(cloud, "points" if single else f"{n}: points", columns) for n, cloud in given.items()}
    for each in sets.values():
        check_spread(each.points, needed=11)
    if normals is None:
        return sets
    beside = by_name(normals, "normals") if isinstance(normals, Mapping) else dict.fromkeys(sets, normals)
    if beside.keys() != sets.keys():
        raise OptionError(f"normals {sorted(beside)} and points {sorted(sets)} must have the same names")
    return {n: replace(each, normals=unit_normals(beside[n], len(each.points))) for n, each in sets.items()}


def common_unit(sets: Mapping[str, PointSet], unit: str | None = None) -> str:
    """The unit of all clouds: that of their columns, or the one given.

    Raises:
        OptionError: several units, or another one than that of the columns.
    """
    found = {each.unit for each in sets.values()}
    if len(found) > 1:
        raise OptionError(f"points: expected one unit for all clouds, found {' and '.join(sorted(found))}")
    own = found.pop()
    if unit is not None and own not in ("unknown", unit):
        raise OptionError(f"option unit={unit!r} contradicts the names of the columns, which are in {own}")
    return choose(unit or own, UNITS, "unit")


def points_sha256(clouds: Iterable[Array]) -> str:
    """SHA-256 of points as float64 rows, cloud after cloud; a reader of a file gives the file's own instead."""
    found = hashlib.sha256()
    for cloud in clouds:
        found.update(np.ascontiguousarray(cloud).data)
    return found.hexdigest()


def _mesh(given: Any) -> Mesh:
    vertices, faces = check_points(given.vertices, "mesh, vertices"), np.asarray(given.faces)
    whole = faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind in "iu"
    if not whole or (faces.size and not 0 <= faces.min() <= faces.max() < len(vertices)):
        raise PointsError(
            f"mesh, faces: expected (m, 3) indices of {len(vertices)} vertices, found {faces.dtype} {faces.shape}"
        )
    return Mesh(vertices, faces.astype(np.int64))
