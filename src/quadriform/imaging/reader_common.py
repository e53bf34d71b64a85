"""What the readers of all formats ask alike: which frame of a moving image, and is the library there."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from quadriform.errors import InputError, MaskError, OptionError

Size = tuple[int, int, int, int]
"""Voxels along i, j and k, and frames."""


def choose_frame(frame: int | None, shape: Size, path: Path) -> int:
    """The frame to read from an image of `shape`; None will do where there is one alone.

    Raises:
        MaskError: there are several, and none was named.
        OptionError: there is no such frame.
    """
    n = shape[3]
    if frame is None and n > 1:
        raise MaskError(
            f"{str(path)!r}: a four-dimensional image of shape {shape}; choose frame=0 to frame={n - 1}, or follow "
            "them all with track"
        )
    if frame is not None and not (isinstance(frame, (int, np.integer)) and 0 <= frame < n):
        raise OptionError(f"option frame={frame!r}: {str(path)!r} has frames 0 to {n - 1}")
    return int(frame or 0)


def import_reader(module: str, path: Path) -> ModuleType:
    """Import the library that reads `path`.

    Raises:
        InputError: it is not installed; the message has the command that does it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{str(path)!r}: reading this format needs {module.split('.')[0]}; pip install 'quadriform[images]'"
        ) from error
