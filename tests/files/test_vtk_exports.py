"""What is written for VTK: hexahedra with axes, and a film."""

import base64
import io
from xml.etree import ElementTree

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.files.vtk_xml import _data_array, encode_vtu
from quadriform.files.vtkhdf import encode_vtkhdf
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.wall import wall_mesh


def state(grown=1.0):
    endo, epi = Superquadric(semi_axes=(2, 3, 4)), Superquadric(semi_axes=(4, 5, 6))
    box = ControlBox.around(epi)
    return DeformableModel({"epi": epi, "endo": endo}, box.with_control_points(grown * box.control_points), "LPS", "mm")


def test_a_vtu_holds_the_very_same_wall():
    wall = wall_mesh(state(), layers=2, resolution=4)
    piece = ElementTree.fromstring(encode_vtu(wall, {"SPACE": "LPS", "UNIT": "mm"})).find("UnstructuredGrid/Piece")
    types = {"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}
    read = {
        array.get("Name"): np.frombuffer(base64.b64decode(array.text)[8:], types[array.get("type")])
        for array in piece.iter("DataArray")
    }
    assert np.array_equal(read["Points"].reshape(-1, 3), wall.vertices)
    assert np.array_equal(read["connectivity"].reshape(-1, 8), wall.cells)
    assert np.array_equal(read["offsets"], 8 * np.arange(1, len(wall.cells) + 1))
    assert set(read["types"]) == {12}
    for k, name in enumerate(("radial", "circumferential", "longitudinal")):
        assert np.array_equal(read[name].reshape(-1, 3), wall.axes[:, k])
    assert int(piece.get("NumberOfCells")) == len(read["depth"])


def test_a_time_series_has_every_state():
    h5py = pytest.importorskip("h5py")
    states, times = [state(1.0), state(1.5)], [0.0, 30.0]
    content = encode_vtkhdf(states, times, resolution=4)
    assert content == encode_vtkhdf(states, times, resolution=4)
    with h5py.File(io.BytesIO(content)) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData" and root["Steps"].attrs["NSteps"] == 2
        assert np.array_equal(root["Steps/Values"], times)
        n = root["NumberOfPoints"][0]
        points = np.split(root["Points"][:], root["Steps/PointOffsets"][1:])
        assert len(points[0]) == len(points[1]) == n == len(root["PointData/surface"])
        for made, found in zip(states, points):
            assert np.array_equal(found, np.concatenate([made.mesh(name, 4).vertices for name in made.surfaces]))
        assert root["Polygons/Connectivity"][:].max() == n - 1
        assert root["Polygons/Offsets"][-1] == len(root["Polygons/Connectivity"])


@pytest.mark.parametrize("times", [[0.0], [1.0, 1.0], [0.0, np.nan]])
def test_times_that_are_none_are_refused(times):
    with pytest.raises(OptionError, match="increasing"):
        encode_vtkhdf([state(), state()], times)


@pytest.mark.parametrize(("shape", "components"), [((4,), None), ((4, 3), "3"), ((2, 1), "1")])
def test_arrays_of_vectors_state_their_components(shape, components):
    values = np.arange(np.prod(shape), dtype=float).reshape(shape)
    found = ElementTree.fromstring(_data_array("name", values))
    assert (found.get("type"), found.get("Name"), found.get("NumberOfComponents")) == ("Float64", "name", components)
    content = base64.b64decode(found.text)
    assert int.from_bytes(content[:8], "little") == values.nbytes == len(content) - 8
    np.testing.assert_array_equal(np.frombuffer(content[8:], "<f8"), values.ravel())
