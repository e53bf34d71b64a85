"""The entry points `save` and `load`, which choose the format by the suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from quadriform.errors import OptionError, QuadriformError
from quadriform.files.meshes import READ_SUFFIXES, WRITE_SUFFIXES, read_mesh, write_mesh
from quadriform.files.models import (
    MODEL_SUFFIXES,
    is_model_file,
    read_any_model,
    write_model,
    write_moving_model,
)
from quadriform.files.points import POINT_SUFFIXES
from quadriform.files.priors import PRIOR_SUFFIXES, is_prior_file, read_prior, write_prior
from quadriform.files.reading import PathLike, suffix_of, suffix_to_read
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.prior import ShapePrior

Saved = DeformableModel | MovingModel | Mesh | ShapePrior


def save(model_or_mesh: Saved, path: PathLike, force: bool = False) -> None:
    """Write a model (.json .npz), moving model (.json), mesh (.ply .stl .obj .vtp) or prior (.npz), all or nothing.

    A model with one surface can be given a mesh suffix: its surface is written, with its frame and unit. A mesh has
    neither, and is written with "unknown"; `write_mesh` takes them.

    Args:
        model_or_mesh: what to write.
        path: where to.
        force: replace an existing file.

    Raises:
        OptionError: neither a model nor a mesh nor a prior, or a model of several surfaces as one mesh.
        FileFormatError: a suffix that it cannot have.
        OutputError: the target cannot be written; an existing file is unchanged.
    """
    if isinstance(model_or_mesh, Mesh):
        write_mesh(model_or_mesh, path, force=force)
        return
    if isinstance(model_or_mesh, MovingModel):
        write_moving_model(model_or_mesh, path, force)
        return
    if isinstance(model_or_mesh, ShapePrior):
        write_prior(model_or_mesh, path, force)
        return
    if not isinstance(model_or_mesh, DeformableModel):
        raise OptionError(
            f"save: expected a DeformableModel, a Mesh or a ShapePrior, found {type(model_or_mesh).__name__}"
        )
    model = model_or_mesh
    if suffix_of(path, MODEL_SUFFIXES + WRITE_SUFFIXES, "a model") in MODEL_SUFFIXES:
        write_model(model, path, force)
        return
    if len(model.surfaces) != 1:
        names = ", ".join(map(repr, model.surfaces))
        raise OptionError(f"save: the model has the surfaces {names}; choose one: save(model.mesh(name), path)")
    write_mesh(model.mesh(), path, model.space, model.unit, force, model.record.metadata)


def content_of(path: PathLike) -> Literal["model", "mesh", "points"] | None:
    """The kind of content of a file, for every entry point; None for other files.

    The suffix names the format, whatever its case; readers compare the content with it. Only a .npz is opened here,
    as it may contain a model or points.
    """
    suffix = Path(path).suffix.lower()
    if suffix in READ_SUFFIXES:
        return "mesh"
    if suffix == ".npz":
        return "model" if _is_model(path) else "points"
    if suffix in MODEL_SUFFIXES:
        return "model"
    return "points" if suffix in POINT_SUFFIXES else None


def _is_model(path: PathLike) -> bool:
    try:
        return is_model_file(path)
    except QuadriformError:
        return False  # the reader of points reports what is wrong


def load(path: PathLike) -> Saved:
    """The object that `save` wrote: a model (.json .npz), a moving model (.json), a prior (.npz) or a mesh.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: not what its name says, or damaged.
        FileLimitError: beyond the budget.
    """
    suffix = suffix_to_read(path, MODEL_SUFFIXES + READ_SUFFIXES, "a model or a mesh")
    if suffix in PRIOR_SUFFIXES and is_prior_file(path):
        return read_prior(path)
    return read_any_model(path) if suffix in MODEL_SUFFIXES else read_mesh(path)
