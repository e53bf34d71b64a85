"""NRRD and MetaImage by SimpleITK, which is believed when the bytes are all there and the spacing is the header's."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import AffineError, FileFormatError, MaskError
from quadriform.files.reading import quoted
from quadriform.imaging.reader_common import Size, choose_frame, import_reader
from quadriform.imaging.segments import SegmentMap
from quadriform.imaging.text_headers import TextHeader, check_bytes, read_text_header
from quadriform.imaging.volume import Volume
from quadriform.points import Array

if TYPE_CHECKING:
    from SimpleITK import Image, ImageFileReader

TIME_KINDS = ("list", "time", "domain")
"""What the kind of a NRRD's fourth axis may be called when it is time; others are colours and vectors."""
SAME = 1e-4
"""Relative; the spacing that SimpleITK gives is the header's."""


def read_with_simpleitk(path: Path, frame: int | None) -> Volume:
    """Read one frame of a NRRD or MetaImage file; see `quadriform.imaging.reading.read_volume`."""
    header = read_text_header(path)
    reader = _reader(path, header)
    shape = _shape(reader, header, path)
    chosen = choose_frame(frame, shape, path)
    image = _do(reader.Execute, path)
    try:
        if header.segments:
            found = _segment_map(image, header, path)
            return Volume(
                found.values, _affine(image, path), header.space, segments=tuple(found.segments), is_label_map=True
            )
        return Volume(_values(image, chosen), _affine(image, path), header.space)
    except (MaskError, AffineError) as error:
        raise type(error)(f"{quoted(path)}: {error}") from error


def simpleitk_times(path: Path) -> tuple[int, Array | None]:
    """The number of frames; their times are None, for these formats have no unit of time.

    Raises:
        InputError, FileFormatError, FileLimitError, MaskError: as `read_with_simpleitk`.
    """
    header = read_text_header(path)
    return _shape(_reader(path, header), header, path)[3], None


def _reader(path: Path, header: TextHeader) -> "ImageFileReader":
    """A reader that knows the header, and found all bytes there."""
    simpleitk = import_reader("SimpleITK", path)
    reader = simpleitk.ImageFileReader()
    reader.SetImageIO("NrrdImageIO" if header.is_nrrd else "MetaImageIO")
    reader.SetFileName(str(path))
    _do(reader.ReadImageInformation, path)
    kind = simpleitk.GetPixelIDValueAsString(reader.GetPixelID())
    bits = re.search(r"(\d+)-bit", kind)
    if bits is None or "complex" in kind:
        raise MaskError(f"{quoted(path)}: expected one real number a voxel, found {kind}")
    values = int(np.prod(reader.GetSize(), dtype=object)) * reader.GetNumberOfComponents()
    check_bytes(header, values * int(bits[1]) // 8)
    _check_spacing(reader, header, path)
    return reader


def _check_spacing(reader: "ImageFileReader", header: TextHeader, path: Path) -> None:
    """SimpleITK takes 1 for a spacing that is missing or no number."""
    found, meant = np.array(reader.GetSpacing()), header.spacing[np.isfinite(header.spacing)]
    if found.shape != meant.shape or not (np.allclose(found, meant, rtol=SAME, atol=0) and meant.min() > 0):
        raise AffineError(
            f"{quoted(path)}: the header gives the spacing {header.spacing.tolist()}; expected {len(found)} lengths "
            "above 0"
        )


def _shape(reader: "ImageFileReader", header: TextHeader, path: Path) -> Size:
    """Voxels along i, j, k and frames: a fourth dimension, or values of a voxel that the file calls a list."""
    size, components = tuple(int(n) for n in reader.GetSize()), int(reader.GetNumberOfComponents())
    kinds = set(header.kinds.split()) <= set(TIME_KINDS) and header.kinds != ""
    if len(size) not in (3, 4) or (components > 1 and (len(size) == 4 or not kinds)):
        raise MaskError(
            f"{quoted(path)}: expected a three-dimensional image, or frames of it; found shape {size} with "
            f"{components} values a voxel"
        )
    frames = size[3] if len(size) == 4 else components
    return size[0], size[1], size[2], 1 if header.segments else frames


def _values(image: "Image", frame: int) -> NDArray[Any]:
    """Voxels (i, j, k) of one frame."""
    from SimpleITK import GetArrayFromImage

    array = GetArrayFromImage(image)  # (frame, k, j, i), (k, j, i) or (k, j, i, frame)
    if image.GetDimension() == 4:
        array = array[frame]
    elif array.ndim == 4:
        array = array[..., frame]
    return np.ascontiguousarray(array).T


def _segment_map(image: "Image", header: TextHeader, path: Path) -> SegmentMap:
    """The segments of 3D Slicer as one label image; those of different layers may overlap."""
    layers = [_values(image, layer) for layer in range(image.GetNumberOfComponentsPerPixel())]
    found = SegmentMap(np.zeros(layers[0].shape, dtype=np.int32))
    for segment in header.segments:
        if not 0 <= segment.layer < len(layers):
            raise FileFormatError(
                f"{quoted(path)}: segment {segment.name!r} is in layer {segment.layer}; the file has {len(layers)}"
            )
        found.add(segment.name, segment.value, layers[segment.layer] == segment.value)
    return found


def _affine(image: "Image", path: Path) -> Array:
    d = image.GetDimension()
    spacing, direction = np.array(image.GetSpacing()), np.array(image.GetDirection()).reshape(d, d)
    if d == 4 and (direction[3, :3].any() or direction[:3, 3].any()):
        raise AffineError(f"{quoted(path)}: the axes of space and time are mixed: {direction.tolist()}")
    affine = np.eye(4)
    affine[:3, :3] = direction[:3, :3] * spacing[:3]
    affine[:3, 3] = image.GetOrigin()[:3]
    return affine


def _do(step: Any, path: Path) -> Any:
    """Call SimpleITK, whose every failure is a RuntimeError of many lines; the last one is the cause."""
    try:
        return step()
    except RuntimeError as error:
        said = str(error).strip().splitlines()[-1]
        raise FileFormatError(f"{quoted(path)}: cannot be read: {said}") from error
