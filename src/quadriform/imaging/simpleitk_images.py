"""NRRD and MetaImage by SimpleITK; its result is used when all bytes are present and the spacing is the header's."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import AffineError, FileFormatError, MaskError
from quadriform.files.reading import named_in_errors
from quadriform.imaging.formats import Size, choose_frame, import_reader
from quadriform.imaging.segments import SegmentMap
from quadriform.imaging.text_headers import TextHeader, check_bytes, read_text_header
from quadriform.imaging.volume import Volume
from quadriform.points import Array

if TYPE_CHECKING:
    from SimpleITK import Image, ImageFileReader

KINDS_WITH_FRAMES = ("list", "time", "domain")
"""Kinds of the axes of a NRRD with frames: "domain" in space, the others over the frames. Those of colours and vectors
are others."""
SAME_SPACING = 1e-4
"""Relative; the spacing that SimpleITK gives is the header's."""


def read_with_simpleitk(path: Path, frame: int | None) -> Volume:
    """Return one frame of a NRRD or MetaImage file; see `quadriform.imaging.reading.read_volume`."""
    with named_in_errors(path):
        header = read_text_header(path)
        reader = _reader(path, header)
        chosen = choose_frame(frame, _shape(reader, header), path)
        image = _call(reader.Execute)
        if not header.segments:
            return Volume(_values(image, chosen), _affine(image), header.space)
        found = _segment_map(image, header)
        return Volume(found.values, _affine(image), header.space, segments=tuple(found.segments), is_label_map=True)


def simpleitk_times(path: Path) -> tuple[int, Array | None]:
    """Return the number of frames, and None for their times: these formats have no unit of time.

    Raises:
        InputError, FileFormatError, FileLimitError, MaskError: as `read_with_simpleitk`.
    """
    with named_in_errors(path):
        header = read_text_header(path)
        return _shape(_reader(path, header), header)[3], None


def _reader(path: Path, header: TextHeader) -> "ImageFileReader":
    """A reader of a file whose bytes are complete and whose spacing is valid."""
    simpleitk = import_reader("SimpleITK", path)
    reader = simpleitk.ImageFileReader()
    reader.SetImageIO("NrrdImageIO" if header.is_nrrd else "MetaImageIO")
    reader.SetFileName(str(path))
    _call(reader.ReadImageInformation)
    kind = simpleitk.GetPixelIDValueAsString(reader.GetPixelID())
    bits = re.search(r"(\d+)-bit", kind)
    if bits is None or "complex" in kind:
        raise MaskError(f"expected one real number a voxel, found {kind}")
    # checked before SimpleITK reads the voxels, of which it would invent the missing ones
    values = int(np.prod(reader.GetSize(), dtype=object)) * reader.GetNumberOfComponents()
    check_bytes(header, values * int(bits[1]) // 8)
    _check_spacing(reader, header)
    return reader


def _check_spacing(reader: "ImageFileReader", header: TextHeader) -> None:
    """Refuse a spacing that is missing or no number, for which SimpleITK takes 1."""
    found, stated = np.array(reader.GetSpacing()), header.spacing[np.isfinite(header.spacing)]
    same = found.shape == stated.shape and np.allclose(found, stated, rtol=SAME_SPACING, atol=0)
    if not (same and stated.min() > 0):
        raise AffineError(
            f"the header gives the spacing {header.spacing.tolist()}; expected {len(found)} lengths above 0"
        )


def _shape(reader: "ImageFileReader", header: TextHeader) -> Size:
    """Voxels along i, j, k and frames: a fourth dimension, or values of a voxel that are a list by the kinds."""
    size, components = tuple(int(n) for n in reader.GetSize()), int(reader.GetNumberOfComponents())
    has_frames = set(header.kinds.split()) <= set(KINDS_WITH_FRAMES) and header.kinds != ""
    if len(size) not in (3, 4) or (components > 1 and (len(size) == 4 or not has_frames)):
        raise MaskError(
            f"expected a three-dimensional image, or frames of it; found shape {size} with {components} values a voxel"
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


def _segment_map(image: "Image", header: TextHeader) -> SegmentMap:
    """The segments of 3D Slicer as one label image; those of different layers may overlap."""
    layers = [_values(image, layer) for layer in range(image.GetNumberOfComponentsPerPixel())]
    found = SegmentMap(np.zeros(layers[0].shape, dtype=np.int32))
    for segment in header.segments:
        if not 0 <= segment.layer < len(layers):
            raise FileFormatError(
                f"segment {segment.name!r} is in layer {segment.layer}; the file has {len(layers)} layers"
            )
        found.add(segment.name, segment.value, layers[segment.layer] == segment.value)
    return found


def _affine(image: "Image") -> Array:
    """World from voxel (4, 4): ITK's origin + direction @ (spacing * index)."""
    d = image.GetDimension()
    spacing, direction = np.array(image.GetSpacing()), np.array(image.GetDirection()).reshape(d, d)
    if d == 4 and (direction[3, :3].any() or direction[:3, 3].any()):
        raise AffineError(f"the axes of space and time are mixed: {direction.tolist()}")
    affine = np.eye(4)
    # columns of the direction are the axes of the image, each of which gets its own spacing
    affine[:3, :3] = direction[:3, :3] * spacing[:3]
    affine[:3, 3] = image.GetOrigin()[:3]
    return affine


def _call(step: Any) -> Any:
    """The result of a call of SimpleITK, whose every failure is a RuntimeError of many lines; the last is the cause."""
    try:
        return step()
    except RuntimeError as error:
        raise FileFormatError(f"cannot be read: {str(error).strip().splitlines()[-1]}") from error
