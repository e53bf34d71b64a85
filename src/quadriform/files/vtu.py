"""VTK's XML files of unstructured grids (.vtu): the wall as hexahedra, with its local axes."""

from collections.abc import Mapping

import numpy as np

from quadriform.files.vtp import data_array, field_data
from quadriform.shapes.wall import HexMesh

HEXAHEDRON = 12
"""VTK's number of this kind of cell."""


def encode_vtu(mesh: HexMesh, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a .vtu file in double precision; metadata, such as frame and unit, as field data.

    The cells carry `radial`, `circumferential` and `longitudinal` unit vectors and `depth`, from 0 at the inner to 1
    at the outer surface.
    """
    n, m = len(mesh.vertices), len(mesh.cells)
    names = ("radial", "circumferential", "longitudinal")
    data = [data_array(name, mesh.axes[:, k].astype("<f8"), "Float64", 3) for k, name in enumerate(names)]
    data.append(data_array("depth", mesh.depth.astype("<f8"), "Float64"))
    cells = [
        data_array("connectivity", mesh.cells.astype("<i8"), "Int64"),
        data_array("offsets", 8 * np.arange(1, m + 1, dtype="<i8"), "Int64"),
        data_array("types", np.full(m, HEXAHEDRON, np.uint8), "UInt8"),
    ]
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<UnstructuredGrid>",
        field_data(metadata),
        f'<Piece NumberOfPoints="{n}" NumberOfCells="{m}">',
        f"<Points>{data_array('Points', mesh.vertices.astype('<f8'), 'Float64', 3)}</Points>",
        f"<Cells>{''.join(cells)}</Cells>",
        f"<CellData>{''.join(data)}</CellData>",
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
    ]
    return ("\n".join(lines) + "\n").encode()
