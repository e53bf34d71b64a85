"""The two frames of the world: a half-turn about z, from the feet to the head, leads from LPS to RAS and back."""

import numpy as np

from quadriform.errors import InputError, choose
from quadriform.points import Array

SPACES = ("LPS", "RAS")
HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def rotation_between(space: str, wanted: str) -> Array:
    """The rotation (3, 3) that brings points of one frame of the world to another; the unit matrix where they agree.

    Raises:
        OptionError: the wanted one is neither "LPS" nor "RAS".
        InputError: where the points are is unknown.
    """
    if space == wanted:
        return np.eye(3)
    choose(wanted, SPACES, "space")
    if space not in SPACES:
        raise InputError(
            f"the frame of the world is not known, so nothing can be brought to {wanted}: expected LPS or RAS, found "
            f"{space!r}; leave the numbers as they are, or say first where they are at home"
        )
    return HALF_TURN
