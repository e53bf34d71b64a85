"""`quadriform segment`: the object of an image as a mask."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.cli.options import Common, ObjectInImage, subcommand
from quadriform.cli.screen import note, show, texts, warn
from quadriform.errors import OptionError, status_of, without_notes

if TYPE_CHECKING:
    from quadriform.imaging.segmentation import Segmentation

SHOWN = ("output", "voxels", "shape", "threshold", "components")


@subcommand
def segment(image: Path, *, output: Path, chosen: ObjectInImage, common: Common) -> None:
    """Write the object of an image as a mask of 0 and 1 on the image's own grid.

    Args:
        image: An image: NIfTI, NRRD, MetaImage, DICOM, or a folder of DICOM slices.
        output: The mask, .nii, .nii.gz or .nrrd.
    """
    from quadriform.cli.status import check_strict
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.label_maps import encode_labels
    from quadriform.files.reading import named_in_errors
    from quadriform.imaging.file_points import kept_note, read_object
    from quadriform.imaging.segmentation import segment as segment_volume

    suffix, options = _suffix(output), chosen.parse()
    check_writable(output, common.force, inputs=[image])
    with named_in_errors(image):
        volume, arguments, notes = read_object(image, options)
        found = segment_volume(volume, **arguments)
        # before the mask is encoded: nothing is written for a refused result
        check_strict(common.strict, status_of(found.warnings), found.warnings)
        content = encode_labels(found.mask.astype("uint8"), volume.world_from_voxel, volume.space, volume.unit, suffix)
    write_bytes(output, content, common.force)
    warnings, remarks = without_notes(found.warnings)
    notes += kept_note(found) + remarks
    for text in notes:
        note(f"{image}: {text}")
    warn(warnings)
    record = {"input": str(image), "output": str(output), "warnings": texts(warnings)} | _record(found, notes)
    show(record, common.as_json, [(name, str(record[name])) for name in SHOWN])


def _suffix(output: Path) -> str:
    from quadriform.files.label_maps import LABEL_SUFFIXES

    for suffix in LABEL_SUFFIXES:
        if output.name.lower().endswith(suffix):
            return suffix
    raise OptionError(f"option --output={str(output)!r}: a mask is written as {' or '.join(LABEL_SUFFIXES)}")


def _record(found: "Segmentation", notes: tuple[str, ...]) -> dict[str, Any]:
    return {
        "voxels": int(found.mask.sum()),
        "shape": list(found.mask.shape),
        "threshold": found.threshold,
        "components": len(found.component_voxels),
        "notes": list(notes),
    }
