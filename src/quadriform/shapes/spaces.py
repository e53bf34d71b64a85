"""The two frames of the world: LPS and RAS differ by a rotation of 180 degrees about z, from the feet to the head."""

import numpy as np

from quadriform.errors import InputError, choose
from quadriform.points import Array

SPACES = ("LPS", "RAS")
HALF_ROTATION = np.diag([-1.0, -1.0, 1.0])


def rotation_between(space: str, requested: str) -> Array:
    """The rotation (3, 3) that brings points of one frame of the world to another; the unit matrix where they agree.

    Raises:
        OptionError: the requested one is neither "LPS" nor "RAS".
        InputError: the frame of the points is unknown.
    """
    if space == requested:
        return np.eye(3)
    choose(requested, SPACES, "space")
    if space not in SPACES:
        raise InputError(
            f"the frame of the world is unknown, so nothing can be brought to {requested}: expected LPS or RAS, found "
            f"{space!r}; leave the coordinates as they are, or state their frame first"
        )
    return HALF_ROTATION
