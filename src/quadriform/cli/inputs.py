"""What the verbs do with files beside reading them: bring their points to the frame of a model, refuse warnings."""

from pathlib import Path

import numpy as np

from quadriform.cli.screen import say
from quadriform.errors import FitError, InputError, Warnings
from quadriform.imaging.file_points import SpaceAndUnit
from quadriform.points import Array
from quadriform.shapes.spaces import turn_between


def turn_to_model(file: Path, marks: SpaceAndUnit, model: SpaceAndUnit) -> Array:
    """The rotation (3, 3) from the frame of a file's points to that of a model; said where it is one. Unknown fits all.

    Raises:
        InputError: the points are in another unit.
    """
    (space, unit), (wanted_space, wanted_unit) = marks, model
    if unit != wanted_unit and "unknown" not in (unit, wanted_unit):
        raise InputError(f"{str(file)!r}: expected lengths in {wanted_unit}, the unit of the model, found {unit}")
    if space == wanted_space or "unknown" in (space, wanted_space):
        return np.eye(3)
    say(f"note: {file}: brought from {space} to {wanted_space}")
    return turn_between(space, wanted_space)


def refuse(warnings: Warnings) -> None:
    """What `--strict` does with warnings.

    Raises:
        FitError: there are some.
    """
    if warnings:
        raise FitError("refused for its warnings: " + "; ".join(f"{kind}: {text}" for kind, text in warnings.items()))
