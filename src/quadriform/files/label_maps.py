"""Label images: of a model on a given grid, and as bytes of a NIfTI or NRRD file."""

import gzip
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.columns import MILLIMETRES
from quadriform.errors import OptionError, choose
from quadriform.points import Array
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.spaces import rotation_between
from quadriform.shapes.voxels import voxel_spacing, voxels_inside

LABEL_SUFFIXES = (".nii", ".nii.gz", ".nrrd")
"""Of the files that labels are written to."""
ALIGNED = 2
"""Code of a NIfTI form: aligned to another file."""
SQUARE = 1e-5
"""A qform is written when it puts voxels where the sform does, to this share of the smallest voxel."""
RESOLUTION = 96
"""Of the meshes that are filled with voxels."""


def label_map(model: DeformableModel, shape: tuple[int, ...], world_from_voxel: Array) -> NDArray[np.uint8]:
    """Labels on a grid: 0 outside, 1 inside the innermost surface, one more for each surface further out.

    Args:
        model: closed surfaces, one around the other.
        shape: voxels along i, j, k.
        world_from_voxel: (4, 4), into the model's own frame and unit.
    """
    meshes = sorted((model.mesh(name, RESOLUTION) for name in model.surfaces), key=lambda mesh: mesh.volume())
    labels = np.zeros(shape, dtype=np.uint8)
    # From the outermost to the innermost, which overwrites the labels of the others.
    for number, mesh in reversed(list(enumerate(meshes, start=1))):
        moved = np.linalg.solve(world_from_voxel[:3, :3], (mesh.vertices - world_from_voxel[:3, 3]).T).T
        labels[voxels_inside(Mesh(moved.astype(np.float64), mesh.faces), shape)] = number
    return labels


def grid_of_model(model: DeformableModel, world_from_voxel: Array, space: str, unit: str) -> Array:
    """The transform (4, 4) from voxels of an image into the frame and unit of a model.

    Args:
        model: in a known frame and unit.
        world_from_voxel: (4, 4) of the image.
        space: frame of the image's world.
        unit: of lengths there, "mm", "m" or "unknown", which counts as mm.

    Raises:
        OptionError: the frame or unit of the model is unknown.
        InputError: the frame of the image is unknown.
    """
    if model.space == "unknown" or model.unit == "unknown":
        raise OptionError(
            f"a label map needs the frame and unit of the model, found space={model.space!r}, unit={model.unit!r}; "
            "set them in the model, e.g. to 'LPS' and 'mm'"
        )
    # Image and model may differ in frame and unit.
    scale = MILLIMETRES.get(unit, 1.0) / MILLIMETRES[model.unit]
    return np.vstack([scale * rotation_between(space, model.space) @ world_from_voxel[:3], world_from_voxel[3:]])


def encode_labels(
    values: NDArray[np.uint8],
    world_from_voxel: Array,
    space: str,
    unit: str,
    suffix: str = ".nii.gz",
    note: str = "",
) -> bytes:
    """The bytes of a file of labels.

    Args:
        values: (i, j, k).
        world_from_voxel: (4, 4).
        space: "LPS", "RAS" or "unknown"; the last only as NRRD, for NIfTI always states a frame.
        unit: "mm", "m" or "unknown".
        suffix: one of LABEL_SUFFIXES.
        note: description of at most 80 ASCII characters, for NIfTI.

    Raises:
        OptionError: another suffix, or a frame that the format cannot leave open.
    """
    if choose(suffix, LABEL_SUFFIXES, "suffix") == ".nrrd":
        return _nrrd(values, world_from_voxel, space, unit)
    if space == "unknown":
        raise OptionError(
            "the image names no anatomical frame, and NIfTI always states one; write the mask as .nrrd instead"
        )
    content = _nifti(values, world_from_voxel, space, unit, note)
    return gzip.compress(content, mtime=0) if suffix == ".nii.gz" else content


def _nifti(values: NDArray[np.uint8], world_from_voxel: Array, space: str, unit: str, note: str) -> bytes:
    import nibabel

    affine = np.vstack([rotation_between(space, "RAS") @ world_from_voxel[:3], world_from_voxel[3:]])
    image: Any = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units({"mm": "mm", "m": "meter", "unknown": "unknown"}[unit])
    image.header.set_intent("label")
    image.header["descrip"] = note
    image.set_sform(affine, ALIGNED)
    image.set_qform(affine, ALIGNED)  # without shear; the sizes of voxels are set too
    spacing = voxel_spacing(affine)
    if np.abs(image.get_qform() - affine).max() > SQUARE * spacing.min() * max(values.shape):
        image.header["qform_code"] = 0
    return bytes(image.to_bytes())


def _nrrd(values: NDArray[np.uint8], world_from_voxel: Array, space: str, unit: str) -> bytes:
    frames = {"LPS": "left-posterior-superior", "RAS": "right-anterior-superior"}
    frame = f"space: {frames[space]}" if space in frames else "space dimension: 3"
    units = [f'space units: "{unit}" "{unit}" "{unit}"'] if unit != "unknown" else []
    vectors = [f"({','.join(repr(float(x)) for x in vector)})" for vector in world_from_voxel[:3].T]
    lines = [
        "NRRD0004",
        "type: uint8",
        "dimension: 3",
        frame,
        f"sizes: {' '.join(map(str, values.shape))}",
        f"space directions: {' '.join(vectors[:3])}",
        f"space origin: {vectors[3]}",
        "kinds: domain domain domain",
        *units,
        "encoding: gzip",
    ]
    text = "\n".join(lines) + "\n\n"
    return text.encode() + gzip.compress(values.tobytes(order="F"), mtime=0)
