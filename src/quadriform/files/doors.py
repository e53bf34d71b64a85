"""The two front doors: `save` and `load` choose the format by the suffix."""

import os

from quadriform.errors import OptionError
from quadriform.files.meshes import MESH_SUFFIXES, read_mesh, write_mesh
from quadriform.files.models import MODEL_SUFFIXES, read_model, write_model
from quadriform.files.reading import suffix_of
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel

PathLike = str | os.PathLike[str]


def save(model_or_mesh: DeformableModel | Mesh, path: PathLike, force: bool = False) -> None:
    """Write a model (.json .npz) or a mesh (.ply .stl .obj .vtp), all or nothing.

    A model with one surface can be given a mesh suffix: its surface is written, with its frame and unit. A mesh knows
    neither and says so; `write_mesh` takes them.

    Args:
        model_or_mesh: what to write.
        path: where to.
        force: replace an existing file.

    Raises:
        OptionError: neither a model nor a mesh, or a model of several surfaces as one mesh.
        FileFormatError: a suffix that it cannot have.
        OutputError: the target cannot be written; what stood there is untouched.
    """
    if isinstance(model_or_mesh, Mesh):
        write_mesh(model_or_mesh, path, force=force)
        return
    if not isinstance(model_or_mesh, DeformableModel):
        raise OptionError(f"save: expected a DeformableModel or a Mesh, found {type(model_or_mesh).__name__}")
    model = model_or_mesh
    if suffix_of(path, MODEL_SUFFIXES + MESH_SUFFIXES, "a model") in MODEL_SUFFIXES:
        write_model(model, path, force)
        return
    if len(model.surfaces) != 1:
        names = ", ".join(map(repr, model.surfaces))
        raise OptionError(f"save: the model has the surfaces {names}; choose one: save(model.mesh(name), path)")
    write_mesh(model.mesh(), path, model.space, model.unit, force)


def load(path: PathLike) -> DeformableModel | Mesh:
    """Read back what `save` wrote: a model from .json or .npz, a mesh from .ply, .stl, .obj or .vtp.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not what its name says, or damaged.
        FileLimitError: beyond the budget.
    """
    if suffix_of(path, MODEL_SUFFIXES + MESH_SUFFIXES, "a model or a mesh") in MODEL_SUFFIXES:
        return read_model(path)
    return read_mesh(path)
