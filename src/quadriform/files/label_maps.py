"""A model as a label image on the grid of a given NIfTI image."""

import gzip
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.reading import quoted, read_bytes
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.spaces import turn_between
from quadriform.shapes.voxels import voxels_inside

METRES = {"mm": 1e-3, "meter": 1.0, "micron": 1e-6, "unknown": 1e-3}


def encode_label_map(model: DeformableModel, like: str | os.PathLike[str], compressed: bool = True) -> bytes:
    """The bytes of a NIfTI file of labels: 1 inside the innermost surface, 2 between it and the next, and so on.

    Args:
        model: closed surfaces in a known frame and unit.
        like: the NIfTI image whose grid and transforms are taken, and none of its other contents.
        compressed: as .nii.gz.

    Raises:
        OptionError: the frame or unit of the model is unknown.
        InputError, FileFormatError: `like` cannot be read as NIfTI.
    """
    import nibabel

    read_bytes(like)  # refuses what is missing or too large, by name
    try:
        source: Any = nibabel.load(like)
        shape, affine, units = source.shape[:3], source.affine, source.header.get_xyzt_units()[0]
    except Exception as error:
        raise FileFormatError(f"{quoted(like)}: expected a NIfTI image ({error})") from error
    grid = _world_from_voxel(model, affine, units)
    header = source.header.copy()
    header.set_data_dtype(np.uint8)
    header.set_data_shape(shape)
    header["cal_min"] = header["cal_max"] = 0
    header.extensions.clear()
    content: bytes = type(source)(label_map(model, shape, grid), affine, header).to_bytes()
    return gzip.compress(content, mtime=0) if compressed else content


def label_map(model: DeformableModel, shape: tuple[int, ...], world_from_voxel: Array) -> NDArray[np.uint8]:
    """Labels on a grid: 0 outside, 1 inside the innermost surface, one more for each surface further out.

    Args:
        model: closed surfaces, one around the other.
        shape: voxels along i, j, k.
        world_from_voxel: (4, 4), into the model's own frame and unit.
    """
    meshes = sorted((model.mesh(name, 96) for name in model.surfaces), key=lambda mesh: mesh.volume())
    labels = np.zeros(shape, dtype=np.uint8)
    for number, mesh in reversed(list(enumerate(meshes, start=1))):
        moved = np.linalg.solve(world_from_voxel[:3, :3], (mesh.vertices - world_from_voxel[:3, 3]).T).T
        labels[voxels_inside(Mesh(moved.astype(np.float64), mesh.faces), shape)] = number
    return labels


def _world_from_voxel(model: DeformableModel, affine: Array, units: str) -> Array:
    if model.space == "unknown" or model.unit == "unknown":
        raise OptionError(
            f"a label map needs the frame and unit of the model, found space={model.space!r}, unit={model.unit!r}; "
            "set them in the model, e.g. to 'LPS' and 'mm'"
        )
    scale = METRES[units] / METRES["mm" if model.unit == "mm" else "meter"]
    to_space = np.eye(4)
    to_space[:3, :3] = scale * turn_between("RAS", model.space)
    return to_space @ affine
