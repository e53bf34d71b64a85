"""Rules of the image readers of all formats: the frame of a moving image, and the library of a format."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from quadriform.errors import InputError, MaskError, OptionError
from quadriform.files.reading import quoted

Size = tuple[int, int, int, int]
"""Voxels along i, j and k, and frames."""


def choose_frame(frame: int | None, shape: Size, path: Path) -> int:
    """Return the frame to read from an image of `shape`; None is valid for an image of one frame.

    Raises:
        MaskError: there are several, and none was given.
        OptionError: there is no such frame.
    """
    n = shape[3]
    if frame is None and n > 1:
        raise MaskError(
            f"{quoted(path)}: a four-dimensional image of shape {shape}; choose frame=0 to frame={n - 1}, or follow "
            "them all with track"
        )
    if frame is not None and not (isinstance(frame, (int, np.integer)) and 0 <= frame < n):
        raise OptionError(f"option frame={frame!r}: {quoted(path)} has frames 0 to {n - 1}")
    return int(frame or 0)


def import_reader(module: str, path: Path) -> ModuleType:
    """Return the library that reads `path`.

    Raises:
        InputError: it is not installed; the message has the command that does it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{quoted(path)}: reading this format needs {module.split('.')[0]}; pip install 'quadriform[images]'"
        ) from error
