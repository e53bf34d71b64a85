"""The frame and the unit that every file of ours is marked with."""

from quadriform.errors import choose

SPACES = ("LPS", "RAS", "unknown")
UNITS = ("mm", "m", "unknown")


def check_marks(space: str, unit: str) -> None:
    """Refuse marks that no file can carry.

    Raises:
        OptionError: naming the mark and what is allowed.
    """
    choose(space, SPACES, "space")
    choose(unit, UNITS, "unit")
