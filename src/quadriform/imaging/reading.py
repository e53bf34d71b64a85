"""Images from files: one function, and one reader for each suffix."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

from quadriform.errors import FileFormatError, InputError
from quadriform.imaging.nifti import read_nifti
from quadriform.imaging.volume import Volume

PathLike = str | os.PathLike[str]

READERS: dict[str, Callable[[Path, int | None], Volume]] = {".nii": read_nifti, ".nii.gz": read_nifti}
"""From a suffix to the function that reads such a file."""


def read_volume(path: PathLike, frame: int | None = None) -> Volume:
    """Read an image into world LPS millimetres.

    NIfTI: the sform is used, else the qform; metres and microns become millimetres; slope and intercept are
    applied once (a slope of 0 means none, as the format says). The file is read and checked to its end.

    Args:
        path: a .nii or .nii.gz file.
        frame: which frame of a four-dimensional image, counted from 0.

    Returns:
        The image; `unit` is "unknown" where the file does not say, and `warnings` has AFFINE_REPAIRED where
        sform and qform disagree.

    Raises:
        InputError: no such file, a folder, or not readable.
        FileFormatError: empty, cut short, damaged, or not what its suffix says.
        FileLimitError: the header promises more than the budget.
        AffineError: the transform to the world is missing, singular or not finite.
        MaskError: not three-dimensional (name a `frame` of a four-dimensional one), no real numbers, or NaN.
        OptionError: there is no such frame.
    """
    file = Path(path)
    _check_file(file)
    for suffix, reader in READERS.items():
        if file.name.lower().endswith(suffix):
            return reader(file, frame)
    raise FileFormatError(f"{str(path)!r}: not the name of an image; expected a suffix of {' '.join(READERS)}")


def example_path() -> Path:
    """Where the image of the demo lies: a human brain, `example4d.nii.gz` of the installed nibabel.

    Raises:
        InputError: this installation of nibabel has no test data.
    """
    import nibabel

    path = Path(nibabel.__file__).parent / "tests" / "data" / "example4d.nii.gz"
    if not path.is_file():
        raise InputError(f"the example image is missing, expected {str(path)!r}; reinstall nibabel from its wheel")
    return path


def example_volume() -> Volume:
    """The image of the demo: first volume of `example_path()`, 128 x 96 x 24 voxels of 2 x 2 x 2.2 mm.

    Raises:
        InputError: this installation of nibabel has no test data.
    """
    return read_volume(example_path(), frame=0)


def _check_file(path: Path) -> None:
    try:
        status = path.stat()
    except FileNotFoundError as error:
        raise InputError(f"{str(path)!r}: there is no such file") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{str(path)!r}: cannot be read: {error}") from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
        raise InputError(f"{str(path)!r}: expected an image file, found {kind}")
    if status.st_size == 0:
        raise FileFormatError(f"{str(path)!r}: the file is empty")
