"""Images from files: one function for all formats, which are recognised by their content, or else by their names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from quadriform.errors import FileFormatError, InputError, OptionError
from quadriform.files.reading import PathLike, check_readable
from quadriform.imaging.dicom import dicom_times, read_dicom
from quadriform.imaging.formats import SUFFIXES, Format, image_format
from quadriform.imaging.nifti import nifti_times, read_nifti
from quadriform.imaging.simpleitk_images import read_with_simpleitk, simpleitk_times
from quadriform.imaging.volume import Volume
from quadriform.points import Array


class Reader(NamedTuple):
    """The reader of a format.

    Attributes:
        volume: returns one frame.
        times: returns the number of frames, and their times (frames,) in ms where the file has them.
    """

    volume: Callable[..., Volume]
    times: Callable[[Path], tuple[int, Array | None]]


READERS: dict[Format, Reader] = {
    "nifti": Reader(read_nifti, nifti_times),
    "simpleitk": Reader(read_with_simpleitk, simpleitk_times),
    "dicom": Reader(read_dicom, dicom_times),
}


def read_volume(path: PathLike, frame: int | None = None, affine: str | None = None) -> Volume:
    """Return an image, in LPS millimetres where the file states its frame of the world and its unit.

    NIfTI, in one file or a pair: where sform and qform disagree, `quadriform.imaging.nifti_forms` has the rules;
    metres and microns become millimetres; slope and intercept are applied once (a slope of 0 or NaN means none). The
    file is read and checked to its end.
    NRRD and MetaImage (by SimpleITK): `space` is "unknown" where the file names no anatomical frame.
    DICOM (by pydicom): see `quadriform.imaging.dicom.read_dicom`, which also takes one of several series in a folder.

    Args:
        path: a NIfTI, NRRD or MetaImage file; a folder of DICOM slices, one file of a DICOM series, or a DICOM file of
            many images.
        frame: which frame of a four-dimensional image, counted from 0.
        affine: which transform of a NIfTI header to use: "sform", "qform", or "pixdim" for the sizes of voxels
            alone, in an unknown space. None decides by the header.

    Warnings of the image:
        UNKNOWN_UNIT: the NIfTI header has no unit, and `unit` is "unknown".
        AFFINE_REPAIRED: sform and qform disagree, or one of them cannot be used.
        UNREADABLE_FILES: damaged files in the folder of a DICOM series were left out.

    Raises:
        InputError: no such file, not readable, a library is missing, or a DICOM series that is ragged or one of many.
        FileFormatError: empty, cut short, damaged, or of no known format.
        FileLimitError: the header states more than the budget.
        AffineError: the transform to the world is missing, singular or not finite.
        MaskError: not three-dimensional (name a `frame` of a four-dimensional one), no real numbers, or NaN.
        OptionError: there is no such frame.
    """
    file = Path(path)
    reader = _reader(file)
    if affine is None:
        return reader.volume(file, frame)
    if reader is not READERS["nifti"]:
        raise OptionError(f"option affine={affine!r}: {str(file)!r} is no NIfTI image, and has one transform alone")
    return reader.volume(file, frame, affine)


def frame_count(path: PathLike) -> int:
    """Return the number of frames of an image; 1 for a three-dimensional one.

    Raises:
        InputError, FileFormatError, FileLimitError, AffineError, MaskError: as `read_volume`.
    """
    file = Path(path)
    return _reader(file).times(file)[0]


def frame_times(path: PathLike) -> Array | None:
    """Return the times (frames,) of an image in ms, or None where the file has none.

    They are the trigger times of DICOM (mean over the slices), and the even steps of NIfTI; NRRD and MetaImage have
    no unit of time.

    Raises:
        InputError, FileFormatError, FileLimitError, AffineError, MaskError: as `read_volume`.
    """
    file = Path(path)
    return _reader(file).times(file)[1]


def example_path() -> Path:
    """Return the path of the image of the demo: a human brain, `example4d.nii.gz` of the installed nibabel.

    Raises:
        InputError: this installation of nibabel has no test data.
    """
    import nibabel

    path = Path(nibabel.__file__).parent / "tests" / "data" / "example4d.nii.gz"
    if not path.is_file():
        raise InputError(f"the example image is missing, expected {str(path)!r}; reinstall nibabel from its wheel")
    return path


def example_volume() -> Volume:
    """Return the image of the demo: first volume of `example_path()`, 128 x 96 x 24 voxels of 2 x 2 x 2.2 mm.

    Raises:
        InputError: this installation of nibabel has no test data.
    """
    return read_volume(example_path(), frame=0)


def _reader(path: Path) -> Reader:
    if not path.is_dir():
        check_readable(path)
    found = "dicom" if path.is_dir() else image_format(path)
    if found is None:
        raise FileFormatError(
            f"{str(path)!r}: no image by its content, nor by its name; expected a suffix of {' '.join(SUFFIXES)}"
        )
    return READERS[found]
