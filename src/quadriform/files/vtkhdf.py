"""VTKHDF: the surfaces of a moving model over time in one file, which ParaView plays.

The layout is that of VTK's file format documentation, VTKHDF 2.0, PolyData with the group Steps. Triangles are written
once, points for every time.
"""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from quadriform.errors import OptionError
from quadriform.files.metadata import check_space_and_unit
from quadriform.points import Array
from quadriform.shapes.mesh import Faces, split_quads
from quadriform.shapes.model import DeformableModel

KINDS = ("Vertices", "Lines", "Polygons", "Strips")


def encode_vtkhdf(states: Sequence[DeformableModel], times: Sequence[float], resolution: int = 24) -> bytes:
    """The bytes of a temporal .vtkhdf file.

    Args:
        states: the model at each time; all with the same undeformed surfaces, so that a vertex is a material point. The
            point data `surface` counts the surfaces from 0; attributes hold their names, the frame, the unit, and the
            status of the fit.
        times: as many increasing numbers.
        resolution: as in `Superquadric.mesh`.

    Raises:
        OptionError: times that do not increase or do not fit the states, or h5py is missing.
    """
    steps = np.asarray(times, dtype=np.float64)
    if not len(states) or steps.shape != (len(states),) or not np.isfinite(steps).all() or (np.diff(steps) <= 0).any():
        raise OptionError(f"times: expected {len(states)} increasing numbers, one a state, found {list(times)}")
    check_space_and_unit(states[0].space, states[0].unit)
    rest, faces, owner = _triangles(states[0], resolution)
    # In memory, so that the file can be written all or nothing.
    stream = io.BytesIO()
    with _h5py().File(stream, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype="<i8")
        root.attrs["Type"] = np.bytes_("PolyData")
        root.attrs["SPACE"], root.attrs["UNIT"] = np.bytes_(states[0].space), np.bytes_(states[0].unit)
        for name, value in states[0].record.metadata.items():
            root.attrs[name] = np.bytes_(value)
        root.attrs["SURFACES"] = np.bytes_(",".join(states[0].surfaces).encode())
        root["NumberOfPoints"] = np.array([len(rest)], dtype="<i8")
        root["Points"] = np.concatenate([state.deform(rest) for state in states]).astype("<f8")
        for kind in KINDS:
            _cells(root.create_group(kind), faces if kind == "Polygons" else faces[:0])
        root["PointData/surface"] = owner
        _steps(root.create_group("Steps"), steps, len(rest))
    return stream.getvalue()


def _triangles(model: DeformableModel, resolution: int) -> tuple[Array, Faces, Faces]:
    """Undeformed vertices and triangles of all surfaces, cut as in the first state, and the owner of each vertex."""
    vertices, faces, owner, first = [], [], [], 0
    for number, surface in enumerate(model.surfaces.values()):
        before, quads = surface.grid(resolution)
        vertices.append(before)
        faces.append(first + split_quads(quads, model.deform(before)))
        owner.append(np.full(len(before), number, dtype="<i8"))
        first += len(before)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(owner)


def _cells(group: Any, faces: Faces) -> None:
    group["NumberOfCells"] = np.array([len(faces)], dtype="<i8")
    group["NumberOfConnectivityIds"] = np.array([faces.size], dtype="<i8")
    group["Offsets"] = 3 * np.arange(len(faces) + 1, dtype="<i8")
    group["Connectivity"] = faces.ravel().astype("<i8")


def _steps(group: Any, times: Array, n_points: int) -> None:
    n = len(times)
    group.attrs["NSteps"] = np.int64(n)
    group["Values"] = times
    # One part a step. Points lie one step after the other, and all steps have the triangles and owners of the first.
    group["NumberOfParts"] = np.ones(n, dtype="<i8")
    group["PartOffsets"] = np.zeros(n, dtype="<i8")
    group["PointOffsets"] = n_points * np.arange(n, dtype="<i8")
    group["CellOffsets"] = np.zeros((n, len(KINDS)), dtype="<i8")
    group["ConnectivityIdOffsets"] = np.zeros((n, len(KINDS)), dtype="<i8")
    group["PointDataOffsets/surface"] = np.zeros(n, dtype="<i8")


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise OptionError("vtkhdf needs h5py; pip install 'quadriform[hdf]'") from error
    return h5py
