"""The frame of the world of points in files beside that of a model."""

from pathlib import Path

import numpy as np

from quadriform.cli.screen import note
from quadriform.errors import InputError
from quadriform.imaging.file_points import SpaceAndUnit
from quadriform.points import Array
from quadriform.shapes.spaces import rotation_between


def rotation_to_model(file: Path, metadata: SpaceAndUnit, model: SpaceAndUnit) -> Array:
    """The rotation (3, 3) from the frame of a file's points to that of a model; a note where it is not the identity.

    Args:
        file: named in messages.
        metadata: frame of the world and unit of its points; "unknown" goes with every model.
        model: those of the model.

    Raises:
        InputError: the points are in another unit.
    """
    (space, unit), (model_space, model_unit) = metadata, model
    if unit != model_unit and "unknown" not in (unit, model_unit):
        raise InputError(f"{str(file)!r}: expected lengths in {model_unit}, the unit of the model, found {unit}")
    if space == model_space or "unknown" in (space, model_space):
        return np.eye(3)
    note(f"{file}: brought from {space} to {model_space}")
    return rotation_between(space, model_space)
